"""What simulator and controller say about each frame of a run in lockstep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from rclpy.qos import QoSProfile

from plsing_msgs.msg import ControllerState
from plsing_ros.errors import PlsingError
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import nanoseconds
from plsing_ros.nodes.harness import Collected, Harness

# So many that none is lost while others are taken.
RELIABLE = QoSProfile(depth=100)
_BEST_EFFORT = QoSProfile(depth=100, reliability=qos.SENSOR_DATA.reliability)


class FrameMessages:
    """Pose, twist and controller state of each frame, by its stamp [ns]."""

    def __init__(self, ros: Harness, camera_pose: str = "camera_pose") -> None:
        """Collect from now on; the pose is that of the topic given."""
        self._poses = ros.collect(PoseWithCovarianceStamped, camera_pose, _BEST_EFFORT)
        self._twists = ros.collect(TwistStamped, "cmd_twist", RELIABLE)
        self._states = ros.collect(ControllerState, "controller/state", RELIABLE)

    def state(self, stamp: int) -> ControllerState | None:
        """Return the controller's answer to a frame, if it is there."""
        # Before its first frame the controller says that it waits, with the stamp of that very frame.
        return answer(self._states, stamp, lambda state: state.mode != ControllerState.WAITING)

    def have_come(self, stamp: int) -> bool:
        """Return whether all three, or later ones, are there."""
        passed = all(each and stamp_of(each[-1]) >= stamp for each in (self._poses, self._twists))
        return passed and self.state(stamp) is not None

    def of(self, stamp: int) -> tuple[PoseWithCovarianceStamped, TwistStamped, ControllerState]:
        """Return the three.

        Raises:
            PlsingError: If one of them was lost.
        """
        found = answer(self._poses, stamp), answer(self._twists, stamp), self.state(stamp)
        for messages, message in zip((self._poses, self._twists, self._states), found, strict=True):
            if message is None:
                raise PlsingError(
                    f"the message of {messages.topic} at {stamp * 1e-9:g} s was lost; is the machine overloaded?"
                )
        return found


def stamp_of(message: Any) -> int:
    """Return a message's stamp [ns]."""
    return nanoseconds(message.header.stamp)


def answer(messages: Collected, stamp: int, counts: Callable[[Any], bool] = lambda message: True) -> Any:
    """Return the latest message of a stamp [ns] that counts, or None."""
    for message in reversed(messages):
        if stamp_of(message) < stamp:
            break
        if stamp_of(message) == stamp and counts(message):
            return message
    return None
