# SPDX-License-Identifier: Apache-2.0
"""Alerts on 500 random servo tasks: how long before a blow-up they come, how many are missed, how many are false.

A blow-up is a linear speed above ten times its value at the start; a false alarm is WARN or above in a run without one.
The runs come from an independent implementation (servo_tasks.py) and are replayed through the monitor with its default
parameters; the twist of a frame reaches the monitor after it has judged that frame, as on topics.

    python3 -m benchmark alert_quality
    python3 -m benchmark.alert_quality --seed 2 --tasks 500 --noise 0.002
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from benchmark.servo_tasks import GAIN, STEPS, TIME_STEP, Runs, Task, random_task, run_all
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters import MonitorParameters
from plsing_ros.simulation.simulated_camera import SimulatedCamera

# Defaults were tuned on the first, and verified once on the second.
SEEDS = (1, 2)
TASKS = 500
_FIRST_STAMP = 10**9
_WANTED_LEAD = 0.5  # [s]


@dataclass(frozen=True)
class _AlertReplay:
    number: int
    task: Task
    rotation: np.ndarray
    position: np.ndarray
    twist: np.ndarray
    noise: float
    target_known: bool
    with_pose: bool


def main() -> None:
    """Measure and print, for the seed that the defaults were tuned on and for another."""
    for seed in SEEDS:
        study(seed, TASKS)


def study(
    seed: int, count: int, noise: float = 0.0, target_known: bool = True, with_pose: bool = True, workers: int = 2
) -> None:
    """Run the tasks of a seed, replay them through the monitor, and print the result."""
    tasks = [random_task(seed, i) for i in range(count)]
    with tqdm(total=STEPS, desc=f"seed {seed}: servo runs", leave=False) as bar:
        runs = run_all(tasks, bar.update)
    replays = [_replay(i, task, runs, noise, target_known, with_pose) for i, task in enumerate(tasks)]
    with ProcessPoolExecutor(workers, initializer=os.nice, initargs=(5,)) as pool:
        alerts = list(
            tqdm(pool.map(_first_alert, replays, chunksize=5), total=count, desc=f"seed {seed}: monitor", leave=False)
        )
    print(_report(replays, seed, runs, alerts), flush=True)


def _replay(number: int, task: Task, runs: Runs, noise: float, target_known: bool, with_pose: bool) -> _AlertReplay:
    n = runs.frames[number]
    return _AlertReplay(
        number,
        task,
        runs.rotation[:n, number].copy(),
        runs.position[:n, number].copy(),
        runs.twist[:n, number].copy(),
        noise,
        target_known,
        with_pose,
    )


def _first_alert(replay: _AlertReplay) -> tuple[int, str] | None:
    """Return the frame of the first WARN or above, and its reason."""
    lines = replay.task.lines
    monitor = SingularityMonitor.from_parameters(
        MonitorParameters(
            lines_points=tuple(lines.point.ravel()),
            lines_directions=tuple(lines.direction.ravel()),
            target_known=replay.target_known,
            target_position=tuple(replay.task.target.translation),
            target_orientation=tuple(replay.task.target.quaternion_xyzw),
            # The loop of these runs: the plain law without limits, on a camera that follows every twist at once.
            gain=GAIN,
            max_linear_speed=0.0,
            max_angular_speed=0.0,
            frames_late=0,
            robot_lag=0.0,
            robot_clamps=False,
        )
    )
    camera = SimulatedCamera(lines, replay.task.start, "camera", replay.noise, replay.number)
    for frame, (rotation, position, twist) in enumerate(
        zip(replay.rotation, replay.position, replay.twist, strict=True)
    ):
        camera.T_world_camera = Pose(rotation, position)
        stamp = _FIRST_STAMP + round(frame * TIME_STEP * 1e9)
        if replay.with_pose:
            monitor.receive_pose(camera.T_world_camera, stamp)
        seen: LineObservation = camera.observe()
        try:
            assessment = monitor.answer(seen, stamp, stamp)
        except PlsingError as error:
            # As the node does; a camera that has run away can be too far off to see anything in numbers.
            assessment = monitor.unusable(str(error), stamp)
        if assessment is not None and assessment.level in (Level.WARN, Level.CRITICAL):
            return frame, assessment.reason
        monitor.receive_twist(twist, stamp)
    return None


def _report(replays: list[_AlertReplay], seed: int, runs: Runs, alerts: list[tuple[int, str] | None]) -> str:
    blew_up = runs.blew_up
    first = np.array([np.inf if alert is None else alert[0] for alert in alerts])
    lead = (runs.frames - 1 - first) * TIME_STEP
    announced = blew_up & (lead > 0.0)
    false = ~blew_up & np.isfinite(first)
    speed = np.linalg.norm(runs.twist[:, :, :3], axis=2)
    calm = speed.max(axis=0) < 2.0 * speed[0]
    leads = np.where(announced, lead, 0.0)[blew_up]
    causes = Counter(_cause(alerts[i][1]) for i in np.flatnonzero(false))
    target = "known" if replays[0].target_known else "not known"
    pose = "camera_pose" if replays[0].with_pose else "no camera_pose"
    return "\n".join(
        [
            f"seed {seed}: {len(blew_up)} tasks, target {target}, {pose}, noise {replays[0].noise:g}: "
            f"{blew_up.sum()} blow-ups, {(~blew_up).sum()} others",
            f"  announced            {announced.sum()} of {blew_up.sum()} ({announced.sum() / blew_up.sum():.1%})",
            f"  lead                 median {np.median(leads):.2f} s, 5th percentile {np.quantile(leads, 0.05):.2f} s",
            f"  lead >= {_WANTED_LEAD} s        {np.mean(leads >= _WANTED_LEAD):.1%}",
            f"  false alarms         {false.sum()} of {(~blew_up).sum()} ({false.sum() / (~blew_up).sum():.1%})",
            f"    by cause           {dict(causes)}",
            f"  of which the speed never doubled: {(false & calm).sum()} of {(calm & ~blew_up).sum()} such runs",
        ]
    )


def _cause(reason: str) -> str:
    return " ".join(word for word in reason.split(" is ")[0].split() if word.isalpha())[:60]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEEDS[0])
    parser.add_argument("--tasks", type=int, default=TASKS)
    parser.add_argument("--noise", type=float, default=0.0, help="on the Plücker coordinates of the lines")
    parser.add_argument("--no-target", action="store_true", help="the monitor does not know the target")
    parser.add_argument("--no-pose", action="store_true", help="the monitor gets no camera_pose")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    options = parser.parse_args()
    study(options.seed, options.tasks, options.noise, not options.no_target, not options.no_pose, options.workers)
