# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from builders import CAMERA_FRAME, change, features, set_number
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from messages import mentions

from plsing_msgs.msg import ControllerState, LineFeatureArray, PoseEstimate, SingularityStatus
from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.pose_estimator import PoseEstimatorNode
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode

CALM = Pose.look_at([5.0, 2.0, 3.0], [0.0, 0.0, 3.0], down=[0.0, 0.0, -1.0])
IMAGE_ONLY = change(directions=[], moments=[])


class EstimatorLoop:
    """Sends image lines to an estimator and receives what it says of them."""

    def __init__(self, ros, paper, **parameters):
        self.ros = ros
        self.poses = ros.collect(PoseWithCovarianceStamped, "camera_pose")
        self.completed = ros.collect(LineFeatureArray, "completed_line_features")
        self.states = ros.collect(PoseEstimate, "pose_estimator/state", qos.STATUS)
        self.node = ros.add(PoseEstimatorNode, paper, {"features_timeout": 5.0, **parameters})
        self.features = ros.publisher(LineFeatureArray, "line_features")

    def state_of(self, pose, spoil=IMAGE_ONLY, stamp=None):
        """Send what a camera there sees, and return the state that answers it."""
        stamp = self.ros.node.get_clock().now().to_msg() if stamp is None else stamp
        message = features(pose, stamp)
        spoil(message)
        self.features.publish(message)
        self.ros.spin_until(
            lambda: self.states and self.states[-1].header.stamp == stamp, "the state of these features"
        )
        return self.states[-1]


@pytest.fixture
def loop(ros, paper):
    return EstimatorLoop(ros, paper)


def test_image_lines_give_a_pose_and_features_with_lines_in_space(loop):
    state = loop.state_of(CALM)
    assert (state.verdict, state.reason, state.covariance_trusted) == (PoseEstimate.VERDICT_OK, "", True)
    loop.ros.spin_until(lambda: loop.poses and loop.completed, "the pose and the completed features")
    message = loop.poses[-1]
    p = message.pose.pose.position
    assert [p.x, p.y, p.z] == pytest.approx(CALM.translation, abs=1e-8)
    assert message.header.frame_id == "world"
    assert message.header.stamp == state.header.stamp
    covariance = np.reshape(message.pose.covariance, (6, 6))
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    truth = features(CALM, state.header.stamp)
    completed = loop.completed[-1]
    assert completed.header == truth.header
    assert list(completed.ids) == list(truth.ids)
    assert completed.lines_verdict == LineFeatureArray.LINES_OK
    assert completed.directions == pytest.approx(truth.directions, abs=1e-8)
    assert completed.moments == pytest.approx(truth.moments, abs=1e-8)


def test_a_pose_that_is_uncertain_is_given_with_that_verdict(ros, paper):
    loop = EstimatorLoop(ros, paper, **{"poor.position_deviation": 1e-8})
    state = loop.state_of(CALM)
    assert state.verdict == PoseEstimate.VERDICT_POOR
    assert mentions(state.reason, "position")
    ros.spin_until(lambda: loop.completed and loop.poses, "the pose and the completed features")
    assert loop.completed[-1].lines_verdict == LineFeatureArray.LINES_POOR
    assert loop.completed[-1].lines_reason == state.reason


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (set_number("image_lines", 4, float("nan")), "image_lines[1, 1] is nan"),
        (change(ids=[1, 2, 3, 77]), "line id 77 is not in the scene"),
        (change(ids=[1, 2, 3, 3]), "id 3 is given to more than one line"),
        (change(visible=[1, 1, 0, 0]), "2 usable line(s)"),
        (change(image_lines=[1.0] * 9), "'image_lines' of the feature message has 9 numbers"),
    ],
)
def test_features_that_give_no_pose_are_answered_with_the_reason_only(loop, spoil, words):
    state = loop.state_of(CALM, spoil)
    assert state.verdict == PoseEstimate.VERDICT_FAILED
    assert words in state.reason
    loop.ros.spin_for(0.1)
    assert not loop.poses
    # What is an image all the same goes on without 3-D lines, and says why.
    for completed in loop.completed:
        assert not completed.directions and not completed.moments
        assert mentions(completed.lines_reason, "pose", state.reason)
    assert bool(loop.completed) == (words == "2 usable line(s)")
    assert loop.state_of(CALM).verdict == PoseEstimate.VERDICT_OK


def test_silence_is_told_and_the_node_recovers(ros, paper):
    loop = EstimatorLoop(ros, paper, features_timeout=0.5)
    assert loop.state_of(CALM).verdict == PoseEstimate.VERDICT_OK
    ros.spin_until(lambda: loop.states[-1].verdict == PoseEstimate.VERDICT_FAILED, "the silence to be told")
    assert mentions(loop.states[-1].reason, "features")
    assert loop.state_of(CALM).verdict == PoseEstimate.VERDICT_OK


def test_diagnostics_tell_the_verdict(loop):
    diagnostics = loop.ros.collect(DiagnosticArray, "/diagnostics", qos.STATUS)
    loop.state_of(CALM)
    loop.ros.spin_until(
        lambda: diagnostics and diagnostics[-1].status[0].message == "OK", "diagnostics with the verdict"
    )
    values = {each.key: each.value for each in diagnostics[-1].status[0].values}
    assert values["covariance"] == "trusted"


def test_the_chain_runs_on_image_lines_alone(ros, paper):
    """No topic but the estimator's carries a pose or a 3-D line; the twists are those of the ground truth."""
    completed = {"line_features": "completed_line_features"}
    lockstep = {"mode": "lockstep", "publish_clock": True}
    sim_time = {"use_sim_time": True}
    seen = ros.collect(LineFeatureArray, "line_features")
    estimates = ros.collect(PoseEstimate, "pose_estimator/state", qos.STATUS)
    twists = ros.collect(TwistStamped, "cmd_twist", qos.STATUS)
    states = ros.collect(ControllerState, "controller/state", qos.STATUS)
    statuses = ros.collect(SingularityStatus, "singularity_status", qos.STATUS)
    target = Pose.look_at([4.6, 2.2, 3.1], [0.0, 0.0, 3.0], down=[0.0, 0.0, -1.0])
    to_target = {
        "target.position": target.translation.tolist(),
        "target.orientation": target.quaternion_xyzw.tolist(),
    }
    ros.add(SingularityMonitorNode, paper, {**sim_time, **to_target}, completed)
    ros.add(ControllerNode, paper, {**sim_time, **to_target, "gain": 0.5}, completed)
    ros.add(PoseEstimatorNode, paper, sim_time)
    start = {"start.position": CALM.translation.tolist(), "start.orientation": CALM.quaternion_xyzw.tolist()}
    ros.add(FeatureSimulatorNode, paper, {**lockstep, **start, "image_only": True}, {"camera_pose": "true_camera_pose"})
    ros.spin_until(lambda: len(twists) >= 40, "forty twists", timeout=30.0)
    assert all(len(each.directions) == len(each.moments) == 0 for each in seen)
    assert {each.verdict for each in estimates if each.header.stamp.sec > 0} == {PoseEstimate.VERDICT_OK}
    answered = [each for each in states if each.mode == ControllerState.MODE_SERVOING]
    assert answered[-1].error_norm < 0.6 * answered[0].error_norm
    assert twists[-1].header.frame_id == CAMERA_FRAME
    assert statuses[-1].distances_valid
