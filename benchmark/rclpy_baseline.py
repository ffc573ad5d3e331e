# SPDX-License-Identifier: Apache-2.0
"""The closed loop without anything of ours: bare rclpy nodes that send the same messages and compute nothing."""

from __future__ import annotations

import array
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from benchmark.step_times import StepTimes
from plsing_msgs.msg import LineFeatureArray
from plsing_ros.nodes import qos

_LINES = 4
_FRAME = "camera_optical_frame"
_RESEND_PERIOD = 0.2  # [s]


class BareNode(Node):
    """A node that `run_node` can run."""

    def stop(self) -> None:
        """Nothing is left to be said."""


class BareSimulator(BareNode):
    """Sends the next clock, pose and features when the twist for the latest has come."""

    def __init__(self, **options: Any) -> None:
        super().__init__("feature_simulator", **options)
        self.steps = StepTimes()
        self._number = 1
        self._time, self._pose, self._features = Clock(), PoseWithCovarianceStamped(), LineFeatureArray()
        self._features.header.frame_id = _FRAME
        self._features.ids = list(range(_LINES))
        self._features.visible = [1] * _LINES
        numbers = array.array("d", range(3 * _LINES))
        self._features.image_lines = self._features.directions = self._features.moments = numbers
        self._clock_topic = self.create_publisher(Clock, "/clock", qos.CLOCK)
        self._pose_topic = self.create_publisher(PoseWithCovarianceStamped, "camera_pose", qos.SENSOR_DATA)
        self._features_topic = self.create_publisher(LineFeatureArray, "line_features", qos.SENSOR_DATA)
        self.create_subscription(TwistStamped, "cmd_twist", self._on_twist, qos.COMMAND_INPUT)
        self.create_timer(_RESEND_PERIOD, self._send)

    def _on_twist(self, message: TwistStamped) -> None:
        if message.header.stamp.sec == self._number:
            self._number += 1
            self._send()
            self.steps.note()

    def _send(self) -> None:
        for stamp in (self._time.clock, self._pose.header.stamp, self._features.header.stamp):
            stamp.sec = self._number
        self._clock_topic.publish(self._time)
        self._pose_topic.publish(self._pose)
        self._features_topic.publish(self._features)


class BareController(BareNode):
    """Answers features with a twist of their stamp."""

    def __init__(self, **options: Any) -> None:
        super().__init__("controller", **options)
        self._twist = TwistStamped()
        self._twist.header.frame_id = _FRAME
        self._topic = self.create_publisher(TwistStamped, "cmd_twist", qos.COMMAND)
        self.create_subscription(LineFeatureArray, "line_features", self._on_features, qos.SENSOR_DATA)

    def _on_features(self, message: LineFeatureArray) -> None:
        self._twist.header.stamp.sec = message.header.stamp.sec
        self._topic.publish(self._twist)


class BareMonitor(BareNode):
    """Listens to what the monitor listens to."""

    def __init__(self, **options: Any) -> None:
        super().__init__("singularity_monitor", **options)
        self.create_subscription(LineFeatureArray, "line_features", lambda _: None, qos.SENSOR_DATA)
        self.create_subscription(PoseWithCovarianceStamped, "camera_pose", lambda _: None, qos.SENSOR_DATA)
        self.create_subscription(TwistStamped, "cmd_twist", lambda _: None, qos.COMMAND_INPUT)
