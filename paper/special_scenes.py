# SPDX-License-Identifier: Apache-2.0
"""An example of each row of the table of cases, and scenes of orthogonal and parallel lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from paper.scenes import (
    D_FOUR,
    GENERIC_D7,
    S_FOUR,
    five_lines,
    four_lines,
    lines_of_parameters,
    orthogonal_and_parallel_lines,
    three_lines,
)
from plsing_ros.geometry import LineSet
from plsing_ros.singularities import Case, Kind, SingularSet, singular_set


@dataclass(frozen=True, eq=False)
class CaseExample:
    """A scene for a row of the table of cases.

    Attributes:
        row: The paper's words.
        scene: Which one, in words.
        lines: The scene.
        case: The case that it must be found to be.
        transversals: How many single lines must be found.
        max_points: The largest number of real isolated points that the row allows.
        surfaces: Which whole surfaces must be found.
    """

    row: str
    scene: str
    lines: LineSet
    case: Case
    transversals: int
    max_points: int
    surfaces: tuple[Kind, ...] = ()


def case_examples() -> tuple[CaseExample, ...]:
    """Return an example of each row of the paper's table of cases."""
    three = three_lines()
    return (
        CaseExample(
            "P3L, three skew lines: hyperboloid and cubic surface",
            "the paper's first three lines",
            three,
            Case.P3L_SKEW,
            0,
            0,
            (Kind.QUADRIC, Kind.CUBIC),
        ),
        CaseExample(
            "P4L, hyperbolic congruence: two lines, up to 10 points",
            "the paper's four lines",
            four_lines(),
            Case.P4L_HYPERBOLIC,
            2,
            10,
        ),
        CaseExample(
            "P4L, parabolic congruence: one line, up to 10 points",
            "its first three, and one that touches their hyperboloid",
            _with_a_tangent(three),
            Case.P4L_PARABOLIC,
            1,
            10,
        ),
        CaseExample(
            "P4L, elliptic congruence: up to 10 points",
            "the paper's with s6 = -13",
            lines_of_parameters((*S_FOUR[:5], -13.0), D_FOUR),
            Case.P4L_ELLIPTIC,
            0,
            10,
        ),
        CaseExample(
            "P4L with orthogonality and parallelism: two lines",
            "d = (2, 3, 5, 1, 7)",
            orthogonal_and_parallel_lines(D_FOUR),
            Case.P4L_ORTHOGONAL_PARALLEL,
            2,
            0,
        ),
        CaseExample(
            "P5L, regular linear complex: none",
            "Appendix B, d7 = 11",
            five_lines(GENERIC_D7),
            Case.P5L_REGULAR,
            0,
            0,
        ),
        CaseExample(
            "P5L, singular linear complex: a line", "Appendix B, special d7", five_lines(), Case.P5L_SINGULAR, 1, 0
        ),
        CaseExample(
            "P5L with orthogonality and parallelism: none",
            "d = (2, 3, 5, 1, 7, -4, 11)",
            orthogonal_and_parallel_lines((*D_FOUR, -4.0, 11.0)),
            Case.P5L_ORTHOGONAL_PARALLEL,
            0,
            0,
        ),
    )


def agrees(example: CaseExample, singular: SingularSet) -> bool:
    """Return whether what was found is what the row says."""
    return (
        singular.case is example.case
        and len(singular.transversals) == example.transversals
        and len(singular.isolated_points) <= example.max_points
        and tuple(surface.kind for surface in singular.surfaces) == example.surfaces
        and not singular.singular_everywhere
    )


def special_orthogonal_scenes() -> tuple[tuple[str, tuple[float, ...], Sequence[float], Sequence[float]], ...]:
    """Return scenes of orthogonal and parallel lines: name, d1, d2, ..., point and direction of the paper's line."""
    d1, d2, d3, d4, d5 = D_FOUR
    d6, d7 = -4.0, 11.0
    slope = d1 * d4 - d3 * d5
    # The third factor of h is zero for this d2.
    third = (d1 * d4 * d6 - d3 * d5 * d6) / (d4 * (d1 - d7))
    return (
        ("P4L, M: Z = d1, Y = d3", D_FOUR, (0.0, d3, d1), (1.0, 0.0, 0.0)),
        (
            "P4L, N: Y d5 = Z d4, X (d1 d4 - d3 d5) + Y d2 d5 = d1 d2 d4",
            D_FOUR,
            (d1 * d2 * d4 / slope, 0.0, 0.0),
            (-d2 * d5 / slope, 1.0, d5 / d4),
        ),
        ("P5L, d5 = 0, M1: Z = 0, X = d2", (d1, d2, d3, d4, 0.0, d6, d7), (d2, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ("P5L, d7 = d1, M2: Z = d1, Y = d3", (*D_FOUR, d6, d1), (0.0, d3, d1), (1.0, 0.0, 0.0)),
        (
            "P5L, third factor zero, M3: Y d5 = Z d4, X (d1 - d7) + Z d6 = d1 d6",
            (d1, third, d3, d4, d5, d6, d7),
            (d1 * d6 / (d1 - d7), 0.0, 0.0),
            (-d6 / (d1 - d7), d4 / d5, 1.0),
        ),
    )


def _with_a_tangent(three: LineSet) -> LineSet:
    """Return three lines and a fourth that touches their hyperboloid without being in it."""
    quadric = singular_set(three).surfaces[0]
    # Any point of the surface will do, and any direction across its normal that is not that of a line in it.
    point = quadric.nearest_point([1.0, 2.0, 3.0])
    normal = quadric.gradient(point[np.newaxis])[0]
    direction = np.cross(normal, [1.0, 2.0, 4.0])
    direction /= np.linalg.norm(direction)
    points, directions = np.vstack([three.point, point]), np.vstack([three.direction, direction])
    return LineSet.from_points_directions(points, directions, three.frame)
