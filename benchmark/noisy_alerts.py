# SPDX-License-Identifier: Apache-2.0
"""Alerts on random servo tasks whose controller acts on the noisy lines that the monitor sees, too.

A blow-up is a linear speed above ten times its value at the start, noise or not; a false alarm is WARN or above in a
run without one. Target and pose are known, tasks are those of alert_quality.

    python3 -m benchmark noisy_alerts
    python3 -m benchmark.noisy_alerts --seed 2 --tasks 500 --noise 0.0005
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from benchmark.servo_tasks import BLOW_UP, GAIN, STEPS, TIME_STEP, random_task
from plsing_ros.errors import PlsingError
from plsing_ros.features import interaction_matrix, project_lines
from plsing_ros.levels import Level
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters import MonitorParameters
from plsing_ros.simulation.simulated_camera import SimulatedCamera

SEED, TASKS, NOISE = 1, 100, 2e-3
_FIRST_STAMP = 10**9
_WANTED_LEAD = 0.5  # [s]


class _Run(NamedTuple):
    """Whether the speed blew up, its largest growth, and the time from the first alert to the end [s], or None."""

    blew_up: bool
    growth: float
    lead: float | None


def main() -> None:
    """Measure and print."""
    study(SEED, TASKS, NOISE)


def study(seed: int, count: int, noise: float, workers: int = 2) -> None:
    """Run the tasks of a seed and print the result."""
    with ProcessPoolExecutor(workers, initializer=os.nice, initargs=(5,)) as pool:
        running = pool.map(partial(_run, seed, noise), range(count), chunksize=2)
        runs = list(tqdm(running, total=count, desc=f"seed {seed}", leave=False))
    blown, others = [run for run in runs if run.blew_up], [run for run in runs if not run.blew_up]
    leads = np.array([run.lead or 0.0 for run in blown])
    false = [run for run in others if run.lead is not None]
    print(
        f"seed {seed}: {count} tasks, noise {noise:g} in the loop: {len(blown)} blow-ups, {len(others)} others\n"
        f"  announced      {(leads > 0.0).sum()} of {len(blown)} ({np.mean(leads > 0.0):.1%})\n"
        f"  lead           median {np.median(leads):.2f} s, {np.mean(leads >= _WANTED_LEAD):.1%} at least "
        f"{_WANTED_LEAD} s\n"
        f"  false alarms   {len(false)} of {len(others)} ({len(false) / len(others):.1%}); the speed of "
        f"{sum(run.growth > 4.0 for run in false)} of them came to more than 4 times that at the start, of "
        f"{sum(run.growth < 2.0 for run in false)} it did not double",
        flush=True,
    )


def _run(seed: int, noise: float, number: int) -> _Run:
    task = random_task(seed, number)
    lines = task.lines
    monitor = SingularityMonitor.from_parameters(
        MonitorParameters(
            lines_points=tuple(lines.point.ravel()),
            lines_directions=tuple(lines.direction.ravel()),
            target_known=True,
            target_position=tuple(task.target.translation),
            target_orientation=tuple(task.target.quaternion_xyzw),
        )
    )
    desired = project_lines(lines.transformed(task.target.inverse(), "camera"))
    camera = SimulatedCamera(lines, task.start, "camera", noise, number)
    speeds: list[float] = []
    alert: int | None = None
    for frame in range(STEPS):
        stamp = _FIRST_STAMP + round(frame * TIME_STEP * 1e9)
        seen = camera.observe()
        if seen.lines_camera is None or not seen.usable.all():
            break
        monitor.receive_pose(camera.T_world_camera, stamp)
        try:
            assessment = monitor.answer(seen, stamp, stamp)
        except PlsingError as error:
            # As the node does.
            assessment = monitor.unusable(str(error), stamp)
        if alert is None and assessment is not None and assessment.level in (Level.WARN, Level.CRITICAL):
            alert = frame
        error = seen.image_lines.ravel() - desired
        twist = -GAIN * np.linalg.lstsq(interaction_matrix(seen.lines_camera), error, rcond=1e-12)[0]
        speeds.append(float(np.linalg.norm(twist[:3])))
        if speeds[-1] > BLOW_UP * speeds[0]:
            break
        monitor.receive_twist(twist, stamp)
        camera.move(twist, TIME_STEP)
    lead = None if alert is None else (len(speeds) - 1 - alert) * TIME_STEP
    return _Run(speeds[-1] > BLOW_UP * speeds[0], max(speeds) / speeds[0], lead)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--tasks", type=int, default=TASKS)
    parser.add_argument("--noise", type=float, default=NOISE, help="on the Plücker coordinates of the lines")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    options = parser.parse_args()
    study(options.seed, options.tasks, options.noise, options.workers)
