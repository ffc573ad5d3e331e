# SPDX-License-Identifier: Apache-2.0
"""Features that contradict themselves or the scene move nothing, with every law, and the reason names what is wrong."""

import numpy as np
import pytest
from messages import mentions

from plsing_ros.control.command import Mode
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation import near_transversal

NOW = 10**12
LINES = read_scene(config_file("paper_p4l.yaml"))
CAMERA = Pose.from_quaternion([0.9962, -4.437, 7.8], near_transversal.ORIENTATION)
LAWS = ControllerParameters.specifications()["law"][1].choices
ONE = np.array([[-1.0], [1.0], [1.0], [1.0]])


def seen(image=1.0, space=1.0, ids=(1, 2, 3, 4), moment=1.0):
    lines = LINES.transformed(CAMERA.inverse(), "camera")
    right = LineObservation.of_lines(lines)
    changed = LineSet(lines.direction * space, lines.moment * space * moment, "camera", ids)
    return LineObservation(ids, right.image_lines * image, right.usable, changed)


POSITIVE = np.where(seen().image_lines[:, 2:] < 0.0, -1.0, 1.0)
CONTRADICTIONS = {
    "offsets in pixels": (seen(image=np.array([1.0, 1.0, 500.0])), "not in pixels"),
    "one image line negated": (seen(image=ONE), "image line 1"),
    "one line reversed": (seen(image=ONE, space=ONE), "line 1 is reversed"),
    "two ids swapped": (seen(ids=(2, 1, 3, 4)), "lines 1 and 2"),
    "positive offsets": (seen(image=POSITIVE), "turned round"),
    "positive offsets, 3-D lines as well": (seen(image=POSITIVE, space=POSITIVE), "reversed"),
    "depths five times too large": (seen(moment=5.0), "5 times too large"),
}


def servo_with(law, **values):
    task = {
        "lines.points": LINES.point.ravel().tolist(),
        "lines.directions": LINES.direction.ravel().tolist(),
        "target.position": near_transversal.TARGET_POSITION,
        "target.orientation": near_transversal.ORIENTATION,
        "gain": 0.3,
        "max_linear_speed": 0.0,
        "max_angular_speed": 0.0,
    }
    return ServoController.from_parameters(ControllerParameters.from_values({**task, "law": law, **values}))


def answer(servo, observation):
    try:
        return servo.answer(observation, NOW, NOW)
    except ObservationError as error:
        return servo.halt(str(error))


@pytest.mark.parametrize("law", LAWS)
def test_every_contradiction_halts_with_a_reason(law):
    servo = servo_with(law)
    for name, (observation, words) in CONTRADICTIONS.items():
        command = answer(servo, observation)
        assert command.mode is Mode.HALTED and not command.twist.any(), name
        assert words in command.reason, name
    good = answer(servo, seen())
    assert good.mode is Mode.SERVOING and good.twist.any() and good.reason == ""


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_a_target_that_contradicts_is_refused_and_the_one_before_stays(name):
    servo = servo_with("pinv", **{"target.source": "topic"})
    servo.set_target(seen())
    before = servo.target
    with pytest.raises(ObservationError):
        servo.set_target(CONTRADICTIONS[name][0])
    assert servo.target is before


@pytest.mark.parametrize("law", ["pinv", "guarded"])
def test_an_unknown_line_is_left_out_and_named(law):
    extra = LineSet.from_points_directions([[0.0, 0.5, 4.0]], [[1.0, 0.2, 0.0]], "camera", [99])
    right = seen()
    both = LineSet(
        np.vstack([right.lines_camera.direction, extra.direction]),
        np.vstack([right.lines_camera.moment, extra.moment]),
        "camera",
        (*right.ids, 99),
    )
    with_unknown, without = servo_with(law), servo_with(law)
    command, expected = answer(with_unknown, LineObservation.of_lines(both)), answer(without, right)
    np.testing.assert_array_equal(command.twist, expected.twist)
    assert command.mode is Mode.SERVOING and "99" in command.reason
    few = LineObservation.of_lines(both.select([0, 1, 4]))
    halted = answer(with_unknown, few)
    assert halted.mode is Mode.HALTED and mentions(halted.reason, 3)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    "off", [Pose(np.eye(3), [0.0, 0.2, 0.0]), Pose([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], np.zeros(3))]
)
def test_a_camera_pose_that_contradicts_the_3d_lines_halts(law, off):
    servo = servo_with(law, enabled=True)
    command = servo.step(seen(), 1.0, CAMERA @ off)
    assert command.mode is Mode.HALTED and not command.twist.any() and "camera_pose" in command.reason
    assert servo.step(seen(), 1.1, CAMERA).mode is not Mode.HALTED
    # An old pose is none of these features.
    assert servo.step(seen(), 1.2).mode is not Mode.HALTED
