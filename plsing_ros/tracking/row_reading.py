# SPDX-License-Identifier: Apache-2.0
"""Cameras with a rolling shutter: where an object was seen when one row was read, of all rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, cross


@dataclass(frozen=True, eq=False)
class RowReading:
    """How an object moves while its rows are read, by Meingast et al. (2005): evenly.

    Attributes:
        motion: (v, omega) of the object, in the camera frame, while a unit of the normalised image is read.
        row: Of the object's middle in the normalised image; the pose is of the time when it is read.
    """

    motion: Array
    row: float

    def at_middle(self, seen: Array, points_camera: Array) -> Array:
        """Return where points were when the row of the object's middle was read, shape (n, 2).

        Args:
            seen: Of the points in the normalised image, shape (n, 2).
            points_camera: The points, shape (n, 3) [m].
        """
        velocity = self.motion[:3] + cross(np.broadcast_to(self.motion[3:], points_camera.shape), points_camera)
        flow = (velocity[:, :2] - seen * velocity[:, 2:]) / points_camera[:, 2:]
        moved: Array = seen + (self.row - seen[:, 1:]) * flow
        return moved
