# SPDX-License-Identifier: Apache-2.0
"""The four tasks by which visual servoing is compared: turns and shifts that are hard for one law or the other.

Source: Gans, Hutchinson and Corke, Performance tests for visual servo control systems, with application to partitioned
approaches to visual servo control (2003).
"""

from __future__ import annotations

import numpy as np

from benchmark.servo_conditions import Condition, SegmentTask, completed_task, looking, sees_enough, segments
from plsing_ros.geometry import Pose
from plsing_ros.geometry.rotations import exponential

MOTIONS = ("optical axis, turn", "optical axis, shift", "camera y, turn", "scene, turn")


def draw_motion(rng: np.random.Generator, condition: Condition, kind: int) -> SegmentTask:
    """Return a random task of one of the four kinds, with a generic scene."""
    while True:
        distance = float(rng.uniform(1.0, 4.0))
        direction = rng.normal(size=3)
        target = looking(rng, distance * direction / np.linalg.norm(direction), 0.05)
        ends = segments(rng, int(rng.integers(4, 13)), target.translation)
        start = target @ _from_target(rng, kind, distance)
        if sees_enough(ends, start) and sees_enough(ends, target):
            return completed_task(rng, condition, ends, start, target, False)


def _from_target(rng: np.random.Generator, kind: int, distance: float) -> Pose:
    """Return T_target_start."""
    sign, none = float(rng.choice([-1.0, 1.0])), np.zeros(3)
    if kind == 0:
        return Pose(exponential(np.array([0.0, 0.0, sign * np.radians(rng.uniform(20.0, 180.0))]))[0], none)
    if kind == 1:
        return Pose(np.eye(3), np.array([0.0, 0.0, -float(rng.uniform(0.2, 1.2))]))
    if kind == 2:
        return Pose(exponential(np.array([0.0, sign * np.radians(rng.uniform(5.0, 30.0)), 0.0]))[0], none)
    # About an axis through the scene's middle, parallel to the image's x axis.
    R, middle = (
        exponential(np.array([sign * np.radians(rng.uniform(10.0, 80.0)), 0.0, 0.0]))[0],
        np.array([0, 0, distance]),
    )
    return Pose(R, middle - R @ middle)
