# SPDX-License-Identifier: Apache-2.0
"""TF: where the camera is, said on /tf, and where it is fixed to the tool, heard from there."""

import sys

import numpy as np
import pytest
from builders import CAMERA_FRAME, TARGET, compute_plain_twist, features, start_pose, twist_values
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped, TwistStamped
from lifecycle_msgs.srv import GetState
from messages import mentions
from tf2_msgs.msg import TFMessage

from plsing_msgs.msg import ControllerState, LineFeatureArray
from plsing_ros.control.tool import tool_twist
from plsing_ros.errors import StartError
from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.pose_conversions import fill_transform
from plsing_ros.nodes.pose_estimator import PoseEstimatorNode
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode

TOOL = Pose.look_at([0.05, -0.1, 0.08], [0.0, 0.0, 1.0])


def same_pose(transform, pose):
    t, r = transform.translation, transform.rotation
    p, q = pose.position, pose.orientation
    return (t.x, t.y, t.z, r.x, r.y, r.z, r.w) == (p.x, p.y, p.z, q.x, q.y, q.z, q.w)


@pytest.mark.parametrize("source", ["simulator", "estimator"])
def test_every_camera_pose_is_on_tf_with_the_same_stamp(ros, paper, source):
    transforms, poses = ros.collect(TFMessage, "/tf", qos.TRANSFORMS), ros.collect(PoseWithCovarianceStamped, "pose")
    ros.add(FeatureSimulatorNode, paper, {"publish_tf": source == "simulator"}, {"camera_pose": "pose"})
    if source == "estimator":
        ros.add(PoseEstimatorNode, paper, {"publish_tf": True})
        poses = ros.collect(PoseWithCovarianceStamped, "camera_pose")

    def pairs():
        by_stamp = {(each.header.stamp.sec, each.header.stamp.nanosec): each for each in poses}
        found = [each for message in transforms for each in message.transforms]
        return [(each, by_stamp.get((each.header.stamp.sec, each.header.stamp.nanosec))) for each in found]

    ros.spin_until(lambda: sum(pose is not None for _, pose in pairs()) >= 3, "poses and transforms of the same frames")
    for transform, pose in pairs():
        assert (transform.header.frame_id, transform.child_frame_id) == ("world", CAMERA_FRAME)
        if pose is not None:
            assert same_pose(transform.transform, pose.pose.pose)


def test_nothing_is_on_tf_unless_asked_for(ros, paper):
    transforms, seen = ros.collect(TFMessage, "/tf", qos.TRANSFORMS), ros.collect(LineFeatureArray, "line_features")
    ros.add(FeatureSimulatorNode, paper)
    ros.spin_until(lambda: len(seen) >= 5, "five frames")
    assert not transforms and not ros.node.get_publishers_info_by_topic("/tf")


def test_without_tf2_msgs_the_nodes_run_and_say_one_sentence(ros, paper, monkeypatch, capfd):
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    poses = ros.collect(PoseWithCovarianceStamped, "camera_pose")
    twists = ros.collect(TwistStamped, "cmd_twist")
    for node in (PoseEstimatorNode, FeatureSimulatorNode):
        ros.add(node, paper, {"publish_tf": True})
    ros.add(ControllerNode, paper)
    ros.add(SingularityMonitorNode, paper)
    ros.spin_until(lambda: poses and any(twist_values(each).any() for each in twists), "poses and a camera that moves")
    said = [line for line in capfd.readouterr().err.splitlines() if "tf2_msgs" in line]
    assert len(said) == 2 and all("[ERROR]" in each and "not installed" in each for each in said)


def hand_eye(pose):
    message = TransformStamped(child_frame_id=CAMERA_FRAME)
    message.header.frame_id = "tool0"
    fill_transform(message.transform, pose)
    return TFMessage(transforms=[message])


FROM_TF = {"tool_frame": "tool0", "T_tool_camera.source": "tf", "features_timeout": 5.0}


@pytest.mark.usefixtures("tf2_ros")
def test_the_robot_stands_until_tf_says_where_the_camera_is_and_follows_it_then(ros, paper):
    twists, states = ros.collect(TwistStamped, "cmd_twist"), ros.collect(ControllerState, "controller/state")
    node = ros.add(ControllerNode, paper, FROM_TF)
    sent = ros.publisher(LineFeatureArray, "line_features")

    def answer(pose):
        stamp = ros.node.get_clock().now().to_msg()
        sent.publish(features(pose, stamp))
        ros.spin_until(lambda: states and states[-1].header.stamp == stamp, "the state of these features")
        (twist,) = (each for each in twists if each.header.stamp == stamp)
        return twist, states[-1]

    start = start_pose(2)
    twist, state = answer(start)
    assert state.mode == ControllerState.MODE_HALTED and not twist_values(twist).any()
    assert mentions(state.reason, "TF", "'tool0'", "'camera_optical_frame'")

    static = ros.publisher(TFMessage, "/tf_static", qos.LATCHED)
    for pose in (TOOL, Pose(np.eye(3), np.array([0.0, 0.2, 0.0]))):
        static.publish(hand_eye(pose))
        ros.spin_until(
            lambda pose=pose: (
                answer(start) and np.allclose(node.parameters.T_tool_camera.translation, pose.translation, atol=1e-12)
            ),
            "the transform in force",
        )
        # The first features after a halt do not move the robot.
        ros.spin_until(lambda: answer(start)[1].mode == ControllerState.MODE_SERVOING, "servoing")
        twist, _ = answer(start)
        assert twist.header.frame_id == "tool0"
        assert twist_values(twist) == pytest.approx(tool_twist(pose, compute_plain_twist(start)), rel=1e-6, abs=1e-9)


@pytest.mark.usefixtures("tf2_ros")
def test_a_transform_that_is_none_does_not_move_the_robot(ros, paper):
    states = ros.collect(ControllerState, "controller/state")
    ros.add(ControllerNode, paper, FROM_TF)
    sent, static = ros.publisher(LineFeatureArray, "line_features"), ros.publisher(TFMessage, "/tf_static", qos.LATCHED)
    message = hand_eye(TOOL)
    message.transforms[0].transform.translation.x = float("nan")
    static.publish(message)

    def refused():
        sent.publish(features(TARGET, ros.node.get_clock().now().to_msg()))
        ros.spin_for(0.05)
        return any("on TF is refused" in each.reason and each.mode == ControllerState.MODE_HALTED for each in states)

    ros.spin_until(refused, "the refusal")
    assert not any(each.mode == ControllerState.MODE_SERVOING for each in states)


def test_without_tf2_ros_it_does_not_start_and_says_what_to_do(ros, paper, monkeypatch):
    monkeypatch.setitem(sys.modules, "tf2_ros", None)
    with pytest.raises(StartError, match=r"tf2_ros.*T_tool_camera\.position"):
        ros.add(ControllerNode, paper, FROM_TF)
    node = ros.add(ControllerNode, paper, FROM_TF | {"autostart": False})
    assert node.state_label == "unconfigured"
    assert ros.call(GetState, "controller/get_state", GetState.Request()).current_state.label == "unconfigured"


def test_a_source_without_a_frame_is_refused(ros, paper):
    with pytest.raises(Exception, match="'tool_frame'.*empty"):
        ros.add(ControllerNode, paper, {"T_tool_camera.source": "tf"})
