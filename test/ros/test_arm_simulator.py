# SPDX-License-Identifier: Apache-2.0
"""The arm simulator's node: what it publishes, how it moves, what it refuses."""

import numpy as np
import pytest
from builders import twist
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_srvs.srv import Trigger

from plsing_msgs.msg import SimulatorState
from plsing_ros.errors import StartError
from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.arm_simulator import ArmSimulatorNode
from plsing_ros.nodes.image_conversions import camera_from_message, grey_from_message
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation.arm import Arm

pytest.importorskip("cv2")
SCENE = config_file("camera_arm.yaml")
LOCKSTEP = {"mode": "lockstep", "resend_period": 0.05, "renderer": "polygons"}
TWIST = np.array([0.05, -0.03, 0.02, 0.04, 0.1, -0.06])


@pytest.fixture
def topics(ros):
    class Topics:
        images = ros.collect(Image, "image")
        infos = ros.collect(CameraInfo, "camera_info")
        joints = ros.collect(JointState, "joint_states")
        poses = ros.collect(PoseWithCovarianceStamped, "camera_pose")
        states = ros.collect(SimulatorState, "arm_simulator/state", qos.STATUS)

    return Topics


def pose_of(message):
    p, q = message.pose.pose.position, message.pose.pose.orientation
    return Pose.from_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])


def test_image_calibration_joints_and_pose_are_of_one_instant_and_move_with_the_twist(ros, topics):
    node = ros.add(ArmSimulatorNode, SCENE, LOCKSTEP)
    commands = ros.publisher(TwistStamped, "cmd_twist")
    ros.spin_until(lambda: topics.images and topics.poses and topics.joints and topics.states, "a frame")
    start = pose_of(topics.poses[0])
    camera = camera_from_message(topics.infos[0])
    assert (camera.width, camera.height, camera.fx) == (640, 480, 600.0)
    assert topics.images[0].header == topics.infos[0].header and topics.states[0].waiting
    # The object is drawn where the camera is: the middle of the image is on it, the corner is not.
    grey = grey_from_message(topics.images[0])
    corners = camera.project((node.parameters.model().vertices - start.translation) @ start.rotation)
    column, row = np.round(corners.mean(axis=0)).astype(int)
    assert abs(int(np.median(grey[row - 3 : row + 4, column - 3 : column + 4])) - int(np.median(grey[:20]))) > 10
    for step in range(5):
        stamp = topics.images[-1].header.stamp
        commands.publish(twist(TWIST, stamp))
        ros.spin_until(lambda: topics.states[-1].step == step + 1, f"step {step + 1}")
    ros.spin_until(lambda: topics.joints[-1].header.stamp != stamp, "the joints")
    moved = pose_of(topics.poses[-1])
    assert moved.is_close(start.integrate(TWIST, 0.2), 1e-5)
    by_joints = Arm(Pose(np.eye(3), [-0.5, 0.0, 0.0])).camera_pose(np.array(topics.joints[-1].position))
    assert by_joints.is_close(moved, 1e-9)
    assert not topics.states[-1].waiting and topics.states[-1].reason == ""
    assert ros.call(Trigger, "arm_simulator/reset", Trigger.Request()).success
    ros.spin_until(lambda: topics.states[-1].step == 0, "the reset")
    assert pose_of(topics.poses[-1]).is_close(start, 1e-9)


@pytest.mark.parametrize(
    ("values", "frame", "said"),
    [
        ([np.nan, 0, 0, 0, 0, 0], "camera_optical_frame", "cmd_twist[0] is nan"),
        (TWIST, "base_link", "frame 'base_link', expected 'camera_optical_frame'"),
        ([0, 0, 40.0, 0, 0, 0], "camera_optical_frame", "as fast as it may be"),
        ([1e308, 1e308, 0, 1e308, 0, 0], "camera_optical_frame", "up to 1e+50"),
    ],
    ids=["nan", "other frame", "too fast", "overflow"],
)
def test_twists_that_cannot_be_followed_are_named_and_no_joint_is_too_fast(ros, topics, values, frame, said):
    ros.add(ArmSimulatorNode, SCENE, LOCKSTEP)
    commands = ros.publisher(TwistStamped, "cmd_twist")
    commands.publish(twist(values, 1.0, frame))
    ros.spin_until(lambda: topics.states and said in topics.states[-1].reason, said)
    ros.spin_until(lambda: topics.joints, "joints")
    assert np.isfinite(topics.joints[-1].position).all()
    assert np.abs(topics.joints[-1].velocity).max() <= 1.5 + 1e-9


def test_without_twists_in_real_time_it_stands_and_goes_on_publishing(ros, topics):
    ros.add(ArmSimulatorNode, SCENE, {"renderer": "polygons", "twist_timeout": 0.1})
    commands = ros.publisher(TwistStamped, "cmd_twist")
    commands.publish(twist(TWIST, ros.node.get_clock().now().to_msg()))
    ros.spin_until(lambda: topics.states and not topics.states[-1].waiting, "a step")
    ros.spin_until(lambda: "old, allowed are 0.1 s" in topics.states[-1].reason, "the timeout")
    count = len(topics.images)
    ros.spin_until(lambda: len(topics.images) >= count + 3, "more images")


def test_a_start_that_the_arm_cannot_reach_is_a_sentence(ros):
    with pytest.raises(StartError, match=r"\barm\b.*\bcamera\b"):
        ros.add(ArmSimulatorNode, SCENE, {**LOCKSTEP, "start.position": [2.0, 0.0, 0.3]})
