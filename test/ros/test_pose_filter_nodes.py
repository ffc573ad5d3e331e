# SPDX-License-Identifier: Apache-2.0
"""The pose filter through the nodes: with odometry, along the paper's quadrifolia, and where it must stay lost."""

from itertools import pairwise

import numpy as np
import pytest
from builders import CAMERA_FRAME, change, features
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from messages import mentions
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header

from paper.pose_quadrifolium import EXPERIMENTS
from plsing_msgs.msg import LineFeatureArray, PoseEstimate
from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.pose_estimator import PoseEstimatorNode
from plsing_ros.simulation.near_transversal import POINT_ON_TRANSVERSAL

CALM = Pose.look_at([5.0, 2.0, 3.0], [0.0, 0.0, 3.0], down=[0.0, 0.0, -1.0])
# Camera centres where single images tell the pose to 1 or 2 cm, from which a straight way leads to a quadrifolium.
HEALTHY = ([-5.72, -0.61, -3.01], [1.12, 0.02, 1.87])
HELD, ON_THE_WAY = 15, 100


def stamped(twist, stamp):
    message = TwistStamped(header=Header(stamp=stamp, frame_id=CAMERA_FRAME))
    values = list(map(float, twist))
    linear, angular = message.twist.linear, message.twist.angular
    linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = values
    return message


def pose_of(message):
    p, q = message.pose.pose.position, message.pose.pose.orientation
    return Pose.from_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])


class FilterLoop:
    """Sends image lines to an estimator and waits for what it says of them."""

    def __init__(self, ros, paper, **parameters):
        self.ros = ros
        self.states = ros.collect(PoseEstimate, "pose_estimator/state", qos.STATUS)
        self.poses = ros.collect(PoseWithCovarianceStamped, "camera_pose")
        ros.add(PoseEstimatorNode, paper, {"features_timeout": 10.0, **parameters})
        self.features = ros.publisher(LineFeatureArray, "line_features")

    def state_of(self, pose, blind=False):
        stamp = self.ros.node.get_clock().now().to_msg()
        message = features(pose, stamp)
        change(directions=[], moments=[], visible=[0 if blind else 1] * 4)(message)
        self.features.publish(message)
        self.ros.spin_until(
            lambda: self.states and self.states[-1].header.stamp == stamp, "the state of these features"
        )
        return self.states[-1]


def nanoseconds(stamp):
    return 1_000_000_000 * stamp.sec + stamp.nanosec


def test_between_images_the_camera_moves_by_the_measured_twist_not_by_the_commanded_one(ros, paper):
    measured, commanded = np.array([0.1, -0.2, 0.05, 0.02, 0.1, -0.03]), np.array([-1.0, 0.5, 0.3, 0.0, -0.5, 0.2])
    loop = FilterLoop(ros, paper, twist_source="odom_twist", twist_hold=10.0)
    commanded_twists = ros.collect(TwistStamped, "cmd_twist", qos.STATUS)
    odometry, commands = (ros.publisher(TwistStamped, topic) for topic in ("odom_twist", "cmd_twist"))
    first = loop.state_of(CALM)
    assert first.verdict == PoseEstimate.VERDICT_OK
    odometry.publish(stamped(measured, first.header.stamp))
    commands.publish(stamped(commanded, first.header.stamp))
    ros.spin_until(lambda: commanded_twists, "the commanded twist")
    ros.spin_for(0.1)  # topics have no common order
    blind = loop.state_of(CALM, blind=True)
    assert "dead reckoning" in blind.reason
    ros.spin_until(lambda: len(loop.poses) == 2, "the pose without an image")
    moved = CALM.integrate(measured, 1e-9 * (nanoseconds(blind.header.stamp) - nanoseconds(first.header.stamp)))
    found = pose_of(loop.poses[-1])
    np.testing.assert_allclose(found.translation, moved.translation, atol=1e-4)
    np.testing.assert_allclose(found.rotation, moved.rotation, atol=1e-4)


def test_it_stays_lost_where_single_images_do_not_determine_the_pose(ros, paper):
    loop = FilterLoop(ros, paper)
    on_transversal = Pose.look_at(POINT_ON_TRANSVERSAL, np.zeros(3))
    assert loop.state_of(CALM).verdict == PoseEstimate.VERDICT_OK
    for number in range(8):
        state = loop.state_of(on_transversal)
        assert state.verdict == PoseEstimate.VERDICT_LOST
        assert "contradicts" in state.reason
        assert number == 0 or mentions(state.reason, "start", "image")
    assert len(loop.poses) == 1
    ros.spin_for(1.1)  # it does not return to where it was that late
    verdicts = [loop.state_of(CALM).verdict for _ in range(4)]
    assert verdicts[:2] == [PoseEstimate.VERDICT_LOST] * 2
    assert verdicts[-1] == PoseEstimate.VERDICT_OK
    ros.spin_until(lambda: len(loop.poses) > 1, "the pose that was found again")
    np.testing.assert_allclose(pose_of(loop.poses[-1]).translation, CALM.translation, atol=1e-3)


def follow(ros, paper, path, noise):
    """Return the camera_pose of each pose of a path, and the verdicts that were said.

    The simulator moves by the twists; the estimator is told them with an error of 5 %, and no 3-D line.
    """
    generator = np.random.default_rng(1)
    loop = FilterLoop(ros, paper, **{"noise.image": noise, "use_sim_time": True}, twist_source="odom_twist")
    start = {"start.position": path[0].translation.tolist(), "start.orientation": path[0].quaternion_xyzw.tolist()}
    lockstep = {"mode": "lockstep", "publish_clock": True, "noise": noise, "noise_on": "image", "image_only": True}
    ros.add(FeatureSimulatorNode, paper, {**lockstep, **start}, {"camera_pose": "true_camera_pose"})
    odometry, commands = (ros.publisher(TwistStamped, topic) for topic in ("odom_twist", "cmd_twist"))
    found, last = [], 0
    for here, there in pairwise([*path, path[0]]):
        # A frame that was sent again has the same stamp.
        ros.spin_until(
            lambda last=last: loop.poses and nanoseconds(loop.poses[-1].header.stamp) > last, "the next pose"
        )
        found.append(loop.poses[-1])
        stamp = found[-1].header.stamp
        last = nanoseconds(stamp)
        velocity = here.rotation.T @ (there.translation - here.translation) / 0.04
        wrong = 0.05 * np.linalg.norm(velocity) * generator.normal(size=3)
        odometry.publish(stamped([*(velocity + wrong), 0, 0, 0], stamp))
        commands.publish(stamped([*velocity, 0, 0, 0], stamp))
    return found, {each.verdict for each in loop.states if nanoseconds(each.header.stamp)}


def off_by(path, found):
    """Return the errors of the position [m], and of the whole pose in standard deviations."""
    errors, deviations = [], []
    for true, message in zip(path, found, strict=True):
        pose = pose_of(message)
        turn = Rotation.from_matrix(true.rotation @ pose.rotation.T).as_rotvec()
        error = np.concatenate([true.translation - pose.translation, turn])
        covariance = np.reshape(message.pose.covariance, (6, 6))
        errors.append(np.linalg.norm(error[:3]))
        deviations.append(np.sqrt(error @ np.linalg.solve(covariance, error)))
    return errors, deviations


@pytest.mark.parametrize("experiment", EXPERIMENTS[1:3], ids=lambda each: each.name)
def test_along_the_quadrifolia_the_poses_are_right_from_the_first_image_on(ros, paper, experiment):
    path = experiment.poses(200)
    found, verdicts = follow(ros, paper, path, 1e-4)
    assert verdicts == {PoseEstimate.VERDICT_OK}
    errors, deviations = off_by(path, found)
    assert np.quantile(errors, 0.95) < 0.01
    assert max(deviations) < 5.0


@pytest.mark.parametrize(
    ("experiment", "healthy"), zip(EXPERIMENTS[1:3], HEALTHY, strict=True), ids=lambda each: getattr(each, "name", "")
)
def test_along_the_quadrifolia_the_poses_are_right_in_ten_times_the_noise(ros, paper, experiment, healthy):
    """The camera stands until its pose is known to 1 cm, goes to the quadrifolium, and follows it."""
    leaves = experiment.poses(200)
    share = np.concatenate([np.zeros(HELD), np.linspace(0.0, 1.0, ON_THE_WAY, endpoint=False)])[:, np.newaxis]
    way = np.array(healthy) + share * (leaves[0].translation - healthy)
    found, verdicts = follow(ros, paper, [*(Pose(leaves[0].rotation, center) for center in way), *leaves], 1e-3)
    assert verdicts == {PoseEstimate.VERDICT_OK}
    known = np.reshape(found[HELD - 1].pose.covariance, (6, 6))
    assert np.sqrt(np.linalg.eigvalsh(known[:3, :3])[-1]) < 0.01
    errors, deviations = off_by(leaves, found[HELD + ON_THE_WAY :])
    assert np.quantile(errors, 0.95) < 0.03
    assert max(deviations) < 5.0
