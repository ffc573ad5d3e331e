# SPDX-License-Identifier: Apache-2.0
"""A closed gate can be left: slowly, and only where the condition rises."""

import numpy as np
import pytest
from messages import mentions

from plsing_ros.control.command import Command, Mode
from plsing_ros.control.gate_exit import LEAVING_SPEED, leave
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.features import LineObservation, interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.levels import Level
from plsing_ros.parameters import ControllerParameters

SCENE = LineSet.from_points_directions(
    [[0, 0, 0], [0, 0, 2], [3, 5, 0], [0, 1, 7]], [[1, 0, 0], [4, -5, 0], [3, 7, 3], [-2, 1, 13]]
)
# On the transversal L_M of the paper's four lines, and beside it.
CENTER = np.array([0.3962, -4.337, 7.50])
LOOK = Pose.look_at(CENTER, [0.0, 0.0, 0.0]).rotation
NEAR = Pose(LOOK, CENTER + [0.01, -0.01, 0.01])
SECOND = 10**9


def seen(pose):
    return SCENE.transformed(pose.inverse(), "camera")


def inverse_condition(pose):
    values = np.linalg.svd(interaction_matrix(seen(pose)), compute_uv=False)
    return values[-1] / values[0]


def command_of(twist):
    return Command(Mode.SERVOING, "", np.array(twist), 2.0 * np.array(twist))


AWAY = LOOK.T @ [0.3, -0.3, 0.3]


@pytest.mark.parametrize(("sign", "passes"), [(1.0, True), (-1.0, False)])
def test_a_twist_passes_slowly_if_it_leads_out_and_not_if_it_leads_in(sign, passes):
    asked = command_of([*(sign * AWAY), 0.0, 0.0, 0.0])
    left = leave(asked, seen(NEAR), "closed")
    later = NEAR.integrate(left.twist, 1.0)
    if passes:
        assert left.mode is Mode.SERVOING and np.linalg.norm(left.twist[:3]) == pytest.approx(LEAVING_SPEED)
        np.testing.assert_allclose(np.cross(left.twist[:3], AWAY), 0.0, atol=1e-12)
        np.testing.assert_allclose(left.output, 2.0 * left.twist)
        assert inverse_condition(later) > inverse_condition(NEAR)
    else:
        assert left.mode is Mode.HALTED and not left.twist.any()
    assert left.reason.startswith("closed; ")


def test_the_direction_named_is_the_axis_along_which_the_condition_rises_most():
    left = leave(Command(Mode.HALTED, "why"), seen(NEAR), "closed")
    gains = {}
    for row, axis in enumerate("xyz"):
        for sign in "+-":
            twist = np.zeros(6)
            twist[row] = LEAVING_SPEED if sign == "+" else -LEAVING_SPEED
            gains[sign + axis] = inverse_condition(NEAR.integrate(twist, 1.0))
    assert f" {max(gains, key=gains.get)} " in left.reason
    assert not any(f" {each} " in left.reason for each in gains if each != max(gains, key=gains.get))


def controller(gate):
    target = Pose(LOOK, CENTER + [0.3, -0.3, 0.3])
    return ServoController.from_parameters(
        ControllerParameters(
            lines_points=tuple(SCENE.point.ravel()),
            lines_directions=tuple(SCENE.direction.ravel()),
            target_position=tuple(target.translation),
            target_orientation=tuple(target.quaternion_xyzw),
            gate=gate,
        )
    )


def answer(servo):
    return servo.answer(LineObservation.of_lines(seen(NEAR)), SECOND, SECOND)


def test_a_controller_leaves_while_the_monitor_alarms_and_stands_when_nobody_watches():
    servo = controller("status")
    assert not answer(servo).twist.any()
    servo.gate.receive(int(Level.CRITICAL), "near", SECOND, SECOND)
    left = answer(servo)
    assert mentions(left.reason, "CRITICAL")
    assert np.linalg.norm(left.twist[:3]) <= LEAVING_SPEED * (1.0 + 1e-12)
    servo.gate.receive(int(Level.UNOBSERVABLE), "blind", SECOND, SECOND)
    assert answer(servo).mode is Mode.HALTED


def test_gate_risk_waits_for_the_first_answer():
    servo = controller("risk")
    servo.gate.receive(int(Level.OK), "", SECOND, SECOND)
    assert mentions(answer(servo).reason, "risk") and not answer(servo).twist.any()
    servo.gate.receive(int(Level.OK), "", SECOND, SECOND, has_risk=True)
    assert answer(servo).mode is Mode.SERVOING
