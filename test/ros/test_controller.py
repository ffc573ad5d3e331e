# SPDX-License-Identifier: Apache-2.0
"""The controller by itself: the law, the target, and every reason not to move."""

import numpy as np
import pytest
from builders import TARGET, change, compute_plain_twist, features, seen, set_number, start_pose, time_of, twist_values
from controller_loop import ControllerLoop
from messages import mentions
from std_srvs.srv import SetBool

from plsing_msgs.msg import ControllerState, LineFeatureArray, SingularityStatus
from plsing_ros.features import interaction_matrix
from plsing_ros.nodes import qos
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode


@pytest.fixture
def loop(ros, paper):
    return ControllerLoop(ros, paper)


def assert_halts(loop, message, *words):
    command, state = loop.answer(message)
    assert np.all(twist_values(command) == 0.0)
    assert state.mode == ControllerState.MODE_HALTED
    for word in words:
        assert word in state.reason


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_commands_the_law_of_the_paper(loop, number):
    command, state = loop.answer(features(start_pose(number), loop.now()))
    expected = compute_plain_twist(start_pose(number))
    np.testing.assert_allclose(twist_values(command), expected, rtol=1e-6, atol=1e-9)
    assert command.header.frame_id == "camera_optical_frame"
    assert (state.mode, state.reason) == (ControllerState.MODE_SERVOING, "")
    assert state.linear_speed == pytest.approx(np.linalg.norm(expected[:3]))
    assert 1e-4 < state.inverse_condition_number < 1e-3


def test_is_converged_at_the_target(loop):
    command, state = loop.answer(features(TARGET, loop.now()))
    assert state.mode == ControllerState.MODE_CONVERGED and state.error_norm < 1e-9
    np.testing.assert_allclose(twist_values(command), 0.0, atol=1e-6)


def test_matches_lines_by_id_in_any_order_and_number(loop):
    reordered = features(start_pose(1), loop.now(), ids=(3, 1, 4, 2))
    np.testing.assert_allclose(
        twist_values(loop.answer(reordered)[0]), compute_plain_twist(start_pose(1)), rtol=1e-6, atol=1e-9
    )
    three, state = loop.answer(features(start_pose(1), loop.now(), ids=(1, 2, 4)))
    assert state.mode == ControllerState.MODE_SERVOING and np.any(twist_values(three) != 0.0)


def test_a_target_from_a_topic(ros, paper):
    loop = ControllerLoop(ros, paper, **{"target.source": "topic"})
    loop.features.publish(features(start_pose(1), loop.now()))
    loop.ros.spin_until(lambda: loop.states and "no desired features" in loop.states[-1].reason, "the missing target")
    assert loop.states[-1].mode == ControllerState.MODE_WAITING
    desired = loop.ros.publisher(LineFeatureArray, "desired_line_features", qos.LATCHED)
    desired.publish(features(TARGET, 0))
    loop.ros.spin_for(0.2)
    command, state = loop.answer(features(start_pose(1), loop.now()))
    np.testing.assert_allclose(twist_values(command), compute_plain_twist(start_pose(1)), rtol=1e-6, atol=1e-9)


def test_commands_nothing_before_any_features(loop):
    loop.ros.spin_until(lambda: len(loop.states) >= 2, "the watchdog")
    assert loop.states[-1].mode == ControllerState.MODE_WAITING
    assert "features" in loop.states[-1].reason
    assert loop.twists == []


def test_silence_after_unusable_features_names_them(ros, paper):
    loop = ControllerLoop(ros, paper, features_timeout=0.5)
    bad = features(start_pose(1), loop.now(), ids=(1, 2))
    assert_halts(loop, bad, "only 2 usable")
    loop.ros.spin_until(lambda: "refused for" in loop.states[-1].reason, "the watchdog")
    assert mentions(loop.states[-1].reason, "2 usable")


def test_commands_zero_when_features_stop(ros, paper):
    loop = ControllerLoop(ros, paper, features_timeout=0.5)
    loop.answer(features(start_pose(1), loop.now()))
    loop.ros.spin_until(lambda: loop.states[-1].mode == ControllerState.MODE_HALTED, "the watchdog")
    assert mentions(loop.states[-1].reason, "features", "0.5 s")
    assert np.all(twist_values(loop.twists[-1]) == 0.0)
    # A halt can be left, by features that come often enough.
    _, state = loop.answer(features(start_pose(1), loop.now()))
    assert mentions(state.reason, "features", "features_timeout", "0.5 s")
    _, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_SERVOING


def set_frame(message):
    message.header.frame_id = "base_link"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (set_number("image_lines", 4, float("nan")), ("image_lines[1, 1] is nan",)),
        (set_number("directions", 0, float("inf")), ("directions[0, 0] is inf",)),
        (set_number("moments", 11, -float("inf")), ("moments[3, 2] is -inf",)),
        (set_number("directions", 0, 5.0), ("line 1: direction", "expected 1")),
        (set_number("image_lines", 0, 7.0), ("image line 1", "normalised")),
        (change(image_lines=[1.0] * 11), ("'image_lines'", "11 numbers for 4 lines; expected 12")),
        (change(directions=[1.0] * 3), ("'directions'", "expected 0 or 12")),
        (change(directions=[], moments=[]), ("no 3-D lines",)),
        (change(visible=[1, 1]), ("'visible'", "expected 0 or 4")),
        (change(visible=[1, 1, 0, 0]), ("only 2 usable", "at least 3")),
        (change(visible=[0, 0, 0, 0]), ("none of the observed lines is usable",)),
        (change(ids=[1, 2, 2, 4]), ("id 2 is given to more than one line",)),
        (change(ids=[7, 8, 9, 10]), ("only 0 usable", "target: [1, 2, 3, 4]")),
        (change(ids=[]), ("no lines",)),
        (set_frame, ("frame 'base_link', expected 'camera_optical_frame'",)),
    ],
)
def test_unusable_features_command_zero_and_say_why(loop, spoil, words):
    message = features(start_pose(1), loop.now())
    spoil(message)
    assert_halts(loop, message, *words)
    _, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_SERVOING


def test_stamps_that_are_not_to_be_trusted_command_zero(loop):
    assert_halts(loop, features(start_pose(1), 0), "no stamp")
    assert_halts(loop, features(start_pose(1), 12.5), "s old, allowed are 5 s", "use_sim_time")
    ahead = loop.now()
    ahead.sec += 100
    assert_halts(loop, features(start_pose(1), ahead), "ahead of the clock", "use_sim_time")


def test_switched_off_it_commands_zero_until_switched_on(loop):
    assert loop.ros.call(SetBool, "controller/enable", SetBool.Request(data=False)).success
    command, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_DISABLED and np.all(twist_values(command) == 0.0)
    assert loop.ros.call(SetBool, "controller/enable", SetBool.Request(data=True)).success
    command, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_SERVOING


def test_stopping_commands_zero(loop):
    loop.answer(features(start_pose(1), loop.now()))
    loop.twists.clear()
    loop.node.stop()
    loop.ros.spin_until(lambda: loop.twists, "the last twist")
    assert np.all(twist_values(loop.twists[0]) == 0.0)


def test_stamp_of_the_answer_is_that_of_the_features(loop):
    stamp = loop.now()
    command, state = loop.answer(features(start_pose(1), stamp))
    assert command.header.stamp == state.header.stamp == time_of(stamp)


def test_a_target_pose_is_told_to_the_monitor(ros, paper):
    """Latched as desired_line_features, so that thresholds relative to the target need no second configuration."""
    desired = ros.collect(LineFeatureArray, "desired_line_features", qos.LATCHED)
    statuses = ros.collect(SingularityStatus, "singularity_status", qos.STATUS)
    loop = ControllerLoop(ros, paper)
    ros.add(SingularityMonitorNode, paper, {"target.known": False, "features_timeout": 5.0})
    ros.spin_until(lambda: desired, "the target")
    assert desired[0].image_lines == pytest.approx(features(TARGET, 0).image_lines)
    ros.spin_until(lambda: loop.features.get_subscription_count() == 2, "the monitor to listen")
    ros.spin_for(0.1)
    loop.answer(features(start_pose(1), loop.now()))
    ros.spin_until(lambda: statuses and statuses[-1].target_valid, "a status that knows the target")
    target = np.linalg.svd(interaction_matrix(seen(TARGET)), compute_uv=False)
    assert statuses[-1].target_inverse_condition_number == pytest.approx(target[-1] / target[0], rel=1e-6)
    loop.set_parameters(**{"target.position": start_pose(3).translation.tolist()})
    ros.spin_until(lambda: len(desired) == 2, "the new target")
    assert desired[1].image_lines == pytest.approx(features(start_pose(3), 0).image_lines)
