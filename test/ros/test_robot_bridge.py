# SPDX-License-Identifier: Apache-2.0
"""The recipes for robots, with messages of the public definitions: MoveIt Servo's input, and joint velocities."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from builders import features, start_pose, twist_values
from controller_loop import ControllerLoop
from geometry_msgs.msg import TwistStamped
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from plsing_msgs.msg import LineFeatureArray
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode

RECIPE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "robot_bridge.py"
JOINTS = [f"joint_{i}" for i in range(1, 7)]
# Of an arm of the size of a UR5: offset along the link [m] and turn about x [rad] from each joint to the next.
LINKS = [(0.089, 0.0, 1.5708), (0.0, -0.425, 0.0), (0.0, -0.392, 0.0), (0.109, 0.0, 1.5708), (0.095, 0.0, -1.5708)]
LINKS.append((0.082, 0.0, 0.0))
POSITIONS = np.array([0.3, -1.1, 1.4, -0.9, 0.8, 0.2])


def bridge():
    specification = importlib.util.spec_from_file_location("robot_bridge", RECIPE)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module.JointVelocityBridge


def camera_pose(positions):
    """T_base_camera, with the camera at the flange."""
    pose = np.eye(4)
    for (height, length, turn), position in zip(LINKS, positions, strict=True):
        step = np.eye(4)
        step[:3, :3] = (Rotation.from_rotvec([0, 0, position]) * Rotation.from_rotvec([turn, 0, 0])).as_matrix()
        step[:3, 3] = Rotation.from_rotvec([0, 0, position]).apply([length, 0.0, height])
        pose = pose @ step
    return pose


def twist_between(before, after, seconds):
    """The twist of the camera in its own frame that leads from one pose to another, by their difference only."""
    change = np.linalg.inv(before) @ after
    return np.append(change[:3, 3], Rotation.from_matrix(change[:3, :3]).as_rotvec()) / seconds


def jacobian(positions):
    step = 1e-6
    here = camera_pose(positions)
    return np.column_stack([twist_between(here, camera_pose(positions + step * row), step) for row in np.eye(6)])


@pytest.fixture
def arm(ros):
    node = ros.add(bridge(), joints=JOINTS, jacobian=jacobian, max_speed=0.5)
    commands = ros.collect(Float64MultiArray, "commands", qos.STATUS)
    joints = ros.publisher(JointState, "joint_states")
    # In another order, and with a joint of the gripper, as drivers publish them.
    joints.publish(JointState(name=["gripper", *JOINTS[::-1]], position=[0.01, *POSITIONS[::-1]]))
    ros.spin_until(lambda: commands, "zeros at rest")
    ros.spin_for(0.1)
    return node, commands


def test_joint_velocities_move_the_camera_by_the_twist_that_the_controller_commands(ros, paper, arm):
    _, commands = arm
    loop = ControllerLoop(ros, paper, max_linear_speed=0.02, max_angular_speed=0.05)
    commands.clear()
    command, _ = loop.answer(features(start_pose(1), loop.now()))
    twist = twist_values(command)
    ros.spin_until(lambda: any(np.any(each.data) for each in commands), "joint velocities")
    velocities = np.array(next(each.data for each in commands if np.any(each.data)))
    seconds = 1e-3
    moved = twist_between(camera_pose(POSITIONS), camera_pose(POSITIONS + seconds * velocities), seconds)
    np.testing.assert_allclose(moved, twist, atol=0.02 * np.abs(twist).max())
    ros.spin_until(lambda: commands and not np.any(commands[-1].data), "zeros after the last twist")


def test_fast_twists_are_slowed_down_as_a_whole_and_what_is_not_finite_is_left_out(ros, arm):
    _, commands = arm
    twists = ros.publisher(TwistStamped, "cmd_twist")
    commands.clear()
    message = TwistStamped()
    message.twist.linear.x = float("nan")
    twists.publish(message)
    ros.spin_for(0.2)
    assert not any(np.any(each.data) for each in commands)
    message.twist.linear.x, message.twist.linear.z = 3.0, 4.0
    twists.publish(message)
    ros.spin_until(lambda: any(np.any(each.data) for each in commands), "joint velocities")
    velocities = np.array(next(each.data for each in commands if np.any(each.data)))
    assert np.abs(velocities).max() == pytest.approx(0.5)
    direction = jacobian(POSITIONS) @ velocities
    np.testing.assert_allclose(direction / np.linalg.norm(direction), [0.6, 0, 0.8, 0, 0, 0], atol=0.02)


def test_moveit_servo_gets_its_input_by_remapping_alone(ros, paper):
    """Its public definition: TwistStamped on delta_twist_cmds, reliable, in a frame that it can transform from."""
    received = ros.collect(TwistStamped, "servo_node/delta_twist_cmds", qos.STATUS)
    tool = {"tool_frame": "tool0", "T_tool_camera.position": [0.0, 0.0, 0.1]}
    ros.add(ControllerNode, paper, tool, {"cmd_twist": "servo_node/delta_twist_cmds"})
    publisher = ros.publisher(LineFeatureArray, "line_features")
    publisher.publish(features(start_pose(1), ros.node.get_clock().now().to_msg()))
    ros.spin_until(lambda: received, "a twist for MoveIt Servo")
    assert received[-1].header.frame_id == "tool0" and np.isfinite(twist_values(received[-1])).all()
