"""Our own cost of one assessment with everything on, and memory over very many of them.

python3 -m benchmark monitor_status
python3 -m benchmark.monitor_status 1000000       # memory over a million cycles
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import resource
import sys
import tracemalloc
from collections.abc import Iterator

import numpy as np
from tqdm import tqdm

from benchmark.timing import median_seconds
from plsing_ros.features import LineObservation, interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import MonitorParameters
from plsing_ros.servoing.singularity_monitor import SingularityMonitor

GOAL = Pose(np.eye(3), np.array([0.0, 0.0, -5.0]))
START = Pose(np.eye(3), np.array([0.2, -0.1, -6.0]))
CYCLES = 100_000
_STEP = 40_000_000  # [ns]


def main() -> None:
    """Measure and print."""
    _cost()
    _memory(CYCLES)


def _task(n: int, goal_known: bool = True) -> tuple[SingularityMonitor, LineObservation, np.ndarray]:
    """Return a monitor, what a camera at START sees, and the twist that the plain law commands there."""
    generator = np.random.default_rng(n)
    lines = LineSet.from_points_directions(generator.normal(size=(n, 3)), generator.normal(size=(n, 3)))
    monitor = SingularityMonitor(
        MonitorParameters(
            lines_points=tuple(lines.point.ravel()),
            lines_directions=tuple(lines.direction.ravel()),
            target_known=goal_known,
            target_position=tuple(GOAL.translation),
        )
    )
    seen = lines.transformed(START.inverse(), "camera")
    error = project_lines(seen) - project_lines(lines.transformed(GOAL.inverse(), "camera"))
    twist = -0.1 * np.linalg.lstsq(interaction_matrix(seen), error, rcond=None)[0]
    return monitor, LineObservation.of_lines(seen), twist


def _cycles(n: int, with_pose: bool, with_twist: bool) -> Iterator[None]:
    monitor, observation, twist = _task(n)
    stamp = 10**9
    while True:
        if with_pose:
            monitor.receive_pose(START, stamp)
        monitor.assess(observation, stamp, stamp)
        if with_twist:
            monitor.receive_twist(twist, stamp)
        stamp += _STEP
        yield


def _cost() -> None:
    print("median of receive_pose, assess and receive_twist together [us]\n")
    print(f"{'lines':>6} {'pose, twist, goal':>18} {'pose':>8} {'no pose, twist, goal':>21}")
    for n in (4, 8, 20):
        everything, pose, features = _cycles(n, True, True), _cycles(n, True, False), _cycles(n, False, True)
        medians = median_seconds(
            {"all": lambda: next(everything), "pose": lambda: next(pose), "features": lambda: next(features)}
        )
        values = [1e6 * medians[name] for name in ("all", "pose", "features")]
        print(f"{n:6d} {values[0]:18.0f} {values[1]:8.0f} {values[2]:21.0f}")


def _memory(cycles: int) -> None:
    running = _cycles(4, True, True)
    for _ in range(1000):
        next(running)
    tracemalloc.start()
    for _ in range(1000):
        next(running)
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(1000):
        next(running)
    traced = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in tqdm(range(cycles), desc="memory", leave=False, mininterval=1.0):
        next(running)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak
    print(
        f"\nmemory: {traced} bytes more after 1000 further cycles (tracemalloc), peak of the process {grown} KiB "
        f"higher after {cycles} further cycles"
    )


if __name__ == "__main__":
    _cost()
    _memory(int(sys.argv[1]) if len(sys.argv) > 1 else CYCLES)
