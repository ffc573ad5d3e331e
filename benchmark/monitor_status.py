# SPDX-License-Identifier: Apache-2.0
"""Our own cost of one assessment with everything on, and memory over very many of them.

python3 -m benchmark monitor_status
python3 -m benchmark.monitor_status --cycles 1000000
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import functools
import itertools
import resource
import tracemalloc
from collections.abc import Iterator

import numpy as np
from tqdm import tqdm

from benchmark.timing import median_seconds
from plsing_ros.features import LineObservation, interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters import MonitorParameters

TARGET = Pose(np.eye(3), np.array([0.0, 0.0, -5.0]))
START = Pose(np.eye(3), np.array([0.2, -0.1, -6.0]))
CYCLES = 100_000
_STEP = 40_000_000  # [ns]
_FRAMES = 200


def main() -> None:
    """Measure and print."""
    _cost()
    _memory(CYCLES)


def _monitor(lines: LineSet, target_known: bool) -> SingularityMonitor:
    return SingularityMonitor.from_parameters(
        MonitorParameters(
            lines_points=tuple(lines.point.ravel()),
            lines_directions=tuple(lines.direction.ravel()),
            target_known=target_known,
            target_position=tuple(TARGET.translation),
        )
    )


def _run(lines: LineSet) -> list[tuple[Pose, LineObservation, np.ndarray]]:
    """Return pose, what the camera sees and the plain law's twist, frame by frame on the path from START."""
    target_image = project_lines(lines.transformed(TARGET.inverse(), "camera"))
    pose, frames = START, []
    for _ in range(_FRAMES):
        seen = lines.transformed(pose.inverse(), "camera")
        twist = -0.1 * np.linalg.lstsq(interaction_matrix(seen), project_lines(seen) - target_image, rcond=None)[0]
        frames.append((pose, LineObservation.of_lines(seen), twist))
        pose = pose.integrate(twist, _STEP / 1e9)
    return frames


def _cycles(n: int, with_pose: bool, with_twist: bool, target_known: bool = True) -> Iterator[None]:
    """Yield after each cycle; the run begins anew when it is over, which the monitor sees as a jump of the camera."""
    generator = np.random.default_rng(n)
    lines = LineSet.from_points_directions(generator.normal(size=(n, 3)), generator.normal(size=(n, 3)))
    monitor, stamp = _monitor(lines, target_known), 10**9
    for pose, observation, twist in itertools.cycle(_run(lines)):
        if with_pose:
            monitor.receive_pose(pose, stamp)
        assessment = monitor.answer(observation, stamp, stamp)
        if assessment is not None:
            # As whoever listens to the status does: words are made when they are read.
            assert assessment.reason is not None and assessment.unobservable_motion_text is not None
        if with_twist:
            monitor.receive_twist(twist, stamp)
        stamp += _STEP
        yield


def _cost() -> None:
    print("receive_pose, assess and receive_twist together [us]\n")
    print(f"{'lines':>6} {'pose, twist, target':>18} {'target not known':>15} {'no pose':>8} {'pose only':>10}")
    for n in (4, 8, 20):
        ways = [(True, True, True), (True, True, False), (False, True, True), (True, False, False)]
        running = [_cycles(n, *way) for way in ways]
        medians = median_seconds({str(i): functools.partial(next, each) for i, each in enumerate(running)})
        everything, unknown, features, pose = (1e6 * medians[str(i)] for i in range(len(ways)))
        print(f"{n:6d} {everything:18.0f} {unknown:15.0f} {features:8.0f} {pose:10.0f}")


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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=CYCLES, help="of the memory check (default: %(default)s)")
    options = parser.parse_args()
    _cost()
    _memory(options.cycles)
