# SPDX-License-Identifier: Apache-2.0
"""Resident memory of what the nodes do in a cycle, over very many cycles: does it grow?

The cores of controller (each law) and pose_estimator answer frames of a camera that moves to and fro before the paper's
four lines, with noise, now and then a frame that contradicts or that no line is seen in, each core in a process of its
own. That of the monitor: benchmark monitor_status; of the nodes: benchmark node_memory.

    python3 -m benchmark memory
    python3 -m benchmark.memory --cycles 1000000
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters import PoseEstimatorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.pose.pose_tracker import PoseTracker
from plsing_ros.simulation import near_transversal

CYCLES = 100_000
CORES = ("pinv", "dls", "guarded", "detour", "position", "fused", "pose_estimator")
_FRAMES = 500
_PERIOD = 33_333_333  # [ns]
_NOISE = 5e-4

Answer = Callable[[LineObservation, int], object]


def main(quick: bool = False) -> None:
    """Print the table."""
    measure(CYCLES // 20 if quick else CYCLES)


def measure(cycles: int, names: Sequence[str] = CORES) -> None:
    """Print resident memory of some cores after a tenth, half and all of the cycles."""
    print("| core | cycles | MB after a tenth | half | all | kB a thousand cycles |\n|---|---|---|---|---|---|")
    for name in names:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            first, half, last = pool.apply(_run, (name, cycles))
        growth = (last - half) / (0.5 * cycles) * 1e6
        print(f"| {name} | {cycles} | {first:.1f} | {half:.1f} | {last:.1f} | {growth:.2f} |", flush=True)


def _run(name: str, cycles: int) -> tuple[float, float, float]:
    frames, answer = _frames(), _core(name)
    sizes = {}
    for k in range(cycles):
        with contextlib.suppress(PlsingError):
            answer(frames[k % _FRAMES], 10**12 + k * _PERIOD)
        if k + 1 in (cycles // 10, cycles // 2, cycles):
            sizes[k + 1] = resident()
    return tuple(sizes.values())  # type: ignore[return-value]


def _core(name: str) -> Answer:
    lines = read_scene(config_file("paper_p4l.yaml"))
    target = Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION)
    if name != "pose_estimator":
        servo = ServoController(lines, target, law=name)
        return lambda seen, stamp: servo.answer(seen, stamp, stamp)
    values = {"lines.points": lines.point.ravel().tolist(), "lines.directions": lines.direction.ravel().tolist()}
    tracker = PoseTracker(PoseEstimatorParameters.from_values(values))
    return lambda seen, stamp: tracker.track(seen, stamp, stamp)


def _frames() -> list[LineObservation]:
    rng = np.random.default_rng(1)
    lines = read_scene(config_file("paper_p4l.yaml"))
    start = Pose.from_quaternion([0.9962, -4.437, 7.8], near_transversal.ORIENTATION)
    frames = []
    for k in range(_FRAMES):
        there = 0.1 * np.sin(2.0 * np.pi * k / _FRAMES) * np.array([1.0, 0.5, -0.5])
        camera = Pose(start.rotation, start.translation + there)
        right = LineObservation.of_lines(lines.transformed(camera.inverse(), "camera"))
        image = right.image_lines + np.array([0.0, 0.0, _NOISE]) * rng.normal(size=right.image_lines.shape)
        usable = np.ones(len(lines), dtype=bool)
        if k % 100 == 50:
            image = image * [1.0, 1.0, 500.0]
        if k % 100 == 75:
            usable[:] = False
        frames.append(LineObservation(lines.ids, image, usable, right.lines_camera if usable.all() else None))
    return frames


def resident(process: int | str = "self") -> float:
    """Return the resident memory of a process [MB]."""
    status = Path(f"/proc/{process}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024.0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=CYCLES)
    parser.add_argument("--cores", nargs="+", metavar="CORE", choices=CORES, default=CORES)
    options = parser.parse_args()
    measure(options.cycles, options.cores)
