# SPDX-License-Identifier: Apache-2.0
"""What the monitor's callbacks take of each frame, its first answer, steps rolled out a second, and chatter.

python3 -m benchmark monitor_cycle
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import dataclasses
import math
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from benchmark import monitor_callback
from benchmark.alert_runs import watched_run
from benchmark.alert_settings import draw_setting, monitor_parameters
from benchmark.monitor_settings import RATE, SEED, settings
from benchmark.servo_conditions import DisturbedCamera
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.planning.rollout import LoopModel, RolloutLaw, RolloutTask, RunState

_SECOND = 1_000_000_000
_LAWS = ("pinv", "dls", "adaptive_dls", "guarded", "position")
_STEPS = 24_000
_MISSING, _CHATTER_RUNS = 0.1, 40


def main(quick: bool = False) -> None:
    """Measure and print; quick: a fifth of the cycles and runs."""
    part = 5 if quick else 1
    monitor_callback.main(quick)
    for law in _LAWS:
        print(_first_answer(law), flush=True)
    print(_rates(), flush=True)
    print(_chatter(_CHATTER_RUNS // part), flush=True)


def _first_answer(law: str) -> str:
    """Return how long after the first features the first risk is there, over some tasks of the smallest gain."""
    found = []
    drawn = settings(law=law)
    for _ in range(10):
        setting = next(drawn)
        setting = dataclasses.replace(setting, task=dataclasses.replace(setting.task, gain=0.1))
        camera = DisturbedCamera(setting.task, setting.condition, np.random.default_rng(1))
        with ThreadPoolExecutor(1) as executor:
            monitor = SingularityMonitor.from_parameters(monitor_parameters(setting), executor)
            start, frame = time.perf_counter(), 0
            while True:
                stamp = _SECOND + round(frame / RATE * _SECOND)
                seen = camera.frame(setting.task.start)
                monitor.receive_pose(seen.T_world_camera, stamp, seen.covariance)
                assessment = monitor.answer(seen.observation, stamp, stamp)
                monitor.begin_rollout()
                if assessment is not None and assessment.risk is not None:
                    found.append(time.perf_counter() - start)
                    break
                frame += 1
                time.sleep(max(start + frame / RATE - time.perf_counter(), 0.0))
    return f"first answer, {law}, gain 0.1: median {np.median(found):.3f} s, largest {max(found):.3f} s"


def _rates() -> str:
    """Return steps a second of each law at six lines, without and with noise, latency, lag and field of view."""
    lines = []
    setting = next(settings(6))
    task = setting.task
    parameters = monitor_parameters(setting)
    noisy = LoopModel(
        latency=1,
        lag=0.05,
        image_noise=parameters.image_noise,
        position_noise=parameters.pose_position_noise,
        rotation_noise=parameters.pose_rotation_noise,
        half_view=(parameters.half_view[0], parameters.half_view[1]),
        horizon=60.0,
        stops=False,
    )
    for law in _LAWS:
        rates = []
        for loop in (LoopModel(horizon=60.0, stops=False), noisy):
            rollout = RolloutTask(task.map, task.target, RolloutLaw(law, gain=0.1), loop, task.map_ends)
            samples = _STEPS // 1800
            best = 0.0
            for seed in range(5):
                start = time.thread_time()
                found = rollout.roll_out([task.start] * samples, RunState(math.inf, 1e3), seed)
                best = max(best, found.steps / (time.thread_time() - start))
            rates.append(best)
        lines.append(f"roll-out, {law}: {rates[0]:,.0f} steps a second of processor time, {rates[1]:,.0f} with noise")
    return "\n".join(lines)


def _chatter(count: int) -> str:
    """Return how often the level changes when each line is missing in a tenth of the frames."""
    changes, minutes, worst = 0, 0.0, 0.0
    for number in range(count):
        setting = dataclasses.replace(draw_setting("nominal", SEED, number), missing=_MISSING)
        record = watched_run(setting, "nominal", SEED, number)
        length = record.frames / record.rate / 60.0
        changes, minutes = changes + record.changes, minutes + length
        worst = max(worst, record.changes / max(length, 1.0))
    return (
        f"chatter with {100 * _MISSING:g} % of detections missing: {changes} changes in {minutes:.1f} min of {count} "
        f"runs, {changes / minutes:.2f} a minute; {worst:.0f} in the worst minute"
    )
