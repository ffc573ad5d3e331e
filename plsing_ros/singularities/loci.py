# SPDX-License-Identifier: Apache-2.0
"""Distances from a camera centre to everything in a singular set, fast enough for every control cycle."""

from __future__ import annotations

import enum
from typing import NamedTuple

from plsing_ros.arrays import Array


class Kind(enum.Enum):
    """What a part of the singular set is."""

    TRANSVERSAL = "transversal"
    ISOLATED_POINT = "isolated point"
    OBSERVED_LINE = "observed line"
    PLANE = "plane"
    QUADRIC = "quadric"
    CUBIC = "cubic surface"
    STRAIGHT_LINE = "singular straight line"
    CONIC = "conic"
    CURVE = "curve"
    EVERYWHERE = "everywhere"

    def __str__(self) -> str:
        return self.value


class LocusDistance(NamedTuple):
    """The distance from a camera centre to one part of the singular set.

    Attributes:
        kind: What it is.
        name: Its name, as in SingularSet.locus_names.
        distance: [m]. Exact for lines, points and planes, first order |F| / |grad F| for quadrics and cubics.
        closest_point: The point of it closest to the centre, shape (3,) [m], to the same order.
    """

    kind: Kind
    name: str
    distance: float
    closest_point: Array

    def __str__(self) -> str:
        point = ", ".join(f"{x:.4g}" for x in self.closest_point)
        return f"{self.distance:.4g} m from {self.name}, at ({point}) m"


class DistanceArrays(NamedTuple):
    """All distances from one camera centre, in the order of SingularSet.locus_names.

    Attributes:
        distance: Shape (k,) [m].
        closest_point: Shape (k, 3) [m].
    """

    distance: Array
    closest_point: Array
