# SPDX-License-Identifier: Apache-2.0
"""Where the camera is: by a pose of about the same time, or else by the lines themselves."""

from __future__ import annotations

from collections import deque

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.line_alignment import pose_by_lines, refuse_reversed, reversed_lines

_SECOND = 1_000_000_000
# Poses and features come on two topics: enough poses to find the one that belongs to features that were overtaken.
_REMEMBERED_POSES = 10


class CameraPosition:
    """The poses received lately, and which one belongs to features.

    Attributes:
        covariance: Of the pose that was located last, as it was received.
    """

    def __init__(self) -> None:
        self._poses: deque[tuple[int, Pose, Array | None]] = deque(maxlen=_REMEMBERED_POSES)
        self.covariance: Array | None = None

    def receive(self, T_world_camera: Pose, stamp: int, covariance: Array | None = None) -> None:
        """Take the camera's pose at a stamp [ns], and its covariance if it is not exact."""
        self._poses.append((stamp, T_world_camera, covariance))

    def forget(self) -> None:
        """Trust no pose received so far."""
        self._poses.clear()

    def locate(self, scene: LineSet, lines: LineSet, stamp: int, tolerance: float) -> tuple[Pose | None, str]:
        """Return where the camera is, or None, and the source: "camera_pose", "features" or "".

        Args:
            scene: The lines in the scene frame.
            lines: Those that are seen, in the camera frame.
            stamp: Of the features [ns].
            tolerance: How far the stamp of a pose may be from theirs [s].

        Raises:
            ObservationError: If a line is reversed with respect to the scene.
        """
        pose = self.received(stamp, tolerance)
        if pose is not None:
            refuse_reversed(reversed_lines(scene, lines, pose.rotation))
            return pose, "camera_pose"
        pose = pose_by_lines(scene, lines)
        return pose, "" if pose is None else "features"

    def received(self, stamp: int, tolerance: float) -> Pose | None:
        """Return the pose that was received for features of a stamp [ns] to a tolerance [s], or None."""
        # The latest nearly always has the very stamp of the features.
        if self._poses and self._poses[-1][0] == stamp:
            self.covariance = self._poses[-1][2]
            return self._poses[-1][1]
        found, least = None, tolerance * _SECOND
        for pose_stamp, pose, covariance in reversed(self._poses):
            apart = abs(pose_stamp - stamp)
            if apart <= least and (found is None or apart < least):
                found, least, self.covariance = pose, apart, covariance
        return found
