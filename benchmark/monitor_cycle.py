# SPDX-License-Identifier: Apache-2.0
"""One cycle of the monitor node's callback, its first answer, steps rolled out a second, and chatter.

python3 -m benchmark monitor_cycle
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import dataclasses
import math
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from benchmark.alert_runs import watched_run
from benchmark.alert_settings import Setting, draw_setting, monitor_parameters
from benchmark.servo_conditions import Camera, Frame
from plsing_ros.monitoring.rollout import LoopModel, RolloutLaw, RolloutTask, RunState
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor

_SECOND = 1_000_000_000
_SEED, _RATE = 303, 30.0
_LINES = (4, 6, 12)
_CYCLES = 900
_LAWS = ("pinv", "dls", "adaptive_dls", "guarded", "position")
_STEPS = 24_000
_MISSING, _CHATTER_RUNS = 0.1, 40


def main(quick: bool = False) -> None:
    """Measure and print; quick: a fifth of the cycles and runs."""
    part = 5 if quick else 1
    for n in _LINES:
        print(_cycle_times(n, _CYCLES // part), flush=True)
    for law in _LAWS:
        print(_first_answer(law), flush=True)
    print(_rates(), flush=True)
    print(_chatter(_CHATTER_RUNS // part), flush=True)


def _settings(n: int = 0, law: str = "pinv") -> Iterator[Setting]:
    """Yield harmless settings in nominal conditions, of n lines if that is not 0."""
    number = 0
    while True:
        setting = draw_setting("nominal", _SEED, number)
        number += 1
        if setting.kind == "any" and (n == 0 or len(setting.task.ends) == n):
            yield dataclasses.replace(setting, law=law, rate=_RATE, chain=False, soft=False, limited=True)


def _cycle_times(n: int, cycles: int) -> str:
    """Return the times of what the node does with a message of n lines, paced as frames come."""
    from plsing_ros.nodes.conversions import features_message, header, observation_from_message, status_message

    setting = next(_settings(n))
    generator = np.random.default_rng(1)
    camera = Camera(setting.task, setting.condition, generator)
    frames: list[Frame] = [camera.frame(setting.task.start) for _ in range(50)]
    with ThreadPoolExecutor(1) as executor:
        parameters = monitor_parameters(setting)
        monitor = SingularityMonitor.from_parameters(parameters, executor)
        messages = [features_message(each.observation, header(0, parameters.camera_frame)) for each in frames]
        times, spent, due = [], [], time.perf_counter()
        for cycle in range(cycles):
            frame, message = frames[cycle % 50], messages[cycle % 50]
            stamp = _SECOND + round(cycle / _RATE * _SECOND)
            due += 1.0 / _RATE
            time.sleep(max(due - time.perf_counter(), 0.0))
            start, before = time.perf_counter(), time.thread_time()
            monitor.receive_pose(frame.T_world_camera, stamp, frame.covariance)
            observation = observation_from_message(message, parameters.camera_frame)
            assessment = monitor.answer(observation, stamp, stamp)
            assert assessment is not None
            status_message(assessment, monitor.singular_set, parameters.camera_frame)
            monitor.receive_twist(np.full(6, 1e-2), stamp)
            times.append(1e3 * (time.perf_counter() - start))
            spent.append(1e3 * (time.thread_time() - before))
    (median, late), (used, most) = (np.quantile(each[10:], [0.5, 0.99]) for each in (times, spent))
    return (
        f"cycle, {n} lines: median {median:.3f} ms, 99 % {late:.3f} ms; "
        f"of the callback's processor time {used:.3f} and {most:.3f} ms"
    )


def _first_answer(law: str) -> str:
    """Return how long after the first features the first risk is there, over some tasks of the smallest gain."""
    found = []
    settings = _settings(law=law)
    for _ in range(10):
        setting = next(settings)
        setting = dataclasses.replace(setting, task=dataclasses.replace(setting.task, gain=0.1))
        camera = Camera(setting.task, setting.condition, np.random.default_rng(1))
        with ThreadPoolExecutor(1) as executor:
            monitor = SingularityMonitor.from_parameters(monitor_parameters(setting), executor)
            start, frame = time.perf_counter(), 0
            while True:
                stamp = _SECOND + round(frame / _RATE * _SECOND)
                seen = camera.frame(setting.task.start)
                monitor.receive_pose(seen.T_world_camera, stamp, seen.covariance)
                assessment = monitor.answer(seen.observation, stamp, stamp)
                if assessment is not None and assessment.risk is not None:
                    found.append(time.perf_counter() - start)
                    break
                frame += 1
                time.sleep(max(start + frame / _RATE - time.perf_counter(), 0.0))
    return f"first answer, {law}, gain 0.1: median {np.median(found):.3f} s, largest {max(found):.3f} s"


def _rates() -> str:
    """Return steps a second of each law at six lines, without and with noise, latency, lag and field of view."""
    lines = []
    setting = next(_settings(6))
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
        setting = dataclasses.replace(draw_setting("nominal", _SEED, number), missing=_MISSING)
        record = watched_run(setting, "nominal", _SEED, number)
        length = record.frames / record.rate / 60.0
        changes, minutes = changes + record.changes, minutes + length
        worst = max(worst, record.changes / max(length, 1.0))
    return (
        f"chatter with {100 * _MISSING:g} % of detections missing: {changes} changes in {minutes:.1f} min of {count} "
        f"runs, {changes / minutes:.2f} a minute; {worst:.0f} in the worst minute"
    )
