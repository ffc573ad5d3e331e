# SPDX-License-Identifier: Apache-2.0
"""A controller, what it is sent, and what it commands."""

from geometry_msgs.msg import TwistStamped
from rclpy.parameter import Parameter

from plsing_msgs.msg import ControllerState, LineFeatureArray
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode


class ControllerLoop:
    """Sends features to a controller and receives what it commands."""

    def __init__(self, ros, paper, **parameters):
        self.ros = ros
        self.twists = ros.collect(TwistStamped, "cmd_twist", qos.STATUS)
        self.states = ros.collect(ControllerState, "controller/state", qos.STATUS)
        # Long, so that a slow machine does not make features stale between two lines of a test.
        self.node = ros.add(ControllerNode, paper, {"features_timeout": 5.0, **parameters})
        self.features = ros.publisher(LineFeatureArray, "line_features")

    def now(self):
        return self.ros.node.get_clock().now().to_msg()

    def answer(self, message):
        """Send features and return the twist and the state that answer them."""
        self.features.publish(message)

        def answered(collected):
            return next((each for each in reversed(collected) if each.header.stamp == message.header.stamp), None)

        self.ros.spin_until(lambda: answered(self.twists) and answered(self.states), "an answer to the features")
        return answered(self.twists), answered(self.states)

    def set_parameters(self, **values):
        """Change parameters of the running controller, all at once."""
        result = self.node.set_parameters_atomically([Parameter(name, value=value) for name, value in values.items()])
        assert result.successful, result.reason
