# SPDX-License-Identifier: Apache-2.0
"""Following a path by the images of lines: time-varying desired features and the twist that goes along with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation
from plsing_ros.features.target import Target
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.planning.camera_path import CameraPath


@dataclass(frozen=True, eq=False)
class Reference:
    """What a follower asks for at one instant: the path is a target that moves.

    Attributes:
        target: s*(t) and L*(t) of the lines that have an image from there.
        feedforward: Twist (v, omega) of the path half a cycle later, since it is held for a cycle, in the camera frame
            on the path, shape (6,) [m/s, rad/s].
        progress: How much of the path is done, in [0, 1].
        T_world_camera: Where the camera should be.
    """

    target: Target
    feedforward: Array
    progress: float
    T_world_camera: Pose

    def displacement(self, T_world_camera: Pose) -> Array:
        """Return the twist that leads from where the camera should be to where it is in unit time, shape (6,).

        To be taken back by its negative: the camera then goes straight while it turns about one axis.

        Args:
            T_world_camera: Where it is; the twist is in that camera frame.
        """
        asked, here = self.T_world_camera, T_world_camera
        shift = here.rotation.T @ (here.translation - asked.translation)
        return np.concatenate([shift, Rotation.from_matrix(asked.rotation.T @ here.rotation).as_rotvec()])


class PathFollower:
    """A path and how far along it the camera should be.

    The path has a clock of its own, so that it waits when the camera must go slower than the path asks.

    Attributes:
        path: That is followed.
        lines: In the scene frame.

    Source: section "Trajectory following across singularity line L_N" of the paper, without the feed-forward.
    """

    def __init__(self, path: CameraPath, lines_scene: LineSet) -> None:
        self.path = path
        self.lines = lines_scene
        self._time = 0.0
        self._cycle = 0.0

    def advance(self, seconds: float) -> None:
        """Let time go on along the path [s]; less than real time where the camera is slowed down."""
        self._cycle = max(seconds, 0.0)
        self._time = min(self._time + self._cycle, self.path.duration)

    def reference(self) -> Reference:
        """Return what is asked for now; at the end of the path its target, and no feed-forward.

        Raises:
            ObservationError: If fewer than three lines have an image from there.
        """
        pose = self.path.pose(self._time)
        seen = LineObservation.of_lines(self.lines.transformed(pose.inverse(), "camera on the path"))
        return Reference(
            Target(seen, "the path"),
            self.path.twist(self._time + 0.5 * self._cycle),
            self.path.progress(self._time),
            pose,
        )
