"""Following a way by the images of lines: time-varying desired features and the twist that goes along with them."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.servoing.camera_path import CameraPath


@dataclass(frozen=True, eq=False)
class Reference:
    """What a follower asks for at one instant: tau = feedforward - lambda pinv(L) (s - s*(t)).

    Attributes:
        desired: s*(t), the image line of each line that has one from there, by id, shape (3,) each.
        feedforward: Twist (v, omega) of the way half a cycle later, since it is held for a cycle, in the camera frame
            on the way, shape (6,) [m/s, rad/s].
        progress: How much of the way is done, in [0, 1].
        T_scene_camera: Where the camera should be.
    """

    desired: dict[int, Array]
    feedforward: Array
    progress: float
    T_scene_camera: Pose


class WayFollower:
    """A way and how far along it the camera should be.

    The way has a clock of its own, so that it waits when the camera must go slower than the way asks.

    Source: section "Trajectory following across singularity line L_N" of the paper, without the feed-forward.
    """

    def __init__(self, path: CameraPath, lines_scene: LineSet) -> None:
        self.path = path
        self._lines = lines_scene
        self._time = 0.0
        self._cycle = 0.0

    def advance(self, seconds: float) -> None:
        """Let time go on along the way [s]; less than real time where the camera is slowed down."""
        self._cycle = max(seconds, 0.0)
        self._time = min(self._time + self._cycle, self.path.duration)

    def reference(self) -> Reference:
        """Return what is asked for now; at the end of the way its goal, and no feed-forward."""
        pose = self.path.pose(self._time)
        seen = LineObservation.of_lines(self._lines.transformed(pose.inverse(), "camera on the way"))
        return Reference(
            dict(zip(seen.usable_ids, seen.usable_image_lines, strict=True)),
            self.path.twist(self._time + 0.5 * self._cycle),
            self.path.progress(self._time),
            pose,
        )
