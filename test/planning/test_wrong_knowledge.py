# SPDX-License-Identifier: Apache-2.0
"""Detour with a wrong map of lines, and with 3-D lines at wrong depths: constant errors, as from calibration."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation import near_transversal

LINES = read_scene(config_file("paper_p4l.yaml"))
TARGET, START = (
    Pose.from_quaternion(position, near_transversal.ORIENTATION)
    for position in (near_transversal.TARGET_POSITION, near_transversal.STARTS[1].position)
)
ELSEWHERE = Pose(START.rotation, START.translation + (0.0, 0.0, 1.0))
TURNS = Rotation.from_rotvec(np.radians([[0.4, 0.1, -0.3], [-0.2, 0.3, 0.1], [0.1, -0.5, 0.2], [-0.3, 0.2, 0.4]]))
SHIFTS = 1e-3 * np.array([[5.0, -3.0, 4.0], [-6.0, 2.0, 5.0], [3.0, 7.0, -4.0], [-2.0, -5.0, 6.0]])
MAP = LineSet.from_points_directions(LINES.point + SHIFTS, TURNS.apply(LINES.direction), LINES.frame, LINES.ids)
# Seen well from everywhere, so that the image leads.
DRAWN = np.random.default_rng(1)
MANY = LineSet.from_points_directions(DRAWN.normal(size=(12, 3)), DRAWN.normal(size=(12, 3)))
TIME_STEP = 0.1


def controller(lines, target=TARGET, **values):
    rows = {"lines.points": tuple(lines.point.ravel()), "lines.directions": tuple(lines.direction.ravel())}
    at = {"target.position": tuple(target.translation), "target.orientation": tuple(target.quaternion_xyzw)}
    return ServoController.from_parameters(
        ControllerParameters.from_values({**rows, **at, "law": "detour", "gain": 0.5, **values})
    )


def seen(pose, depth=1.0, lines=LINES):
    """What a camera sees that takes lines for farther away than they are; the image lines are right."""
    true = lines.transformed(pose.inverse(), "camera_optical_frame")
    return LineObservation.of_lines(LineSet(true.direction, depth * true.moment, true.frame, true.ids))


def run(servo, pose, frames, depth=1.0, first=0, lines=LINES):
    """Return where the camera gets to, and all plans that it had on its path."""
    plans = []
    for k in range(first, first + frames):
        stamp = 10**12 + round(k * TIME_STEP * 1e9)
        try:
            command = servo.answer(seen(pose, depth, lines), stamp, stamp)
        except ObservationError as error:
            command = servo.halt(str(error))
        pose = pose.integrate(command.twist, TIME_STEP)
        if not plans or servo.plan is not plans[-1]:
            plans.append(servo.plan)
    return pose, plans


@pytest.mark.parametrize("depth", [1.0, 1.05])
@pytest.mark.parametrize("lines", [LINES, MAP])
def test_a_target_that_was_shown_is_reached_whatever_the_map(lines, depth):
    servo = controller(lines, **{"target.source": "topic"})
    servo.set_target(seen(TARGET, depth))
    end, plans = run(servo, START, 600, depth)
    assert np.linalg.norm(end.translation - TARGET.translation) < 1e-4
    assert len(plans) == 1


@pytest.mark.parametrize(("largest", "left"), [(0.2, (0.0, 1e-4)), (0.03, (0.03, 0.3)), (0.0, (0.1, 1.0))])
def test_a_target_pose_is_reached_with_3d_lines_of_the_wrong_scale_as_far_as_it_may_be_corrected(largest, left):
    end, plans = run(controller(LINES, **{"detour.max_scale_error": largest}), START, 600, depth=1.05)
    assert left[0] <= np.linalg.norm(end.translation - TARGET.translation) <= left[1]
    assert len(plans) == 1


def test_a_pose_that_is_off_by_more_than_a_new_plan_takes_is_no_reason_for_one():
    start, target = (Pose.look_at(center, (0.0, 0.0, 0.0)) for center in ((4.0, 1.0, 0.0), (4.0, -0.5, 0.5)))
    servo, depth = controller(MANY, target, **{"detour.max_scale_error": 0.0}), 1.15
    off = np.linalg.norm(target.translation) * (depth - 1.0)
    assert off > 1.5 * servo.parameters.detour_replan_distance
    end, plans = run(servo, start, 600, depth, lines=MANY)
    assert len(plans) == 1
    assert np.linalg.norm(end.translation - target.translation) < 0.02


@pytest.mark.parametrize("depth", [1.0, 1.1])
def test_a_camera_that_was_carried_away_is_one(depth):
    servo = controller(LINES, **{"detour.max_scale_error": 0.0})
    _, before = run(servo, START, 100, depth)
    _, after = run(servo, ELSEWHERE, 300, depth, first=100)
    # It holds for a moment first.
    assert len(before) == 1 and len(after) == 2
    assert after[0] is before[0]


def test_a_pose_that_jumps_is_no_reason_for_a_new_plan():
    servo = controller(LINES)
    pose, before = run(servo, START, 100)
    for k in range(3):
        _, jumped = run(servo, ELSEWHERE, 2, first=100 + 4 * k)
        pose, after = run(servo, pose, 2, first=102 + 4 * k)
        assert len(before) == len(jumped) == len(after) == 1 and before[0] is jumped[0] is after[0]


def test_plans_are_not_made_without_end():
    servo = controller(LINES)
    plans = []
    for k in range(12):
        _, each = run(servo, ELSEWHERE if k % 2 else START, 8, first=8 * k)
        plans += each
    assert len({id(plan) for plan in plans}) == 6  # the first, and five more
    stamp = 10**12 + 96 * 10**8
    with pytest.raises(ObservationError, match="new paths"):
        servo.answer(seen(START), stamp, stamp)
