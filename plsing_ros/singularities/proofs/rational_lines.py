# SPDX-License-Identifier: Apache-2.0
"""The lines with small rational coordinates whose rounding given lines are: only for these exact arithmetic pays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet

# Denominators of ratios of direction components and of moments that are looked for.
_DENOMINATOR = 10_000
# Larger integers make the exact computation of ten points take longer than seconds.
_LARGEST = 10**6
# Rounding errors of direction and moment, in units of the last place.
_ULPS = 16.0


@dataclass(frozen=True)
class RationalLines:
    """n lines with rational coordinates.

    Attributes:
        points: A point on each, rational, n x 3.
        directions: Integer directions without common divisor and without orientation (the largest component is
            positive), n x 3.
    """

    points: tuple[tuple[Fraction, ...], ...]
    directions: tuple[tuple[int, ...], ...]

    def select(self, rows: list[int]) -> RationalLines:
        """Return the lines of the given rows."""
        return RationalLines(tuple(self.points[i] for i in rows), tuple(self.directions[i] for i in rows))


def rational_lines(lines: LineSet) -> RationalLines | None:
    """Return the rational lines that the doubles of lines are within rounding of; None if one has no small numbers.

    Ratios of direction components with a denominator up to 10,000 are so sparse that lines that were not made from
    such numbers pass for them with a probability below 1e-6.
    """
    points, directions = [], []
    for row in range(len(lines)):
        found = _rational_line(lines.direction[row, :], lines.moment[row, :])
        if found is None:
            return None
        points.append(found[0])
        directions.append(found[1])
    return RationalLines(tuple(points), tuple(directions))


def _rational_line(u: Array, moment: Array) -> tuple[tuple[Fraction, ...], tuple[int, ...]] | None:
    largest = u[np.argmax(np.abs(u))]
    ratios = _rational(u / largest, 1.0)
    if ratios is None:
        return None
    scale = math.lcm(*(ratio.denominator for ratio in ratios))
    direction = tuple(int(ratio * scale) for ratio in ratios)
    square = sum(value * value for value in direction)
    # The moment for the integer direction, which is rational where the moment for the unit direction is not.
    size = math.copysign(math.sqrt(square), largest)
    exact = _rational(moment * size, float(np.abs(moment).max()) * abs(size))
    if exact is None or sum(a * b for a, b in zip(direction, exact, strict=True)) != 0:
        return None
    (a, b, c), (x, y, z) = direction, exact
    point = (Fraction(b * z - c * y) / square, Fraction(c * x - a * z) / square, Fraction(a * y - b * x) / square)
    if max(map(abs, direction)) > _LARGEST or max(abs(value.numerator) for value in exact) > _LARGEST:
        return None
    return point, direction


def _rational(values: Array, size: float) -> tuple[Fraction, ...] | None:
    """Return fractions with small denominators within rounding of numbers of a size; None if there are none."""
    fractions = tuple(Fraction(value).limit_denominator(_DENOMINATOR) for value in values.tolist())
    allowed = _ULPS * np.finfo(float).eps * size
    near = all(abs(float(Fraction(v) - f)) <= allowed for v, f in zip(values.tolist(), fractions, strict=True))
    return fractions if near else None
