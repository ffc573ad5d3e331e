# SPDX-License-Identifier: Apache-2.0
"""What can go wrong around a controller on a robot, each over real topics."""

import os
import signal

import numpy as np
import pytest
from builders import SCENE, TARGET, compute_plain_twist, features, set_number, start_pose, twist_values
from builtin_interfaces.msg import Time
from controller_loop import ControllerLoop
from geometry_msgs.msg import TwistStamped
from messages import mentions
from nav_msgs.msg import Path
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from plsing_msgs.msg import ControllerState, LineFeatureArray, SingularityStatus
from plsing_msgs.srv import CheckTarget
from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.conversions import header
from plsing_ros.nodes.main import run_node
from plsing_ros.singularities import singular_set

TRANSVERSAL = singular_set(SCENE).transversals[0]
ON_TRANSVERSAL = Pose(TARGET.rotation, TRANSVERSAL.point)


def target_at(pose):
    return {
        "target.position": pose.translation.tolist(),
        "target.orientation": pose.quaternion_xyzw.tolist(),
    }


def assert_servoes(loop):
    command, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_SERVOING
    np.testing.assert_allclose(twist_values(command), compute_plain_twist(start_pose(1)), rtol=1e-6, atol=1e-9)


def assert_all_finite_and_zero_unless_moving(loop):
    moving = {tuple(map(float, compute_plain_twist(start_pose(1))))}
    for each in loop.twists:
        values = twist_values(each)
        assert np.isfinite(values).all()
        assert np.all(values == 0.0) or np.allclose(values, next(iter(moving)), rtol=1e-6, atol=1e-9)


def test_silence_is_zero_without_end_or_as_often_as_asked(ros, paper):
    loop = ControllerLoop(ros, paper, features_timeout=0.5, zero_twists=3, watchdog_period=0.01)
    assert_servoes(loop)
    loop.twists.clear()
    ros.spin_until(lambda: len(loop.twists) >= 3, "three zero twists")
    count = len(loop.states)
    ros.spin_until(lambda: len(loop.states) > count + 10, "the state, which goes on")
    assert len(loop.twists) == 3
    # The first one after a silence moves nothing.
    loop.features.publish(features(start_pose(1), loop.now()))
    ros.spin_until(lambda: "features come every" in loop.states[-1].reason, "an answer to the first features")
    assert_servoes(loop)
    loop.set_parameters(zero_twists=-1)
    loop.twists.clear()
    ros.spin_until(lambda: len(loop.twists) > 10, "zero twists without end")
    assert all(np.all(twist_values(each) == 0.0) for each in loop.twists)


def test_garbage_between_good_frames_is_zero_and_forgotten(ros, paper):
    loop = ControllerLoop(ros, paper)
    for spoil in (
        set_number("moments", 3, float("nan")),
        set_number("directions", 0, 1e300),
        set_number("image_lines", 2, float("inf")),
    ):
        message = features(start_pose(1), loop.now())
        spoil(message)
        command, state = loop.answer(message)
        assert state.mode == ControllerState.MODE_HALTED and np.all(twist_values(command) == 0.0)
        assert_servoes(loop)
    assert_all_finite_and_zero_unless_moving(loop)


def test_lines_of_an_unknown_verdict_are_garbage(ros, paper):
    loop = ControllerLoop(ros, paper)
    message = features(start_pose(1), loop.now())
    message.lines_verdict = 77
    _, state = loop.answer(message)
    assert state.mode == ControllerState.MODE_HALTED and mentions(state.reason, "'lines_verdict'", 77)


def test_ambiguous_lines_are_not_followed(ros, paper):
    loop = ControllerLoop(ros, paper)
    message = features(start_pose(1), loop.now())
    message.lines_verdict, message.lines_reason = LineFeatureArray.LINES_AMBIGUOUS, "two poses fit"
    command, state = loop.answer(message)
    assert state.mode == ControllerState.MODE_HALTED and np.all(twist_values(command) == 0.0)
    assert mentions(state.reason, "AMBIGUOUS", "two poses fit")
    assert_servoes(loop)


@pytest.mark.parametrize("shift", [-3600, 3600])
def test_stamps_that_are_no_good_move_nothing(ros, paper, shift):
    loop = ControllerLoop(ros, paper)
    stamp = loop.now()
    stamp.sec += shift
    command, state = loop.answer(features(start_pose(1), stamp))
    assert state.mode == ControllerState.MODE_HALTED and np.all(twist_values(command) == 0.0)
    assert_servoes(loop)


def test_a_clock_that_jumps_back(ros, paper):
    clock = ros.node.create_publisher(Clock, "/clock", qos.CLOCK)
    loop = ControllerLoop(ros, paper, use_sim_time=True)
    for seconds in (1000.0, 1000.1, 10.0, 10.1):
        message = features(start_pose(1), seconds)
        for _ in range(3):  # best effort
            clock.publish(Clock(clock=message.header.stamp))
            ros.spin_for(0.03)
        loop.features.publish(message)
        # The watchdog's states may have the same stamp.
        ros.spin_until(
            lambda: any(
                each.header.stamp == message.header.stamp and each.mode == ControllerState.MODE_SERVOING
                for each in loop.states
            ),
            f"an answer to the features at {seconds} s",
        )


def test_killed_and_started_again_it_goes_on(ros, paper):
    loop = ControllerLoop(ros, paper)
    assert_servoes(loop)
    ros.remove(loop.node)
    loop.node = ros.add(ControllerNode, paper, {"features_timeout": 5.0})
    ros.spin_until(lambda: loop.features.get_subscription_count() > 0, "the new controller's subscription")
    ros.spin_for(0.1)
    assert_servoes(loop)


def test_switched_off_and_on_in_mid_run(ros, paper):
    loop = ControllerLoop(ros, paper)
    for _ in range(2):
        assert_servoes(loop)
        assert ros.call(SetBool, "controller/enable", SetBool.Request(data=False)).success
        command, state = loop.answer(features(start_pose(1), loop.now()))
        assert state.mode == ControllerState.MODE_DISABLED and np.all(twist_values(command) == 0.0)
        assert ros.call(SetBool, "controller/enable", SetBool.Request(data=True)).success
    assert_servoes(loop)


def test_a_fault_of_its_own_is_zero_and_not_the_end(ros, paper, monkeypatch):
    loop = ControllerLoop(ros, paper)
    assert_servoes(loop)

    def broken(*_):
        raise RuntimeError("a bug")

    with monkeypatch.context() as patch:
        patch.setattr(loop.node._servo, "answer", broken)
        loop.twists.clear()
        loop.features.publish(features(start_pose(1), loop.now()))
        ros.spin_until(lambda: loop.twists, "the twist after the fault")
        assert np.all(twist_values(loop.twists[-1]) == 0.0)
        ros.spin_until(lambda: loop.states[-1].mode == ControllerState.MODE_HALTED, "its state")
        assert mentions(loop.states[-1].reason, "RuntimeError('a bug')")
    assert_servoes(loop)


def test_a_program_that_ends_otherwise_than_by_a_signal_says_zero_first(ros, paper, monkeypatch):
    class EndOfProgram(BaseException):
        """Not an Exception, for those do not end a node."""

    class Faulty(ControllerNode):
        def __init__(self, **options):
            super().__init__(**options)
            self.create_timer(0.1, self._fail)

        def _fail(self):
            if self._state.get_subscription_count():
                raise EndOfProgram

    monkeypatch.setenv("ROS_DOMAIN_ID", str(ros.domain))
    twists = ros.collect(ControllerState, "controller/state", qos.STATUS)
    with pytest.raises(EndOfProgram):
        run_node(Faulty, "", "", ["--ros-args", "--params-file", str(paper)])
    ros.spin_until(lambda: any("shuts down" in each.reason for each in twists), "the last word")


def status(level, stamp, reason="as told"):
    return SingularityStatus(header=header(stamp, "camera_optical_frame"), level=level, reason=reason)


def test_a_gate_names_the_number_of_publishers_when_it_is_not_one(ros, paper):
    loop = ControllerLoop(ros, paper, gate="status", gate_timeout=0.3)

    def reason():
        return loop.answer(features(start_pose(1), loop.now()))[1].reason

    ros.spin_until(lambda: "singularity_status has 0 publishers" in reason(), "the number to be said")
    for _ in range(2):
        forger = ros.publisher(SingularityStatus, "singularity_status", qos.STATUS)
        forger.publish(status(SingularityStatus.LEVEL_CRITICAL, loop.node.now()))
    ros.spin_until(lambda: "singularity_status has 2 publishers" in reason(), "the number to be said")


def test_a_gated_controller_moves_only_with_a_fresh_status(ros, paper):
    loop = ControllerLoop(ros, paper, gate="status", gate_timeout=0.3)
    statuses = ros.publisher(SingularityStatus, "singularity_status", qos.STATUS)

    def say(level):
        statuses.publish(status(level, loop.node.now()))
        ros.spin_for(0.05)

    def state_now():
        return loop.answer(features(start_pose(1), loop.now()))[1]

    assert mentions(state_now().reason, "singularity statuses")
    for level, mode in (
        (SingularityStatus.LEVEL_OK, ControllerState.MODE_SERVOING),
        (SingularityStatus.LEVEL_WARN, ControllerState.MODE_SERVOING),
        (SingularityStatus.LEVEL_CRITICAL, ControllerState.MODE_HALTED),
        (SingularityStatus.LEVEL_STALE, ControllerState.MODE_HALTED),
        (SingularityStatus.LEVEL_OK, ControllerState.MODE_SERVOING),
    ):
        say(level)
        assert state_now().mode == mode
    # The monitor dies: nothing more is heard of it.
    ros.spin_for(0.4)
    command, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_HALTED and np.all(twist_values(command) == 0.0)
    assert mentions(state.reason, "singularity statuses")
    say(SingularityStatus.LEVEL_OK)
    assert_servoes(loop)


def test_a_target_that_changes_in_mid_run(ros, paper):
    loop = ControllerLoop(ros, paper)
    assert_servoes(loop)
    loop.set_parameters(**target_at(start_pose(1)))
    _, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_CONVERGED
    loop.set_parameters(**target_at(TARGET))
    assert_servoes(loop)


def test_a_target_that_changes_on_its_topic_in_mid_run(ros, paper):
    loop = ControllerLoop(ros, paper, **{"target.source": "topic"})
    desired = ros.publisher(LineFeatureArray, "desired_line_features", qos.LATCHED)

    def state_with(message):
        desired.publish(message)
        ros.spin_for(0.1)
        return loop.answer(features(start_pose(1), loop.now()))[1]

    assert state_with(features(TARGET, 0)).mode == ControllerState.MODE_SERVOING
    assert state_with(features(start_pose(1), 0)).mode == ControllerState.MODE_CONVERGED
    # One that cannot be used leaves the target as it was.
    assert state_with(features(TARGET, 0, ids=(1, 2))).mode == ControllerState.MODE_CONVERGED
    assert state_with(features(TARGET, 0)).mode == ControllerState.MODE_SERVOING


def test_a_target_out_of_reach_is_said_to_be(ros, paper):
    loop = ControllerLoop(
        ros, paper, **{"target.source": "topic", "stall.ratio": 1.0, "stall.time": 0.1, "max_linear_speed": 1e-9}
    )
    desired = ros.publisher(LineFeatureArray, "desired_line_features", qos.LATCHED)
    impossible = features(TARGET, 0)
    impossible.image_lines[2] += 5.0
    impossible.directions, impossible.moments = [], []  # which would contradict the image
    desired.publish(impossible)
    ros.spin_for(0.1)
    for _ in range(3):
        _, state = loop.answer(features(start_pose(1), loop.now()))
        ros.spin_for(0.1)
    assert state.mode == ControllerState.MODE_STALLED
    assert mentions(state.reason, "local minimum", "target")
    assert mentions(state.reason, "transversal 1")


def test_a_target_on_a_singularity_is_refused_or_accepted_on_request(ros, paper):
    loop = ControllerLoop(ros, paper, **target_at(ON_TRANSVERSAL))
    command, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_REFUSED and np.all(twist_values(command) == 0.0)
    assert mentions(state.reason, "target", "singularity", "transversal 1")
    loop.set_parameters(**{"target.min_inverse_condition_number": 0.0})
    command, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_SERVOING and np.any(twist_values(command) != 0.0)


def test_the_state_says_what_the_law_did(ros, paper):
    loop = ControllerLoop(ros, paper, law="guarded", max_linear_speed=0.01)
    command, state = loop.answer(features(start_pose(4), loop.now()))
    assert (state.law, state.gain, state.saturated) == ("guarded", 0.1, True)
    assert state.linear_speed == pytest.approx(0.01)
    assert 0.0 < state.scale <= 1.0
    values = list(state.singular_values)
    assert values == sorted(values, reverse=True) and values[-1] > 0.0
    assert state.inverse_condition_number == pytest.approx(values[-1] / values[0])
    loop.set_parameters(law="dls")
    _, state = loop.answer(features(start_pose(4), loop.now()))
    assert state.law == "dls" and state.damping > 0.0


def test_the_twist_of_a_tool(ros, paper):
    """A camera half a metre ahead of the tool, looking the same way, with the tool's axes turned by a right angle."""
    turned = {"T_tool_camera.position": [0.0, 0.0, 0.5], "T_tool_camera.orientation": [0.0, 0.0, 0.5**0.5, 0.5**0.5]}
    loop = ControllerLoop(ros, paper, tool_frame="tool0", **turned)
    command, state = loop.answer(features(start_pose(1), loop.now()))
    assert command.header.frame_id == "tool0"
    v, w = np.split(compute_plain_twist(start_pose(1)), 2)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    expected = np.concatenate([turn @ v + np.cross([0.0, 0.0, 0.5], turn @ w), turn @ w])
    np.testing.assert_allclose(twist_values(command), expected, rtol=1e-6, atol=1e-9)
    assert state.linear_speed == pytest.approx(np.linalg.norm(v))


def test_a_detour_is_published_and_followed(ros, paper):
    loop = ControllerLoop(ros, paper, law="detour")
    paths = ros.collect(Path, "controller/planned_path", qos.LATCHED)

    def planned():
        # It stands still until the plan is there.
        command, state = loop.answer(features(start_pose(2), loop.now()))
        assert state.mode == ControllerState.MODE_SERVOING or not twist_values(command).any()
        return state.mode == ControllerState.MODE_SERVOING and paths and paths[-1].poses

    ros.spin_until(planned, "the path", 60.0)
    position = [paths[-1].poses[end].pose.position for end in (0, -1)]
    for p, pose in zip(position, (start_pose(2), TARGET), strict=True):
        np.testing.assert_allclose([p.x, p.y, p.z], pose.translation, atol=1e-6)
    for _ in range(3):
        ros.spin_for(0.05)
        command, state = loop.answer(features(start_pose(2), loop.now()))
    assert state.mode == ControllerState.MODE_SERVOING and state.path_progress > 0.0
    assert 0.0 < state.linear_speed <= 0.15
    assert len(paths) == 1


def question(target, start=None):
    request = CheckTarget.Request(from_present=start is None)
    for message, pose in ((request.target.pose, target), (request.start.pose, start)):
        if pose is not None:
            p, q = message.position, message.orientation
            p.x, p.y, p.z = map(float, pose.translation)
            q.x, q.y, q.z, q.w = map(float, pose.quaternion_xyzw)
    return request


def test_a_target_can_be_asked_about_before_going_there(ros, paper):
    loop = ControllerLoop(ros, paper, law="detour")

    def ask(*poses):
        return ros.call(CheckTarget, "controller/check_target", question(*poses))

    assert not ask(TARGET).success  # nothing seen yet
    assert mentions(ask(TARGET).message, "camera", "not known")
    clear, blocked, singular = ask(TARGET, start_pose(1)), ask(TARGET, start_pose(2)), ask(ON_TRANSVERSAL, TARGET)
    assert (clear.success, clear.decision) == (True, CheckTarget.Response.DECISION_STRAIGHT)
    assert blocked.decision == CheckTarget.Response.DECISION_DETOUR and "transversal 1" in blocked.reason
    assert blocked.straight_nearest.name == "transversal 1"
    assert blocked.target_inverse_condition_number == pytest.approx(4.09e-4, rel=1e-2)
    assert len(blocked.path.poses) > 2 and blocked.path.header.frame_id == "world"
    assert singular.decision == CheckTarget.Response.DECISION_REFUSE and not singular.path.poses
    loop.answer(features(start_pose(2), loop.now()))
    assert ask(TARGET).decision == CheckTarget.Response.DECISION_DETOUR
    no_pose = CheckTarget.Request(from_present=True)
    no_pose.target.pose.orientation.w = 0.0
    answer = ros.call(CheckTarget, "controller/check_target", no_pose)
    assert not answer.success and mentions(answer.message, "length 0", 1)


def test_features_are_answered_while_a_target_is_looked_into(ros, paper):
    loop = ControllerLoop(ros, paper)
    client = ros.node.create_client(CheckTarget, "controller/check_target")
    ros.spin_until(client.service_is_ready, "the service")
    ros.spin_for(0.2)
    loop.node._planner.start()
    os.kill(loop.node._planner._process.pid, signal.SIGSTOP)
    try:
        answer = client.call_async(question(TARGET, start_pose(2)))
        for _ in range(3):
            ros.spin_for(0.1)
            command, state = loop.answer(features(start_pose(1), loop.now()))
            assert state.mode == ControllerState.MODE_SERVOING and twist_values(command).any()
        assert not answer.done()
    finally:
        os.kill(loop.node._planner._process.pid, signal.SIGCONT)
    ros.spin_until(answer.done, "the answer", 60.0)
    assert answer.result().decision == CheckTarget.Response.DECISION_DETOUR


def test_live_changes_reach_the_law(ros, paper):
    loop = ControllerLoop(ros, paper)
    assert_servoes(loop)
    loop.set_parameters(gain=0.2)
    command, _ = loop.answer(features(start_pose(1), loop.now()))
    np.testing.assert_allclose(twist_values(command), 2.0 * compute_plain_twist(start_pose(1)), rtol=1e-6, atol=1e-9)
    result = loop.node.set_parameters_atomically([Parameter("gain_slope", value=1.0), Parameter("gain", value=0.01)])
    assert not result.successful and "gain_at_infinity" in result.reason
    command, _ = loop.answer(features(start_pose(1), loop.now()))
    np.testing.assert_allclose(twist_values(command), 2.0 * compute_plain_twist(start_pose(1)), rtol=1e-6, atol=1e-9)


def test_a_second_publisher_is_named_in_the_state(ros, paper):
    loop = ControllerLoop(ros, paper)
    publisher = ros.publisher(TwistStamped, "cmd_twist")

    def named():
        _, state = loop.answer(features(start_pose(1), loop.now()))
        return state.mode == ControllerState.MODE_SERVOING and "cmd_twist has 2 publishers" in state.reason

    ros.spin_until(named, "the second publisher's name in the state")
    ros.node.destroy_publisher(publisher)
    ros.spin_until(lambda: not named(), "a state without it")


@pytest.mark.parametrize("time", [Time(sec=-1), Time(sec=-(2**31))])
def test_a_clock_that_says_no_time_ends_nothing(ros, paper, time):
    clock = ros.node.create_publisher(Clock, "/clock", qos.CLOCK)
    loop = ControllerLoop(ros, paper, use_sim_time=True)
    good = features(start_pose(1), 1000.0)
    for each in (time, good.header.stamp, time):
        for _ in range(3):  # best effort
            clock.publish(Clock(clock=each))
            ros.spin_for(0.03)
    loop.features.publish(good)
    # The watchdog's states may have the same stamp.
    ros.spin_until(
        lambda: any(each.mode == ControllerState.MODE_SERVOING for each in loop.states), "an answer to the features"
    )


def test_reasons_have_no_control_characters_and_an_end(ros, paper):
    loop = ControllerLoop(ros, paper)
    message = features(start_pose(1), loop.now())
    message.lines_verdict, message.lines_reason = LineFeatureArray.LINES_AMBIGUOUS, "\x1b[2J\n" + 1000 * "x"
    _, state = loop.answer(message)
    assert state.reason.isprintable() and len(state.reason) < 400


def test_one_stray_frame_changes_nothing(ros, paper):
    loop = ControllerLoop(ros, paper)
    assert_servoes(loop)
    count = len(loop.states)
    stray = loop.now()
    stray.sec -= 3600
    loop.features.publish(features(start_pose(1), stray))
    assert_servoes(loop)
    assert len(loop.states) == count + 1


def test_it_may_start_switched_off(ros, paper):
    loop = ControllerLoop(ros, paper, enabled=False)
    _, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_DISABLED
    assert ros.call(SetBool, "controller/enable", SetBool.Request(data=True)).success
    assert_servoes(loop)
