# SPDX-License-Identifier: Apache-2.0
"""Camera poses that came on a topic of their own, and which one belongs to an image."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.geometry.rotations import turned_covariance

_SECOND = 1_000_000_000
# Poses and features come on two topics: enough poses to find the one that belongs to features that were overtaken.
_REMEMBERED_POSES = 10


def covariance_or_none(values: Array) -> Array | None:
    """Return the symmetric part of a matrix, shape (6, 6), if it is a covariance and not zero, else None.

    It is none if it is not finite or has an eigenvalue below zero by more than rounding leaves.
    """
    return _core.pose_covariance(values)


class ReceivedPose(NamedTuple):
    """A pose as it was received.

    Attributes:
        stamp: [ns].
        T_world_camera: Where the camera was.
        covariance: In the scene's axes, (position [m], rotation [rad]), shape (6, 6); None: exact.
    """

    stamp: int
    T_world_camera: Pose
    covariance: Array | None

    def covariance_camera(self) -> Array | None:
        """Return the covariance in the camera's axes, or None."""
        if self.covariance is None:
            return None
        return turned_covariance(self.covariance, self.T_world_camera.rotation.T)


class ReceivedPoses:
    """The poses received lately."""

    def __init__(self) -> None:
        self._poses: deque[ReceivedPose] = deque(maxlen=_REMEMBERED_POSES)

    @property
    def latest(self) -> ReceivedPose | None:
        """The one that came last, or None."""
        return self._poses[-1] if self._poses else None

    def receive(self, T_world_camera: Pose, stamp: int, covariance: Array | None = None) -> None:
        """Take the camera's pose at a stamp [ns], and its covariance if it is not exact."""
        self._poses.append(ReceivedPose(stamp, T_world_camera, covariance))

    def forget(self) -> None:
        """Trust no pose received so far."""
        self._poses.clear()

    def at(self, stamp: int, tolerance: float) -> ReceivedPose | None:
        """Return the pose that was received for features of a stamp [ns] to a tolerance [s], or None."""
        if not self._poses:
            return None
        # The latest nearly always has the very stamp of the features.
        if self._poses[-1].stamp == stamp:
            return self._poses[-1]
        found, least = None, tolerance * _SECOND
        for pose in reversed(self._poses):
            apart = abs(pose.stamp - stamp)
            if apart <= least and (found is None or apart < least):
                found, least = pose, apart
        return found
