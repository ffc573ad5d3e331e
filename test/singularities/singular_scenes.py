# SPDX-License-Identifier: Apache-2.0
"""Scenes of the paper and special scenes, as integer points and directions, and checks that use no solver."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from plsing_ros.features import rank_basis
from plsing_ros.geometry import LineSet
from plsing_ros.singularities.bilinear_system import bilinear_tensor, newton
from plsing_ros.singularities.scene_frame import SceneFrame


def paper_lines(s, d):
    """Points and directions of eq. param, param_l4 and param_l5, as many lines as there are parameters."""
    s = [None, *s]
    d = [None, *d]
    points = [[0, 0, 0], [0, 0, d[1]], [d[2], d[3], 0]]
    directions = [[1, 0, 0], [s[1], s[2], 0], [d[2], s[3], s[4]]]
    if len(s) > 5:
        points.append([0, d[4], d[5]])
        directions.append([s[5], d[4], s[6]])
    if len(s) > 7:
        points.append([d[6], 0, d[7]])
        directions.append([s[7], s[8], d[7]])
    return points, directions


def orthogonal_lines(d):
    """Points and directions of eq. param2 and param_5lines: four lines for five parameters, five for seven."""
    d = [None, *d]
    points = [[0, 0, 0], [0, 0, d[1]], [d[2], d[3], 0], [0, d[4], d[5]]]
    directions = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0]]
    if len(d) > 6:
        points.append([d[6], 0, d[7]])
        directions.append([0, 1, 0])
    return points, directions


PAPER_S4, PAPER_D4 = (4, -5, 7, 3, -2, 13), (2, 3, 5, 1, 7)
PAPER_FOUR = paper_lines(PAPER_S4, PAPER_D4)
# The six of the appendix's table with a star, to the digits of eq. 4linessims_isolated_points.
PAPER_POINTS = np.array(
    [
        [-9.858, -2.473, -1.841],
        [0.0541, 0.0092, 1.8422],
        [-0.3203, 0.0105, 0.2205],
        [1.0113, 0.7947, -0.8850],
        [0.9387, 0.5681, -2.0225],
        [65.09, -96.57, -0.03639],
    ]
)


def box_edges():
    """The twelve edges of a box."""
    points, directions = [], []
    for axis in range(3):
        first, second = (i for i in range(3) if i != axis)
        for corner in range(4):
            point = [0.0, 0.0, 0.0]
            point[first], point[second] = 1.5 * (corner & 1), 0.8 * (corner >> 1)
            points.append(point)
            directions.append(np.eye(3)[axis])
    return points, directions


def line_set(scene, **options):
    return LineSet.from_points_directions(np.array(scene[0], dtype=float), np.array(scene[1], dtype=float), **options)


def min_ratio(lines, center):
    """Smallest over largest singular value of the row-normalised xi, in the unit of the lines; no solver code."""
    values = np.linalg.svd(rank_basis(lines, center, normalized=True), compute_uv=False)
    return values[-1] / values[0]


def distance_to_line(point, line_point, direction):
    offset = np.asarray(point) - line_point
    direction = np.asarray(direction) / np.linalg.norm(direction)
    return np.linalg.norm(offset - (offset @ direction) * direction)


def same_points(first, second, tolerance):
    """Whether two sets of points agree one to one, whatever their order."""
    first, second = np.asarray(first), np.asarray(second)
    if first.shape != second.shape:
        return False
    left = list(range(len(second)))
    for point in first:
        if not left:
            return False
        nearest = min(left, key=lambda i: np.abs(second[i] - point).max())
        if np.abs(second[nearest] - point).max() > tolerance * (1.0 + np.abs(point).max()):
            return False
        left.remove(nearest)
    return True


def integers(low=-9, high=9):
    return st.integers(low, high)


def nonzero(low=-9, high=9):
    return integers(low, high).filter(bool)


@st.composite
def integer_scenes(draw, n=4):
    """Integer points and directions; special positions are as likely as small integers make them."""
    vector = st.lists(integers(), min_size=3, max_size=3)
    return [draw(vector) for _ in range(n)], [draw(vector.filter(any)) for _ in range(n)]


def singular_centers(lines, starts=300):
    """Real finite centres on no line at which a motion is lost, found by Gauss and Newton's method from anywhere."""
    frame = SceneFrame.of(lines)
    generator = np.random.default_rng(0)
    tensor = bilinear_tensor(frame.direction[np.newaxis], frame.point[np.newaxis]).astype(complex)
    h, k = (generator.normal(size=(starts, size)).astype(complex) for size in (4, 6))
    h[:, 0] = 1.0
    h, _ = newton(tensor, np.zeros(starts, dtype=int), h, k, steps=60, small=1e-12)
    near = np.abs(h[:, 0]) > 1e-3
    centers = frame.from_scene((h[near, 1:] / h[near, :1]).real)
    away = [min(map(distance_to_line, [c] * len(lines), lines.point, lines.direction)) for c in centers]
    good = [a > 1e-3 * frame.length and min_ratio(lines, c) < 1e-9 for c, a in zip(centers, away, strict=True)]
    return centers[np.array(good, dtype=bool)]
