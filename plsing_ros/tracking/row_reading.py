# SPDX-License-Identifier: Apache-2.0
"""Cameras with a rolling shutter: where an object was seen when one row was read, of all rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros._core import compiled
from plsing_ros.arrays import Array, cross
from plsing_ros.geometry import Pose


@dataclass(frozen=True, eq=False)
class RowReading:
    """How an object moves while its rows are read, by Meingast et al. (2005): evenly.

    Attributes:
        motion: (v, omega) of the object, in the camera frame, while a unit of the normalised image is read.
        row: Of the object's middle in the normalised image; the pose is of the time when it is read.
    """

    motion: Array
    row: float

    @classmethod
    def between(cls, before: Pose, now: Pose, share: float, center: Array) -> RowReading:
        """Return the reading of an image from the motion since the last one.

        Args:
            before: T_camera_model in the last image.
            now: T_camera_model in this one.
            share: Of the time from image to image in which a unit of the normalised image is read.
            center: Of the object, in the model frame, shape (3,) [m].
        """
        motion = compiled.motion_between(before.rotation, before.translation, now.rotation, now.translation)
        _, y, z = now.rotation @ center + now.translation
        return cls(share * motion, float(y / z))

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
