# SPDX-License-Identifier: Apache-2.0
"""The paper's scenes and the numbers it prints about them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet

# Eq. params: s1 to s6 and d1 to d5; eq. sims_5lines_params adds s7, s8, d6, and one of two values of d7.
S_FOUR, D_FOUR = (4.0, -5.0, 7.0, 3.0, -2.0, 13.0), (2.0, 3.0, 5.0, 1.0, 7.0)
S_FIVE, D_SIX = (*S_FOUR, -11.0, 6.0), (*D_FOUR, -4.0)
GENERIC_D7 = 11.0
SPECIAL_D7 = 128893236 / 7630285 - 24 * np.sqrt(8508173023861) / 7630285

# Eq. sims_P4L_transversal_lines: direction, and moment as u x x (docs/conventions.md).
PRINTED_L_M = (0.0830, 0.4989, -0.8627, 0.0, -0.9641, -0.5575)
PRINTED_L_N = (0.2067, -0.03902, -0.9776, 0.0, -0.3509, 0.01401)

# Table exVHK, all sixteen rows; those with an asterisk are isolated.
TABLE_OF_POINTS: tuple[tuple[bool, tuple[float, float, float]], ...] = (
    (True, (-9.858, -2.473, -1.841)),
    (False, (-0.720, 0.0, 0.0)),
    (True, (-0.320, 0.010, 0.220)),
    (False, (-0.007, 0.009, 2.0)),
    (True, (0.054, 0.009, 1.842)),
    (False, (0.328, 0.0, 0.0)),
    (False, (0.918, 0.141, -2.082)),
    (True, (0.938, 0.568, -2.023)),
    (False, (0.972, -1.215, 2.0)),
    (True, (1.011, 0.794, -0.885)),
    (False, (1.016, 0.371, -1.984)),
    (False, (1.218, 0.390, -0.918)),
    (False, (3.231, 0.0, 0.0)),
    (False, (3.880, 7.054, 0.880)),
    (True, (65.09, -96.57, -0.036)),
    (False, (90.31, -112.9, 2.0)),
)


def lines_of_parameters(s: Sequence[float], d: Sequence[float]) -> LineSet:
    """Return the lines of eq. param, param_l4 and param_l5: three, four or five, as many as there are parameters.

    Args:
        s: s1 to s4, s6 or s8.
        d: d1 to d3, d5 or d7 [m].
    """
    points = [[0.0, 0.0, 0.0], [0.0, 0.0, d[0]], [d[1], d[2], 0.0]]
    directions = [[1.0, 0.0, 0.0], [s[0], s[1], 0.0], [d[1], s[2], s[3]]]
    if len(s) > 4:
        points.append([0.0, d[3], d[4]])
        directions.append([s[4], d[3], s[5]])
    if len(s) > 6:
        points.append([d[5], 0.0, d[6]])
        directions.append([s[6], s[7], d[6]])
    return LineSet.from_points_directions(points, directions)


def orthogonal_and_parallel_lines(d: Sequence[float]) -> LineSet:
    """Return the lines of eq. param2 for d1 to d5, with the fifth of eq. param_5lines for d1 to d7 [m]."""
    points = [[0.0, 0.0, 0.0], [0.0, 0.0, d[0]], [d[1], d[2], 0.0], [0.0, d[3], d[4]]]
    directions = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    if len(d) > 5:
        points.append([d[5], 0.0, d[6]])
        directions.append([0.0, 1.0, 0.0])
    return LineSet.from_points_directions(points, directions)


def three_lines() -> LineSet:
    """Return the first three of the paper's four lines."""
    return lines_of_parameters(S_FOUR[:4], D_FOUR[:3])


def four_lines() -> LineSet:
    """Return the four lines of section "Singularities in P4L" of the simulations."""
    return lines_of_parameters(S_FOUR, D_FOUR)


def five_lines(d7: float = SPECIAL_D7) -> LineSet:
    """Return the five lines of section "Singularities in P5L" of the simulations; with d7 = 11 those of Appendix B."""
    return lines_of_parameters(S_FIVE, (*D_SIX, d7))


def plucker(point: Array, direction: Array) -> Array:
    """Return (u, u x x) of a line through x along u, shape (6,), as the paper prints transversals."""
    return np.concatenate([direction, np.cross(direction, point)])
