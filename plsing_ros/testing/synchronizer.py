# SPDX-License-Identifier: Apache-2.0
"""What simulator and controller say about each frame of a run in lockstep."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import takewhile
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from rclpy.qos import QoSProfile

from plsing_msgs.msg import ControllerState
from plsing_ros.errors import PlsingError
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import nanoseconds
from plsing_ros.testing.harness import Collected, Harness

# So many that none is lost while others are taken.
RELIABLE = QoSProfile(depth=100)
BEST_EFFORT = QoSProfile(depth=100, reliability=qos.SENSOR_DATA.reliability)


class FrameSynchronizer:
    """Pose, twist and controller state of each frame, by its stamp [ns]."""

    def __init__(self, ros: Harness, camera_pose: str = "camera_pose") -> None:
        """Collect from now on; the pose is that of the topic given."""
        self._poses = ros.collect(PoseWithCovarianceStamped, camera_pose, BEST_EFFORT)
        self._twists = ros.collect(TwistStamped, "cmd_twist", RELIABLE)
        self._states = ros.collect(ControllerState, "controller/state", RELIABLE)

    def have_come(self, stamp: int) -> bool:
        """Return whether all three, or later ones, are there."""
        return (
            has_come(self._poses, stamp) and has_come(self._twists, stamp) and has_come(self._states, stamp, _is_answer)
        )

    def of(self, stamp: int) -> tuple[PoseWithCovarianceStamped, TwistStamped, ControllerState]:
        """Return the three.

        Raises:
            PlsingError: If one of them was lost.
        """
        return taken(self._poses, stamp), taken(self._twists, stamp), taken(self._states, stamp, _is_answer)


def stamp_of(message: Any) -> int:
    """Return a message's stamp [ns]."""
    return nanoseconds(message.header.stamp)


def has_come(messages: Collected, stamp: int, counts: Callable[[Any], bool] = lambda message: True) -> bool:
    """Return whether a message of a stamp [ns], or a later one, is there that counts."""
    return any(counts(message) for message in _since(messages, stamp))


def taken(messages: Collected, stamp: int, counts: Callable[[Any], bool] = lambda message: True) -> Any:
    """Return the latest message of a stamp [ns] that counts.

    Raises:
        PlsingError: If it was lost.
    """
    for message in _since(messages, stamp):
        if stamp_of(message) == stamp and counts(message):
            return message
    raise PlsingError(f"the message of {messages.topic} at {stamp * 1e-9:g} s was lost; is the machine overloaded?")


def _since(messages: Collected, stamp: int) -> Iterator[Any]:
    """Yield the messages of a stamp [ns] and later ones, the latest first."""
    return takewhile(lambda message: stamp_of(message) >= stamp, reversed(messages))


def _is_answer(state: ControllerState) -> bool:
    # Before its first frame the controller says that it waits, with the stamp of that very frame.
    return state.mode != ControllerState.MODE_WAITING
