# SPDX-License-Identifier: Apache-2.0
"""The scene's singular set, and where a camera is in it by the lines it sees."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.line_alignment import pose_by_lines
from plsing_ros.singularities import Kind, SingularSet, singular_set


class SceneLoci:
    """Distances to the singular loci of one scene; the singular set is computed when it is first needed."""

    def __init__(self, lines: LineSet) -> None:
        self.lines = lines

    @cached_property
    def singular_set(self) -> SingularSet:
        """The singular set."""
        return singular_set(self.lines)

    @cached_property
    def _rows(self) -> Array:
        # The observed lines are left out: their images degenerate first, and such images are not used.
        rows = [row for row, kind in enumerate(self.singular_set.locus_kinds) if kind is not Kind.OBSERVED_LINE]
        return np.array(rows, dtype=np.intp)

    def camera_pose(self, seen: LineSet) -> Pose | None:
        """Return T_world_camera of a camera that sees lines, or None if they do not tell.

        Args:
            seen: In the camera's optical frame.

        Raises:
            ObservationError: If a line is reversed with respect to the scene.
        """
        return pose_by_lines(self.lines, seen)

    def offsets(self, center: Array) -> Array:
        """Return the vectors from a camera centre to the closest point of each locus, shape (k, 3) [m].

        Args:
            center: In the scene frame, shape (3,) [m].
        """
        offset: Array = self.singular_set.distance_arrays(center).closest_point[self._rows] - center
        return offset

    def nearest_text(self, center: Array) -> str:
        """Return how near the nearest locus is, as a clause to append to a reason, or "" if there is none."""
        nearest = self.singular_set.nearest_locus(center)
        return "" if nearest is None else f"; {nearest.distance:.3g} m from {nearest.name}"
