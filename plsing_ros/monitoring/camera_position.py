# SPDX-License-Identifier: Apache-2.0
"""Where the camera is: by a pose of about the same time, or else by the lines themselves."""

from __future__ import annotations

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.line_alignment import pose_by_lines
from plsing_ros.pose.received_poses import ReceivedPoses


class CameraPosition:
    """The poses received lately, and which one belongs to features.

    Attributes:
        covariance: Of the pose that was found last, as it was received.
    """

    def __init__(self) -> None:
        self._poses = ReceivedPoses()
        self.covariance: Array | None = None

    def receive(self, T_world_camera: Pose, stamp: int, covariance: Array | None = None) -> None:
        """Take the camera's pose at a stamp [ns], and its covariance if it is not exact."""
        self._poses.receive(T_world_camera, stamp, covariance)

    def forget(self) -> None:
        """Trust no pose received so far."""
        self._poses.forget()

    def received(self, stamp: int, tolerance: float) -> Pose | None:
        """Return the pose that was received for features of a stamp [ns] to a tolerance [s], or None."""
        found = self._poses.at(stamp, tolerance)
        if found is None:
            return None
        self.covariance = found.covariance
        return found.T_world_camera


def locate(scene: LineSet, lines: LineSet, told: Pose | None) -> tuple[Pose | None, str]:
    """Return where the camera is, or None, and the source: "camera_pose", "features" or "".

    Args:
        scene: The lines in the scene frame.
        lines: Those that are seen, in the camera frame.
        told: The pose that was received for them, or None.

    Raises:
        ObservationError: If no pose is known and a line is reversed with respect to the scene.
    """
    if told is not None:
        return told, "camera_pose"
    pose = pose_by_lines(scene, lines)
    return pose, "" if pose is None else "features"
