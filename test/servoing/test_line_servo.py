"""Properties of the controller's cycle; its behaviour over topics is in test/ros/test_controller.py."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from strategies import poses, seen_lines, vectors

from plsing_ros.errors import PlsingError
from plsing_ros.experiments import near_transversal
from plsing_ros.experiments.config_files import config_file
from plsing_ros.features import LineObservation, interaction_matrix, inverse_condition_number
from plsing_ros.geometry import Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters import ControllerParameters
from plsing_ros.servoing.line_servo import LineServo, Mode

NOW = 10**12
SCENE = (
    read_scene(config_file("paper_p4l.yaml")),
    Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION),
)


def servo_for(lines, T_world_target, **values):
    return LineServo(
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
    start = target.moved(offset, 1e-3)
    lines = in_camera.transformed(start, "world")
    assume(inverse_condition_number(interaction_matrix(in_camera)) > 1e-3)
    servo = servo_for(lines, target)
    before = servo.step(observation(lines, start), NOW, NOW)
    assume(before.error_norm > 1e-5)
    moved = start.moved(before.twist, 1.0)  # 1 s at lambda = 0.1
    after = servo.step(observation(lines, moved), NOW, NOW)
    assert after.error_norm < 0.95 * before.error_norm


@given(in_camera=seen_lines(min_size=4), start=poses(), offset=vectors(6, -0.05, 0.05), gain=st.floats(0.01, 10.0))
def test_the_twist_is_proportional_to_the_gain(in_camera, start, offset, gain):
    lines = in_camera.transformed(start, "world")
    target = start.moved(offset, 1.0)
    one, other = (servo_for(lines, target, gain=g).step(observation(lines, start), NOW, NOW).twist for g in (1.0, gain))
    np.testing.assert_allclose(other, gain * one, rtol=1e-9, atol=1e-12)


anything = st.floats(allow_nan=True, allow_infinity=True, width=64)


@settings(max_examples=300)
@given(data=st.data(), n=st.integers(1, 5))
def test_garbage_never_gives_a_twist_that_is_not_finite(data, n):
    """Arbitrary numbers through the whole step: a finite command, or an error that says what was wrong."""
    rows = {
        name: np.array(data.draw(st.lists(anything, min_size=3 * n, max_size=3 * n))).reshape(n, 3)
        for name in ("image_lines", "directions", "moments")
    }
    ids = tuple(data.draw(st.lists(st.integers(1, 5), min_size=n, max_size=n)))
    visible = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    servo = servo_for(*SCENE)
    try:
        command = servo.step(
            LineObservation.from_rows(ids, rows["image_lines"], rows["directions"], rows["moments"], visible, "camera"),
            data.draw(st.integers(-(2**63), 2**63)),
            NOW,
        )
    except PlsingError as error:
        command = servo.halt(str(error))
    assert np.isfinite(command.twist).all()
    assert command.mode is Mode.SERVOING or np.all(command.twist == 0.0)


@settings(max_examples=300)
@given(scale=st.floats(1e-300, 1e300), noise=vectors(3, -1.0, 1.0), row=st.integers(0, 3))
def test_lines_at_absurd_distances_never_give_a_twist_that_is_not_finite(scale, noise, row):
    lines, target = SCENE
    seen = lines.transformed(target.inverse(), "camera")
    moment = seen.moment.copy()
    across = np.cross(seen.direction[row], noise)
    with np.errstate(over="ignore"):
        moment[row] = across * scale
    servo = servo_for(lines, target)
    try:
        image = LineObservation.of_lines(seen).image_lines
        servo_input = LineObservation.from_rows(
            lines.ids, image, seen.direction, moment, np.ones(4, dtype=bool), "camera"
        )
        command = servo.step(servo_input, NOW, NOW)
    except PlsingError as error:
        command = servo.halt(str(error))
    assert np.isfinite(command.twist).all()


def test_changed_parameters_act_at_the_next_step_and_bad_ones_change_nothing():
    lines, target = SCENE
    servo = servo_for(lines, target)
    start = target.moved([0.1, 0, 0, 0, 0, 0], 1.0)
    before = servo.step(observation(lines, start), NOW, NOW).twist
    servo.parameters = servo.parameters.with_values({"gain": 0.2})
    np.testing.assert_allclose(servo.step(observation(lines, start), NOW, NOW).twist, 2.0 * before)
    in_a_line_of_three = {
        "lines.points": servo.parameters.lines_points[:9],
        "lines.directions": servo.parameters.lines_directions[:9],
        "target.position": (1.0, 0.0, 0.0),
    }
    with pytest.raises(PlsingError, match="target pose: only 2 usable"):
        servo.parameters = servo.parameters.with_values(in_a_line_of_three)
    np.testing.assert_allclose(servo.step(observation(lines, start), NOW, NOW).twist, 2.0 * before)
