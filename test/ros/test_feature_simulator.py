# SPDX-License-Identifier: Apache-2.0
"""The simulator by itself: what it publishes, how it moves, what it refuses."""

import numpy as np
import pytest
from builders import CAMERA_FRAME, SCENE, start_pose, time_of, twist
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from messages import mentions
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from scipy.linalg import expm
from std_srvs.srv import Trigger

from plsing_msgs.msg import LineFeatureArray, SimulatorState
from plsing_ros.features import project_lines
from plsing_ros.geometry import Pose
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode

TWIST = np.array([0.5, -0.3, 0.2, 0.4, 0.1, -0.6])
LOCKSTEP = {"mode": "lockstep", "resend_period": 0.05}


@pytest.fixture
def topics(ros):
    class Topics:
        features = ros.collect(LineFeatureArray, "line_features")
        poses = ros.collect(PoseWithCovarianceStamped, "camera_pose")
        states = ros.collect(SimulatorState, "feature_simulator/state")
        clock = ros.collect(Clock, "/clock")

    return Topics


def pose_of(message):
    p, q = message.pose.pose.position, message.pose.pose.orientation
    return Pose.from_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])


def test_lockstep_waits_for_the_twist_and_integrates_it_exactly(ros, paper, topics):
    ros.add(FeatureSimulatorNode, paper, {**LOCKSTEP, "publish_clock": True})
    commands = ros.publisher(TwistStamped, "cmd_twist")
    ros.spin_until(lambda: len(topics.features) >= 3, "the first frame, again and again")
    assert {each.header.stamp.sec for each in topics.features} == {1}  # time stands still
    assert topics.states[-1].waiting and "twist" in topics.states[-1].reason

    start, steps = start_pose(2), 5
    for step in range(steps):
        stamp = time_of(1.0 + 0.04 * step)
        commands.publish(twist(TWIST, stamp))
        ros.spin_until(lambda: topics.states and topics.states[-1].step == step + 1, f"step {step + 1}")
    last = time_of(1.0 + 0.04 * steps)
    ros.spin_until(
        lambda: topics.clock[-1].clock == last == topics.features[-1].header.stamp == topics.poses[-1].header.stamp,
        "clock, features and pose of the last frame",
    )
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = np.cross(TWIST[3:], np.eye(3)).T, TWIST[:3]
    expected = expm(0.04 * steps * generator)
    end = start.inverse() @ pose_of(topics.poses[-1])
    np.testing.assert_allclose(end.rotation, expected[:3, :3], atol=1e-12)
    np.testing.assert_allclose(end.translation, expected[:3, 3], atol=1e-12)
    assert not topics.states[-1].waiting


def test_features_are_the_projections_from_the_published_pose(ros, paper, topics):
    ros.add(FeatureSimulatorNode, paper, LOCKSTEP)
    ros.spin_until(lambda: topics.features and topics.poses, "a frame")
    message, pose = topics.features[0], pose_of(topics.poses[0])
    lines = SCENE.transformed(pose.inverse(), CAMERA_FRAME)
    assert message.header.frame_id == CAMERA_FRAME and topics.poses[0].header.frame_id == "world"
    assert message.header.stamp == topics.poses[0].header.stamp
    assert list(message.ids) == [1, 2, 3, 4] and bytes(message.visible) == bytes([1, 1, 1, 1])
    np.testing.assert_allclose(message.image_lines, project_lines(lines), atol=1e-12)
    np.testing.assert_allclose(message.directions, lines.direction.ravel(), atol=1e-12)
    np.testing.assert_allclose(message.moments, lines.moment.ravel(), atol=1e-12)


def test_a_twist_for_another_frame_does_not_step(ros, paper, topics):
    ros.add(FeatureSimulatorNode, paper, LOCKSTEP)
    commands = ros.publisher(TwistStamped, "cmd_twist")
    commands.publish(twist(TWIST, 0.96))
    ros.spin_for(0.3)
    assert {each.step for each in topics.states} == {0}


@pytest.mark.parametrize(
    ("values", "frame", "reason"),
    [
        ([np.nan, 0, 0, 0, 0, 0], CAMERA_FRAME, "cmd_twist[0] is nan"),
        ([0, 0, 0, 0, 0, -np.inf], CAMERA_FRAME, "cmd_twist[5] is -inf"),
        (TWIST, "base_link", "frame 'base_link', expected 'camera_optical_frame'"),
        ([1e12, 0, 0, 0, 0, 0], CAMERA_FRAME, "m or rad; allowed are 1e+09"),
        ([1e308, 1e308, 0, 1e308, 0, 0], CAMERA_FRAME, "up to 1e+50 m/s or rad/s can be computed with"),
    ],
    ids=["nan", "infinity", "other frame", "too far", "overflow"],
)
def test_a_twist_that_cannot_be_used_is_refused_and_the_camera_stays(ros, paper, topics, values, frame, reason):
    ros.add(FeatureSimulatorNode, paper, LOCKSTEP)
    commands = ros.publisher(TwistStamped, "cmd_twist")
    commands.publish(twist(values, 1.0, frame))
    ros.spin_until(lambda: topics.states and reason in topics.states[-1].reason, f"the reason '{reason}'")
    assert topics.states[-1].waiting and topics.states[-1].step == 0
    np.testing.assert_array_equal(pose_of(topics.poses[-1]).translation, pose_of(topics.poses[0]).translation)
    commands.publish(twist(TWIST, 1.0))
    ros.spin_until(lambda: topics.states[-1].step == 1, "a good twist to be taken again")


def test_reset_goes_back_to_the_start_but_not_in_time(ros, paper, topics):
    ros.add(FeatureSimulatorNode, paper, LOCKSTEP)
    commands = ros.publisher(TwistStamped, "cmd_twist")
    commands.publish(twist(TWIST, 1.0))
    ros.spin_until(lambda: topics.states and topics.states[-1].step == 1, "a step")
    assert ros.call(Trigger, "feature_simulator/reset", Trigger.Request()).success
    ros.spin_until(lambda: topics.states[-1].step == 0, "the reset")
    np.testing.assert_allclose(pose_of(topics.poses[-1]).translation, start_pose(2).translation)
    assert topics.features[-1].header.stamp == time_of(1.08)


def test_a_start_or_a_scene_that_cannot_be_seen_is_refused_and_the_next_reset_goes_well(ros, paper):
    node = ros.add(FeatureSimulatorNode, paper, LOCKSTEP)
    turned = {"start.orientation": [0.0, 0.0, np.sin(0.4), np.cos(0.4)]}
    for values in ({"start.position": [1e50, 1e50, 1e50], **turned}, {"lines.points": [1e308] * 12}):
        results = node.set_parameters_atomically([Parameter(name, value=value) for name, value in values.items()])
        assert not results.successful and mentions(results.reason, "1e+50")
    assert ros.call(Trigger, "feature_simulator/reset", Trigger.Request()).success


def test_noise_is_seeded_and_of_the_stated_size(ros, paper, topics):
    noise = 2e-3
    first = ros.add(FeatureSimulatorNode, paper, {**LOCKSTEP, "noise": noise, "seed": 5})
    ros.spin_until(lambda: topics.features, "a frame")
    ros.remove(first)
    topics.features.clear()
    ros.add(FeatureSimulatorNode, paper, {**LOCKSTEP, "noise": noise, "seed": 5})
    commands = ros.publisher(TwistStamped, "cmd_twist")
    moments = []
    for step in range(200):
        stamp = time_of(1.0 + 0.04 * step)
        ros.spin_until(lambda: topics.features and topics.features[-1].header.stamp == stamp, f"frame {step}")
        moments.append(np.reshape(topics.features[-1].moments, (4, 3)))
        commands.publish(twist(np.zeros(6), stamp))
    exact = SCENE.transformed(start_pose(2).inverse(), CAMERA_FRAME)
    deviation = np.array(moments) - exact.moment
    # Two of three directions keep the full noise; the one along the line is turned to keep the moment orthogonal.
    across = np.cross(exact.direction, deviation)
    assert np.std(across) * np.sqrt(3 / 2) == pytest.approx(noise, rel=0.1)
    with_same_seed = np.reshape(topics.features[0].moments, (4, 3))
    np.testing.assert_array_equal(with_same_seed, moments[0])


def test_realtime_steps_on_its_own_and_stands_still_without_twists(ros, paper, topics):
    ros.add(FeatureSimulatorNode, paper, {"time_step": 0.02, "twist_timeout": 0.5})
    ros.spin_until(lambda: len(topics.features) >= 5 and topics.states, "frames")
    assert "twist" in topics.states[-1].reason
    commands = ros.publisher(TwistStamped, "cmd_twist")
    commands.publish(twist(TWIST, ros.node.get_clock().now().to_msg()))
    ros.spin_until(lambda: topics.states[-1].step >= 2, "the twist to be held")
    ros.spin_until(lambda: topics.states[-1].waiting, "the twist to grow old")
    assert mentions(topics.states[-1].reason, "old", "0.5 s")
    at_rest = topics.states[-1].step
    ros.spin_for(0.2)
    assert topics.states[-1].step == at_rest
    stamps = [each.header.stamp.sec + each.header.stamp.nanosec * 1e-9 for each in topics.features]
    assert np.diff(stamps).min() > 0.0


def test_a_line_through_the_camera_is_marked_as_not_usable(ros, paper, topics):
    ros.add(FeatureSimulatorNode, paper, {**LOCKSTEP, "start.position": [3.0, 0.0, 0.0]})
    ros.spin_until(lambda: topics.features, "a frame")
    assert bytes(topics.features[0].visible) == bytes([0, 1, 1, 1])
    assert np.isfinite(topics.features[0].image_lines).all()
    assert list(topics.features[0].image_lines[:3]) == [0.0, 0.0, 0.0]
