# SPDX-License-Identifier: Apache-2.0
"""The frame in which every computation of this folder runs: centred on the lines, with lengths of order one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array, cross
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet

# Lines that miss a common point by less than this share of that point's distance to the origin cannot be told from
# lines through it: their coordinates are rounded to about 1e-16 of it, and seven digits must be left to compute with.
CONCURRENCY_TOLERANCE = 1e-9

# The same in metres for lines that meet at the origin itself.
_MIN_LENGTH = 1e-12

# Absolute cosine of directions a thousandth of a radian apart.
_NEARLY_PARALLEL = 1.0 - 5e-7


@dataclass(frozen=True, eq=False)
class SceneFrame:
    """n lines in coordinates x_scene = (x - center) / length, which do not depend on units or on the origin.

    Attributes:
        center: The point with the smallest sum of squared distances to the lines, shape (3,) [m].
        length: Mean distance of the lines to it [m]; 1 if they all pass through it.
        concurrent: Whether they do, within CONCURRENCY_TOLERANCE.
        direction: Unit directions, shape (n, 3).
        point: The point of each line closest to center, in scene coordinates, shape (n, 3).
    """

    center: Array
    length: float
    concurrent: bool
    direction: Array
    point: Array

    @classmethod
    def of(cls, lines: LineSet) -> SceneFrame:
        """Return the scene frame of lines.

        Source: new, docs/theory.md section "The scene frame".
        """
        return cls._centered(lines.direction, cross(lines.direction, lines.moment))

    def recentered(self) -> SceneFrame:
        """Return the scene frame of these lines alone, in units of this one; for a frame chosen for more lines."""
        return self._centered(self.direction, self.point)

    @classmethod
    def _centered(cls, direction: Array, foot: Array) -> SceneFrame:
        center, length, point = scene_coordinates(direction[np.newaxis], foot[np.newaxis])
        # scene_coordinates marks concurrent lines with length zero.
        concurrent = bool(length[0] == 0.0)
        return cls(center[0], 1.0 if concurrent else float(length[0]), concurrent, direction, point[0])

    @cached_property
    def plucker_matrix(self) -> Array:
        """Rows (moment about center, direction) in scene coordinates, shape (n, 6)."""
        return np.concatenate([cross(self.point, self.direction), self.direction], axis=1)

    @property
    def moment(self) -> Array:
        """Moments of the lines about center in scene coordinates, shape (n, 3)."""
        moment: Array = self.plucker_matrix[:, :3]
        return moment

    @cached_property
    def cosine(self) -> Array:
        """Absolute cosines of the angles between the lines, shape (n, n)."""
        cosine: Array = np.abs(self.direction @ self.direction.T)
        return cosine

    @cached_property
    def has_near_parallels(self) -> bool:
        """Whether two lines are within a thousandth of a radian of parallel; else none need be looked at closely."""
        return int(np.count_nonzero(self.cosine > _NEARLY_PARALLEL)) > len(self.direction)

    def to_scene(self, points: Array) -> Array:
        """Return points [m] of any leading shape (..., 3) in scene coordinates."""
        return (points - self.center) / self.length

    def from_scene(self, points: Array) -> Array:
        """Return points in scene coordinates, any leading shape (..., 3), in the frame of the lines [m]."""
        return points * self.length + self.center


def scene_coordinates(direction: Array, foot: Array) -> tuple[Array, Array, Array]:
    """Return centres (S, 3), lengths (S,) and closest points (S, n, 3) of the scene frames of S scenes of n lines.

    The length is 0 for concurrent lines; their points are in metres then.

    Args:
        direction: Unit directions, shape (S, n, 3).
        foot: A point on each line, shape (S, n, 3) [m].

    Raises:
        GeometryError: If lengths are so large that they overflow.
    """
    coordinates = _core.scene_coordinates(direction, foot, CONCURRENCY_TOLERANCE, _MIN_LENGTH)
    if coordinates is None:
        raise GeometryError("the lines are too far apart for their scene frame to be finite")
    return coordinates
