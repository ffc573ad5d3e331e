# SPDX-License-Identifier: Apache-2.0
"""Hand cmd_twist to a joint velocity controller: a node to copy and to give the Jacobian of your robot.

docs/howto/connect.md tells how to use it. The messages are those of ros2_control's JointGroupVelocityController:
std_msgs/Float64MultiArray on <controller>/commands, one velocity for each joint in the controller's order [rad/s].
"""

import time

import numpy as np
from geometry_msgs.msg import TwistStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

TIMEOUT = 0.1  # Without a twist for so long the joints stand still [s].
DAMPING = 0.02  # In units of the Jacobian: what is lost of a motion at an arm's singularity, for bounded joint speeds.


class JointVelocityBridge(Node):
    """Answers each cmd_twist with joint velocities, and silence with zeros."""

    def __init__(self, joints, jacobian, max_speed, **options):
        """Listen from now on.

        Args:
            joints: Names, in the order of the velocity controller.
            jacobian: Takes joint positions, shape (n,), and returns the twist (v, omega) of the frame that cmd_twist is
                in and for, for unit joint velocities, shape (6, n).
            max_speed: Of a joint [rad/s]; all are slowed down by one factor, so that the motion keeps its direction.
            options: Of rclpy.node.Node.
        """
        super().__init__("joint_velocity_bridge", **options)
        self._joints, self._jacobian, self._max_speed = list(joints), jacobian, max_speed
        self._positions = None
        self._last_twist = time.monotonic()
        self._commands = self.create_publisher(Float64MultiArray, "commands", 1)
        self.create_subscription(JointState, "joint_states", self._on_joints, 1)
        self.create_subscription(TwistStamped, "cmd_twist", self._on_twist, 1)
        self.create_timer(TIMEOUT / 2, self._on_timer)

    def _on_joints(self, message):
        positions = dict(zip(message.name, message.position, strict=False))
        if all(name in positions for name in self._joints):
            self._positions = np.array([positions[name] for name in self._joints])

    def _on_twist(self, message):
        linear, angular = message.twist.linear, message.twist.angular
        twist = np.array([linear.x, linear.y, linear.z, angular.x, angular.y, angular.z])
        if self._positions is None or not np.isfinite(twist).all():
            return
        self._last_twist = time.monotonic()
        jacobian = self._jacobian(self._positions)
        damped = jacobian @ jacobian.T + DAMPING**2 * np.eye(6)
        speeds = jacobian.T @ np.linalg.solve(damped, twist)
        self._publish(speeds / max(1.0, np.abs(speeds).max() / self._max_speed))

    def _on_timer(self):
        if time.monotonic() - self._last_twist > TIMEOUT:
            self._publish(np.zeros(len(self._joints)))

    def _publish(self, speeds):
        self._commands.publish(Float64MultiArray(data=speeds.tolist()))
