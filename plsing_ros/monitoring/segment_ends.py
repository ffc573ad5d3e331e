# SPDX-License-Identifier: Apache-2.0
"""Where the segments of the scene's lines end, by what is seen of them."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.planning.rollout import HALF_LENGTH

# Rays nearer to a line's direction than this do not tell where they meet it [rad].
_MIN_ANGLE = 0.1


class SegmentEnds:
    """Takes the ends that a tracker sees, and keeps the longest segment of each line.

    What is seen of a segment is less than all of it where it leaves the view or is hidden, so that the union counts.
    """

    def __init__(self, lines: LineSet) -> None:
        """Begin, with lines in the scene frame of which nothing has been seen."""
        self._lines = lines
        self._row_of = {i: row for row, i in enumerate(lines.ids)}
        self._low = np.full(len(lines), np.inf)
        self._high = np.full(len(lines), -np.inf)

    def add(self, T_world_camera: Pose, observation: LineObservation) -> None:
        """Take the ends of usable lines as seen from a pose; those of lines that are not in the scene are left out.

        Source: new; each end is where the line comes nearest to the ray through what is seen.
        """
        if observation.ends is None:
            return
        told = observation.usable & observation.ends.any(axis=1)
        seen = [row for row in np.flatnonzero(told).tolist() if observation.ids[row] in self._row_of]
        rows = [self._row_of[observation.ids[row]] for row in seen]
        if not rows:
            return
        image = observation.ends[seen].reshape(-1, 2, 2)
        rays = np.concatenate([image, np.ones((len(rows), 2, 1))], axis=2) @ T_world_camera.rotation.T
        rays /= np.linalg.norm(rays, axis=2, keepdims=True)
        direction = self._lines.direction[rows][:, np.newaxis]
        to_line = (self._lines.point[rows] - T_world_camera.translation)[:, np.newaxis]
        cosine = np.sum(rays * direction, axis=2)
        square_sine = 1.0 - np.square(cosine)
        sure = square_sine >= np.sin(_MIN_ANGLE) ** 2
        along = cosine * np.sum(to_line * rays, axis=2) - np.sum(to_line * direction, axis=2)
        along /= np.where(sure, square_sine, 1.0)
        self._low[rows] = np.minimum(self._low[rows], np.where(sure, along, np.inf).min(axis=1))
        self._high[rows] = np.maximum(self._high[rows], np.where(sure, along, -np.inf).max(axis=1))

    def ends(self) -> Array | None:
        """Return the ends in the scene frame, shape (n, 2, 3) [m], far away for other lines; None if none is known."""
        known = self._low < self._high
        if not known.any():
            return None
        low, high = np.where(known, self._low, -HALF_LENGTH), np.where(known, self._high, HALF_LENGTH)
        along = np.stack([low, high], axis=1)[..., np.newaxis]
        ends: Array = self._lines.point[:, np.newaxis] + along * self._lines.direction[:, np.newaxis]
        return ends
