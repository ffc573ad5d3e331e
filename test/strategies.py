# SPDX-License-Identifier: Apache-2.0
"""Values that hypothesis draws: poses, lines, twists. They are values, not seeds, so that failures shrink."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from plsing_ros.geometry import LineSet, Pose


def numbers(low: float = -10.0, high: float = 10.0) -> st.SearchStrategy[float]:
    """Finite numbers without subnormals, which no camera ever sees."""
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


def vectors(size: int = 3, low: float = -10.0, high: float = 10.0) -> st.SearchStrategy[np.ndarray]:
    return st.lists(numbers(low, high), min_size=size, max_size=size).map(np.array)


def directions() -> st.SearchStrategy[np.ndarray]:
    return vectors().filter(lambda v: np.linalg.norm(v) > 1e-2)


def poses() -> st.SearchStrategy[Pose]:
    rotations = vectors(3, -3.0, 3.0).map(lambda v: Rotation.from_rotvec(v).as_matrix())
    return st.builds(Pose, rotations, vectors())


def twists() -> st.SearchStrategy[np.ndarray]:
    return vectors(6, -2.0, 2.0)


@st.composite
def seen_lines(draw: st.DrawFn, min_size: int = 1, max_size: int = 8) -> LineSet:
    """Lines in the camera's frame that all have an image, 0.18 m or more from degenerate: made so, not filtered."""
    n = draw(st.integers(min_size, max_size))
    direction, moment = [], []
    for _ in range(n):
        around, up, turn = draw(numbers(-3.1, 3.1)), draw(numbers(-1.2, 1.2)), draw(numbers(-3.1, 3.1))
        normal = np.array([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)])
        across = np.array([-np.sin(around), np.cos(around), 0.0])
        direction.append(np.cos(turn) * across + np.sin(turn) * np.cross(normal, across))
        moment.append(draw(numbers(0.5, 10.0)) * normal)
    return LineSet(np.array(direction), np.array(moment), "camera")


@st.composite
def line_sets(draw: st.DrawFn, min_size: int = 1, max_size: int = 8) -> LineSet:
    n = draw(st.integers(min_size, max_size))
    points = [draw(vectors()) for _ in range(n)]
    return LineSet.from_points_directions(points, [draw(directions()) for _ in range(n)])
