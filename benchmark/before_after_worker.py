# SPDX-License-Identifier: Apache-2.0
"""Measures one work tree for benchmark/before_after.py: a candidate's name comes in, the time of one call goes out.

It runs in both trees, and names what both have alike.
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

# The benchmarks of the tree, not those beside this file.
sys.path[0] = sys.argv[1]

control_cycle = importlib.import_module("benchmark.control_cycle")
geometry = importlib.import_module("plsing_ros.geometry")
features = importlib.import_module("plsing_ros.features")
pose = importlib.import_module("plsing_ros.pose")
singularities = importlib.import_module("plsing_ros.singularities")

BATCH = 50
# Calls in a row: long enough for the clock, short enough for the trees to take turns.
CALLS = {"pose": 10, "singular": 10, "eigenproblem": 10, "batch": 1}


def candidates() -> dict[str, Callable[[], object]]:
    """Return what can be measured."""
    every: dict[str, Callable[[], object]] = {}
    for n in (4, 20):
        own = control_cycle._own(_lines(n))
        every.update({f"{name} {n}": own[name] for name in ("core", "step", "input", "monitor")})
    for n in (4, 8):
        lines = _lines(n)
        estimator = pose.PoseEstimator(lines)
        seen = features.LineObservation.of_lines(lines.transformed(control_cycle.START.inverse(), "camera"))
        every[f"pose {n}"] = lambda estimator=estimator, seen=seen: estimator.estimate(seen)
    points, directions = np.random.default_rng(1).normal(size=(2, BATCH, 4, 3))
    one = geometry.LineSet.from_points_directions(points[0], directions[0])
    every["singular set"] = lambda: singularities.singular_set(one)
    every["batch"] = lambda: singularities.solve_four_line_scenes(points, directions)
    square = np.random.default_rng(0).normal(size=(20, 20))
    every["eigenproblem"] = lambda: np.linalg.eig(square)
    return every


def _lines(n: int) -> object:
    generator = np.random.default_rng(n)
    return geometry.LineSet.from_points_directions(generator.normal(size=(n, 3)), generator.normal(size=(n, 3)))


def main() -> None:
    """Answer until the input ends."""
    assert Path(sys.modules["plsing_ros"].__file__).is_relative_to(sys.argv[1])
    every = candidates()
    for line in sys.stdin:
        name = line.strip()
        calls, call = CALLS.get(name.split()[0], 50), every[name]
        # What the other tree has left in the caches is not this one's cost.
        call()
        start = time.perf_counter()
        for _ in range(calls):
            call()
        seconds = (time.perf_counter() - start) / calls
        print(seconds / BATCH if name == "batch" else seconds, flush=True)


if __name__ == "__main__":
    main()
