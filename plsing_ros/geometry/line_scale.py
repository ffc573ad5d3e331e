# SPDX-License-Identifier: Apache-2.0
"""The common scale of 3-D lines that are seen, against the scene's: wrong with a stereo base of the wrong length."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry.line_alignment import matched_rows
from plsing_ros.geometry.line_set import LineSet

# A scale is taken as right up to so many of its standard deviations.
_DEVIATIONS = 3.0
# Rounding: no moment is known better than this [m].
_MIN_DEVIATION = 1e-6
# Moments have two coordinates for each line; position (three) and scale take four.
_UNKNOWNS = 4
_IDENTITY = np.eye(3)


class LineScale:
    """By which factor the moments of lines in the camera frame are too large, by all that was seen so far.

    About the point nearest to all lines, moments tell how far the lines are from each other and not where the camera
    is. There, turned into the scene frame, they are the scene's times the factor, which is a constant: noise averages
    out of their sums, and what remains beside the scene's shape is the error that the factor may have.

    Source: new, docs/laws.md, section "The scale of the 3-D lines".
    """

    def __init__(self, scene: LineSet) -> None:
        """Begin without having seen anything.

        Args:
            scene: The lines in the scene frame.
        """
        self._scene = scene
        # Of moments about the nearest point, those of the scene and those seen.
        self._expected, self._found = np.zeros((2, len(scene), 3))
        self._was_seen = np.zeros(len(scene), dtype=bool)
        self._count = 0
        # Of the latest lines, which seldom change: ids, rows in the scene, and the scene's moments.
        self._latest: tuple[tuple[int, ...], list[int], Array] | None = None

    @np.errstate(over="ignore", invalid="ignore")
    def add(self, seen: LineSet, rotation: Array) -> None:
        """Take what is seen into account; lines whose moments overflow are left out.

        Args:
            seen: Three or more lines of the scene, not all parallel, in the camera frame.
            rotation: Of T_world_camera, shape (3, 3).

        Raises:
            GeometryError: If a seen line is not in the scene.
        """
        if self._latest is None or self._latest[0] != seen.ids:
            rows = matched_rows(self._scene, seen)
            self._latest = seen.ids, rows, _about_nearest_point(self._scene.select(rows))
        _, rows, expected = self._latest
        found = _about_nearest_point(seen) @ rotation.T
        if math.isfinite(float(np.vdot(found, found))):
            self._expected[rows] += expected
            self._found[rows] += found
            self._was_seen[rows] = True
            self._count += 1

    @np.errstate(over="ignore", invalid="ignore")
    def factor(self, max_error: float) -> float:
        """Return the factor, 1 unless what was seen speaks against it.

        With the estimate 1 + e and its variance v, it is 1 + e max(0, 1 - 9 v / e^2). Lines that meet in a point say
        nothing about it (v is infinite).

        Args:
            max_error: Of the factor, below 1.
        """
        expected, singular = self._expected.ravel(), self._found.ravel()
        size = float(expected @ expected)
        freedom = 2 * int(self._was_seen.sum()) - _UNKNOWNS
        if size == 0.0 or freedom <= 0:
            return 1.0
        error = float(expected @ (singular - expected)) / size
        rest = singular - (1.0 + error) * expected
        variance = (float(rest @ rest) / freedom + (_MIN_DEVIATION * self._count) ** 2) / size
        square = error * error
        doubt = _DEVIATIONS**2 * variance
        if not doubt < square < math.inf:
            return 1.0
        return 1.0 + min(max(error * (1.0 - doubt / square), -max_error), max_error)


def _about_nearest_point(lines: LineSet) -> Array:
    """Return moments, shape (n, 3), about the point with the least sum of squared distances to the lines."""
    direction = lines.direction
    x, y, z = np.linalg.solve(len(direction) * _IDENTITY - direction.T @ direction, lines.point.sum(axis=0)).tolist()
    # direction @ this is point cross direction.
    across = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    about: Array = lines.moment - direction @ across
    return about
