# SPDX-License-Identifier: Apache-2.0
"""Properties of the controller's cycle; its behaviour over topics is in test/ros/test_controller.py."""

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from messages import mentions
from strategies import poses, seen_lines, vectors

from plsing_ros.control.servo_controller import Mode, ServoController
from plsing_ros.errors import PlsingError
from plsing_ros.features import (
    LineObservation,
    LinesVerdict,
    interaction_matrix,
    inverse_condition_number,
    project_lines,
)
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation import near_transversal
from plsing_ros.simulation.servo_task import TIME_STEP
from plsing_ros.singularities import singular_set

NOW = 10**12
SCENE = (
    read_scene(config_file("paper_p4l.yaml")),
    Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION),
)


def servo_for(lines, T_world_target, **values):
    return ServoController.from_parameters(
        ControllerParameters(
            lines_points=lines.point.ravel(),
            lines_directions=lines.direction.ravel(),
            target_position=T_world_target.translation,
            target_orientation=T_world_target.quaternion_xyzw,
            **values,
        )
    )


def observation(lines, T_world_camera):
    return LineObservation.of_lines(lines.transformed(T_world_camera.inverse(), "camera"))


@given(in_camera=seen_lines(min_size=4), target=poses(), offset=vectors(6, -1.0, 1.0))
def test_a_small_step_reduces_the_error(in_camera, target, offset):
    start = target.integrate(offset, 1e-3)
    lines = in_camera.transformed(start, "world")
    assume(inverse_condition_number(interaction_matrix(in_camera)) > 1e-3)
    servo = servo_for(lines, target)
    before = servo.answer(observation(lines, start), NOW, NOW)
    assume(before.error_norm > 1e-5)
    moved = start.integrate(before.twist, 1.0)  # 1 s at lambda = 0.1
    after = servo.answer(observation(lines, moved), NOW, NOW)
    assert after.error_norm < 0.95 * before.error_norm


@given(in_camera=seen_lines(min_size=4), start=poses(), offset=vectors(6, -0.05, 0.05), gain=st.floats(0.01, 10.0))
def test_the_twist_is_proportional_to_the_gain(in_camera, start, offset, gain):
    lines = in_camera.transformed(start, "world")
    target = start.integrate(offset, 1.0)
    free = {"max_linear_speed": 0.0, "max_angular_speed": 0.0}
    one, other = (
        servo_for(lines, target, gain=g, **free).answer(observation(lines, start), NOW, NOW).twist for g in (1.0, gain)
    )
    np.testing.assert_allclose(other, gain * one, rtol=1e-9, atol=1e-12)


LAWS = ("pinv", "dls", "adaptive_dls", "guarded", "detour")
anything = st.floats(allow_nan=True, allow_infinity=True, width=64)
options = st.fixed_dictionaries(
    {
        "law": st.sampled_from(LAWS),
        "interaction": st.sampled_from(["auto", "current", "target", "mean"]),
        "pinv_threshold": st.sampled_from([0.0, 1e-12, 1e-3]),
        "gain": st.sampled_from([0.1, 1000.0]),
        "gain_slope": st.sampled_from([0.0, 1.0]),
        "integral_gain": st.sampled_from([0.0, 10.0]),
        "secondary_twist": st.sampled_from([(0.0,) * 6, (1.0, 0.0, 0.0, 0.0, 0.0, 2.0)]),
        "degrees_of_freedom": st.sampled_from([(1,) * 6, (1, 1, 0, 0, 0, 1)]),
        "max_linear_speed": st.sampled_from([0.0, 1e-3]),
        "max_angular_speed": st.sampled_from([0.0, 1e-3]),
        "tool_frame": st.sampled_from(["", "tool"]),
    }
)


def assert_safe(command, parameters):
    """Finite, within the limits, and zero unless it says that it moves."""
    assert np.isfinite(command.twist).all() and np.isfinite(command.output).all()
    linear, angular = parameters.speed_limits
    assert np.linalg.norm(command.twist[:3]) <= linear * (1.0 + 1e-9)
    assert np.linalg.norm(command.twist[3:]) <= angular * (1.0 + 1e-9)
    assert 0.0 <= command.scale <= 1.0
    assert command.mode.moves or (np.all(command.twist == 0.0) and np.all(command.output == 0.0))
    numbers = [command.error_norm, command.gain, command.inverse_condition_number, command.damping]
    assert np.isfinite([*numbers, *command.singular_values, command.path_progress]).all()


def answer(servo, make_observation, stamp, now):
    try:
        return servo.answer(make_observation(), stamp, now)
    except PlsingError as error:
        return servo.halt(str(error))


@st.composite
def garbage(draw):
    """Rows of arbitrary numbers: what a broken tracker sends."""
    n = draw(st.integers(1, 5))
    rows = [np.array(draw(st.lists(anything, min_size=3 * n, max_size=3 * n))).reshape(n, 3) for _ in range(3)]
    ids = tuple(draw(st.lists(st.integers(1, 5), min_size=n, max_size=n)))
    visible = np.array(draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    return lambda: LineObservation.from_rows(ids, *rows, visible, "camera")


@st.composite
def extreme_lines(draw):
    """True lines, but near and far without bounds, alike, parallel, through the centre; with any verdict."""
    n = draw(st.integers(3, 5))
    size = draw(st.sampled_from([1e-9, 1e-3, 1.0, 1e6, 1e150, 1e300]))
    values = st.sampled_from([0.0, 1.0, -1.0, 1e-9]) | st.floats(-1.0, 1.0)
    directions = [draw(st.tuples(values, values, values).filter(any)) for _ in range(n)]
    points = [np.array(draw(st.tuples(values, values, values))) * size for _ in range(n)]
    verdict = draw(st.sampled_from(LinesVerdict))

    def make():
        lines = LineSet.from_points_directions(points, directions, "camera")
        return dataclasses.replace(LineObservation.of_lines(lines), verdict=verdict, verdict_reason="any")

    return make


@st.composite
def images_that_contradict_the_lines(draw):
    """3-D lines of the scene with images that are not theirs."""
    lines, target = SCENE
    seen = lines.transformed(target.integrate(draw(vectors(6, -1.0, 1.0)), 1.0).inverse(), "camera")
    angle, offset = draw(vectors(4, -3.0, 3.0)), draw(vectors(4, -1e6, 1e6))
    image = np.column_stack([np.cos(angle), np.sin(angle), offset])
    return lambda: LineObservation.from_rows(
        seen.ids, image, seen.direction, seen.moment, np.ones(4, dtype=bool), "camera"
    )


@settings(max_examples=200)
@given(
    chosen=options,
    frames=st.lists(
        st.tuples(garbage() | extreme_lines() | images_that_contradict_the_lines(), st.integers(0, 2 * 10**8)),
        min_size=1,
        max_size=3,
    ),
)
def test_whatever_comes_the_twist_is_finite_and_within_the_limits(chosen, frames):
    servo = servo_for(*SCENE, tool_position=(0.1, 0.2, 1e3), **chosen)
    now = NOW
    for make_observation, pause in frames:
        now += pause
        assert_safe(answer(servo, make_observation, now, now), servo.parameters)


@pytest.mark.parametrize("size", [1e150, 1e200, 1e307, 1.7e308])
@pytest.mark.parametrize("law", ["pinv", "guarded"])
def test_an_error_whose_twist_no_number_can_tell_halts_and_a_large_one_does_not(size, law):
    lines, target = SCENE
    seen = observation(lines, target)
    # A target without 3-D lines, which would contradict it.
    far = LineObservation(seen.ids, seen.image_lines * [1, 1, 0] + [0, 0, size], seen.usable, None)
    servo = servo_for(lines, target, law=law, target_source="topic", max_linear_speed=0.1, max_angular_speed=0.1)
    servo.set_target(far)
    command = servo.answer(seen, NOW, NOW)
    assert_safe(command, servo.parameters)
    if size < 1e300:
        assert command.mode is Mode.SERVOING
        assert command.error_norm == pytest.approx(2.0 * size)  # of four lines
    else:
        # The norm of the smaller one can be told, but not the twist.
        assert command.mode is Mode.HALTED
        assert mentions(command.reason, "twist", "not finite")
        assert mentions(command.reason, "error", f"{2.0 * size:.3g}")


@given(stamp=st.integers(-(2**63), 2**63), now=st.integers(0, 2**63))
@example(stamp=-1, now=0)
def test_whatever_the_stamp_the_twist_is_finite(stamp, now):
    servo = servo_for(*SCENE)
    command = servo.answer(observation(SCENE[0], SCENE[1].integrate([0.1, 0, 0, 0, 0, 0], 1.0)), stamp, now)
    assert_safe(command, servo.parameters)
    assert command.mode.moves == (stamp > 0 and -int(1e8) <= now - stamp <= int(2e8))


def test_changed_parameters_act_at_the_next_step_and_bad_ones_change_nothing():
    lines, target = SCENE
    servo = servo_for(lines, target)
    start = target.integrate([0.1, 0, 0, 0, 0, 0], 1.0)
    before = servo.answer(observation(lines, start), NOW, NOW).twist
    servo.parameters = servo.parameters.with_values({"gain": 0.2})
    np.testing.assert_allclose(servo.answer(observation(lines, start), NOW, NOW).twist, 2.0 * before)
    in_a_line_of_three = {
        "lines.points": servo.parameters.lines_points[:9],
        "lines.directions": servo.parameters.lines_directions[:9],
        "target.position": (1.0, 0.0, 0.0),
    }
    with pytest.raises(PlsingError, match="target pose.*2 usable"):
        servo.parameters = servo.parameters.with_values(in_a_line_of_three)
    np.testing.assert_allclose(servo.answer(observation(lines, start), NOW, NOW).twist, 2.0 * before)


def start_pose(number):
    return Pose.from_quaternion(near_transversal.STARTS[number - 1].position, near_transversal.ORIENTATION)


def run_from(number, most, **values):
    """Servo from one of the paper's starts; return distances to the target, linear speeds, and the last command."""
    lines, target = SCENE
    servo = servo_for(lines, target, **values)
    pose = start_pose(number)
    distance, speed = [], []
    for k in range(most):
        distance.append(np.linalg.norm(pose.translation - target.translation))
        if distance[-1] <= near_transversal.ARRIVED:
            break
        now = NOW + round(k * TIME_STEP * 1e9)
        command = servo.answer(observation(lines, pose), now, now)
        assert_safe(command, servo.parameters)
        speed.append(np.linalg.norm(command.twist[:3]))
        pose = pose.integrate(command.twist, TIME_STEP)
    return np.array(distance), np.array(speed), command


# Of the plain law from Start 1.
PLAIN_PEAK, PLAIN_ITERATIONS = 0.0621, 1637


@pytest.mark.parametrize("number", [2, 4])
def test_guarded_goes_straight_where_the_plain_law_runs_away(number):
    distance, speed, _ = run_from(number, 2500, law="guarded")
    assert distance[-1] <= near_transversal.ARRIVED
    assert len(distance) <= 1.5 * PLAIN_ITERATIONS
    assert speed.max() <= 3.0 * PLAIN_PEAK
    assert (np.diff(distance) <= 1e-9).all()


@pytest.mark.parametrize("number", [1, 3])
def test_guarded_leaves_a_healthy_task_as_it_is(number):
    """Where the path is clear the guard is idle, so that the runs are those of the mean of L and L*."""
    lines, target = SCENE
    plain, guarded = servo_for(lines, target, interaction="mean"), servo_for(lines, target, law="guarded")
    distance = []
    pose = start_pose(number)
    for _ in range(60):
        now = observation(lines, pose)
        command = guarded.answer(now, NOW, NOW)
        np.testing.assert_array_equal(command.twist, plain.answer(now, NOW, NOW).twist)
        assert (command.scale, command.saturated) == (1.0, False)
        distance.append(np.linalg.norm(pose.translation - target.translation))
        pose = pose.integrate(command.twist, 1.0)
    assert (np.diff(distance) < 0.0).all() and distance[-1] < 0.01


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_detour_reaches_the_target_from_all_starts(number):
    distance, speed, command = run_from(number, 2500, law="detour")
    assert distance[-1] <= near_transversal.ARRIVED
    assert len(distance) <= 1.5 * PLAIN_ITERATIONS
    assert speed.max() <= 3.0 * PLAIN_PEAK
    assert distance.max() <= 1.2 * distance[0]
    assert command.path_progress > 0.9


@pytest.mark.parametrize(
    ("values", "peak"),
    [
        # Measured with ViSP: 0.146, 0.084 (features (r, a), from which ours differ to second order), 0.186.
        ({"interaction": "target"}, 0.144),
        ({"interaction": "mean"}, 0.0816),
        ({"pinv_threshold": 1e-4}, 0.186),
    ],
)
def test_peaks_of_start_2_are_those_known_of_other_software(values, peak):
    # Every peak comes in the first 140 steps.
    _, speed, _ = run_from(2, 200, **values)
    assert speed.max() == pytest.approx(peak, rel=0.01)


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_the_plain_law_is_that_of_numpy(number):
    servo = servo_for(*SCENE)
    # The very numbers that the controller has: parameters round the lines.
    lines, target = servo.parameters.lines(), servo.parameters.target_pose()
    seen, target_lines = (lines.transformed(each.inverse(), "camera") for each in (start_pose(number), target))
    error = project_lines(seen) - project_lines(target_lines)
    expected = -0.1 * (np.linalg.pinv(interaction_matrix(seen), rcond=1e-12) @ error)
    twist = servo.answer(LineObservation.of_lines(seen), NOW, NOW).twist
    np.testing.assert_allclose(twist, expected, rtol=1e-9, atol=1e-13)


def test_a_target_on_a_transversal_is_refused_or_accepted_on_request():
    lines, target = SCENE
    on_it = Pose(target.rotation, singular_set(lines).transversals[0].point)
    servo = servo_for(lines, on_it)
    command = servo.answer(observation(lines, start_pose(1)), NOW, NOW)
    assert command.mode is Mode.REFUSED and np.all(command.twist == 0.0)
    assert "singularity" in command.reason and "1e-06" in command.reason
    assert mentions(command.reason, "transversal 1")
    servo.parameters = servo.parameters.with_values({"target.min_inverse_condition_number": 0.0})
    assert servo.answer(observation(lines, start_pose(1)), NOW, NOW).mode is Mode.SERVOING


def test_a_threshold_that_stops_the_task_short_is_warned_of():
    lines, target = SCENE
    assert servo_for(lines, target).warning == ""
    warning = servo_for(lines, target, pinv_threshold=1e-3).warning
    assert mentions(warning, "pinv_threshold", 0.001, "target", "inverse condition number", 0.000409)
    distance, _, _ = run_from(1, 1500, pinv_threshold=1e-3)
    assert distance[-1] > 0.1  # it is right


def test_a_target_that_no_pose_reaches_is_a_stall():
    """Five lines, and target images that no camera sees: the error comes to rest above zero."""
    points = [[-1.0, 0, 0], [1.0, 0, 0.5], [0, -1.0, -0.5], [0, 1.0, 0], [0.5, 0.5, 1.0]]
    directions = [[0.2, 1, 0.1], [-0.1, 1, 0.3], [1, 0.2, 0.2], [1, -0.3, 0], [0.3, 0.2, 1]]
    lines = LineSet.from_points_directions(points, directions)
    pose = Pose(np.eye(3), np.array([0.3, 0.2, -4.0]))
    servo = servo_for(lines, pose, gain=5.0, target_source="topic", max_linear_speed=0.0, max_angular_speed=0.0)
    at_target = observation(lines, pose)
    bent = at_target.image_lines + 0.1 * np.array([[0, 0, 1], [0, 0, -1], [0, 0, 1], [0, 0, -1], [0, 0, 1]])
    servo.set_target(LineObservation(at_target.ids, bent, at_target.usable, None))
    modes = []
    for k in range(100):
        now = NOW + k * 4 * 10**7
        command = servo.answer(observation(lines, pose), now, now)
        pose = pose.integrate(command.twist, 0.04)
        modes.append(command.mode)
    assert modes[0] is Mode.SERVOING and modes[-1] is Mode.STALLED
    assert command.error_norm > 0.1
    assert mentions(command.reason, "local minimum", "target")
    servo.set_target(at_target)
    assert servo.answer(observation(lines, pose), now, now).mode is Mode.SERVOING  # a stall can be left


@pytest.mark.parametrize(
    ("verdict", "values", "mode", "scale"),
    [
        (LinesVerdict.OK, {}, Mode.SERVOING, 1.0),
        (LinesVerdict.POOR, {}, Mode.SERVOING, 0.3),
        (LinesVerdict.POOR, {"poor_lines": "halt"}, Mode.HALTED, 1.0),
        (LinesVerdict.AMBIGUOUS, {}, Mode.HALTED, 1.0),
        (LinesVerdict.AMBIGUOUS, {"ambiguous_lines": "slow", "slow_scale": 0.1}, Mode.SERVOING, 0.1),
        (LinesVerdict.AMBIGUOUS, {"ambiguous_lines": "ignore"}, Mode.SERVOING, 1.0),
    ],
)
def test_estimated_lines_are_trusted_as_far_as_they_say(verdict, values, mode, scale):
    seen = dataclasses.replace(observation(SCENE[0], start_pose(1)), verdict=verdict, verdict_reason="two poses fit")
    plain = servo_for(*SCENE).answer(observation(SCENE[0], start_pose(1)), NOW, NOW).twist
    command = servo_for(*SCENE, **values).answer(seen, NOW, NOW)
    assert command.mode is mode
    if mode is Mode.HALTED:
        assert mentions(command.reason, verdict.name, "two poses fit")
    else:
        np.testing.assert_allclose(command.twist, scale * plain)
        assert command.scale == scale


def test_degrees_of_freedom_that_are_not_used_stay_at_rest_and_the_rest_does_its_best():
    lines, target = SCENE
    used = [0, 1, 3, 5]
    servo = servo_for(lines, target, degrees_of_freedom=(1, 1, 0, 1, 0, 1))
    command = servo.answer(observation(lines, start_pose(1)), NOW, NOW)
    seen, target_lines = (lines.transformed(each.inverse(), "camera") for each in (start_pose(1), target))
    error = project_lines(seen) - project_lines(target_lines)
    best = np.linalg.lstsq(interaction_matrix(seen)[:, used], error, rcond=None)[0]
    np.testing.assert_allclose(command.twist[used], -0.1 * best, rtol=1e-6, atol=1e-9)
    assert command.twist[2] == command.twist[4] == 0.0
    assert np.count_nonzero(command.singular_values) == 4


def test_the_integral_removes_what_a_moving_target_leaves_behind():
    """A target that goes on at a constant speed is followed at a distance without the integral, and closely with it."""
    lines, target = SCENE

    def lag(**values):
        servo = servo_for(lines, target, gain=1.0, target_source="topic", **values)
        moving = pose = target
        for k in range(400):
            now = NOW + k * 4 * 10**7
            moving = moving.integrate([0.01, 0.0, 0.0, 0.0, 0.0, 0.0], 0.04)
            servo.set_target(observation(lines, moving))
            pose = pose.integrate(servo.answer(observation(lines, pose), now, now).twist, 0.04)
        return np.linalg.norm(pose.translation - moving.translation)

    assert lag() == pytest.approx(0.01, rel=0.1)  # speed over gain
    assert lag(integral_gain=1.0) < 0.001
