# SPDX-License-Identifier: Apache-2.0
"""The laws by pose, and by pose and image; and what looking ahead makes of a latency."""

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from scipy.spatial.transform import Rotation
from strategies import numbers, seen_lines, vectors

from plsing_ros.control import pose_doubt
from plsing_ros.control.command import Mode
from plsing_ros.control.image_mismatch import mismatch, polar
from plsing_ros.control.latency import LookAhead
from plsing_ros.control.pose_laws import PoseErrors, PoseLaws
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import GeometryError, ObservationError, ParameterError
from plsing_ros.features import LineObservation, interaction_matrix, inverse_condition_number, project_lines
from plsing_ros.features.target import Target
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import ControllerParameters

EYE = Pose(np.eye(3), np.zeros(3))
POINTS = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.0, -1.0, -0.5], [0.0, 1.0, 0.0], [0.5, 0.5, 1.0]]
DIRECTIONS = [[0.2, 1.0, 0.1], [-0.1, 1.0, 0.3], [1.0, 0.2, 0.2], [1.0, -0.3, 0.0], [0.3, 0.2, 1.0]]
LINES = LineSet.from_points_directions(POINTS, DIRECTIONS)
TARGET = Pose(np.eye(3), np.array([0.3, 0.2, -4.0]))
SECOND = 10**9


def seen_by(pose, lines=LINES):
    return LineObservation.of_lines(lines.transformed(pose.inverse(), "camera"))


def covariance(position=0.005, rotation=0.005):
    return np.diag(np.repeat([position**2, rotation**2], 3))


def servo_with(law, **values):
    parameters = {
        "lines.points": LINES.point.ravel().tolist(),
        "lines.directions": LINES.direction.ravel().tolist(),
        "target.source": "topic",
        "law": law,
        "features_timeout": 10.0,
        **values,
    }
    servo = ServoController.from_parameters(ControllerParameters.from_values(parameters))
    servo.set_target(seen_by(TARGET))
    return servo


@given(lines=seen_lines(min_size=3), offset=vectors(6, -1.0, 1.0))
def test_the_displacement_leads_back_to_the_target_along_a_straight_line(lines, offset):
    assume(np.linalg.svd(lines.direction)[1][1] > 0.1)
    here = EYE.integrate(offset, 1.0)
    try:
        target, seen = Target(LineObservation.of_lines(lines), "target"), lines.transformed(here.inverse(), "camera")
        twist = PoseLaws(target).by_pose(seen, covariance()).twist
    except (ObservationError, GeometryError):
        assume(False)
    assume(seen.ids == target.ids)
    half = Pose(here.rotation @ Rotation.from_rotvec(-0.5 * twist[3:]).as_matrix(), here.translation)
    middle = here.translation - 0.5 * here.rotation @ twist[:3]
    np.testing.assert_allclose(middle, 0.5 * here.translation, atol=1e-6)
    rest = Rotation.from_matrix(half.rotation).magnitude()
    assert rest == pytest.approx(0.5 * Rotation.from_matrix(here.rotation).magnitude(), abs=1e-6)


@given(lines=seen_lines(min_size=1), twist=vectors(6, -1.0, 1.0))
def test_polar_rows_are_the_derivatives_of_angle_and_offset(lines, twist):
    step = 1e-6
    then = lines.transformed(EYE.integrate(twist, step).inverse(), "camera")
    expected = mismatch(project_lines(then), lines) / step
    rows = polar(interaction_matrix(lines), project_lines(lines)) @ twist
    np.testing.assert_allclose(rows, expected, atol=2e-3 * max(1.0, float(np.abs(rows).max())))


@given(error=vectors(6, -0.01, 0.01), offset=vectors(6, -0.3, 0.3))
def test_the_image_corrects_3d_lines_at_a_wrong_pose(error, offset):
    true = TARGET.integrate(offset, 1.0)
    wrong = true.integrate(error, 1.0)
    image = seen_by(true)
    assume(image.usable.all() and inverse_condition_number(interaction_matrix(image.lines_camera)) > 0.03)
    laws = PoseLaws(Target(seen_by(TARGET), "target"))
    lines, s = LINES.transformed(wrong.inverse(), "camera"), image.usable_image_lines.ravel()
    fused = laws.by_pose_and_image(
        lines, s, PoseErrors(covariance(), True), np.array([1e-10, 0.0, 1e-10]), 0.0, 1.0
    ).twist
    by_pose = laws.by_pose(lines, covariance()).twist
    right = laws.by_pose(image.lines_camera, covariance()).twist
    assert np.linalg.norm(fused - right) <= 0.05 * np.linalg.norm(by_pose - right) + 1e-6


def run_with_wrong_pose(direction, off, start, turn, stated=None):
    """Distances from the target of a camera whose pose is off, at the beginning and end, and the last command."""
    error = np.concatenate([off * direction / np.linalg.norm(direction), turn])
    servo, pose = servo_with("fused", gain=1.0), TARGET.integrate(np.concatenate([start, np.zeros(3)]), 1.0)
    began, command = np.linalg.norm(pose.translation - TARGET.translation), None
    for k in range(60):
        now = (k + 1) * SECOND // 10
        wrong = pose.integrate(error, 1.0)
        image, told = seen_by(pose), seen_by(wrong)
        if stated is not None:
            servo.receive_pose(wrong, now, stated)
        if not (image.usable.all() and told.usable.all()):
            break
        observation = LineObservation(LINES.ids, image.image_lines, image.usable, told.lines_camera)
        command = servo.answer(observation, now, now)
        pose = pose.integrate(command.twist, 0.1)
    return began, np.linalg.norm(pose.translation - TARGET.translation), command


@given(direction=vectors(3, -1.0, 1.0), off=numbers(0.02, 0.6), start=vectors(3, -0.4, 0.4), turn=vectors(3, -0.1, 0.1))
@settings(deadline=None, max_examples=20)
@example(direction=np.array([0.0, 0.0, 1.0]), off=0.125, start=np.array([0.0, 0.0, 0.0625]), turn=np.zeros(3))
def test_fused_never_ends_farther_away_by_a_wrong_pose(direction, off, start, turn):
    assume(np.linalg.norm(direction) > 0.1 and np.linalg.norm(start) > 0.05)
    began, ended, _ = run_with_wrong_pose(direction, off, start, turn)
    assert ended <= began + 1e-3


def test_an_image_that_fits_the_map_counts_more_than_is_said_of_it_where_the_pose_is_wrong(monkeypatch):
    drawn = np.random.default_rng(5).uniform(-1.0, 1.0, (12, 7))
    ended = {}
    for said in ("shown", 1e9):
        if said != "shown":
            monkeypatch.setattr(pose_doubt, "_SAID", said)
        runs = [
            run_with_wrong_pose(row[:3], 0.125 + 0.075 * row[6], 0.4 * row[3:6], np.zeros(3), covariance(0.003, 0.0035))
            for row in drawn
        ]
        assert all(command.mode.moves and end <= began + 1e-3 for began, end, command in runs)
        ended[said] = np.mean([end for _, end, _ in runs])
    assert ended["shown"] < 0.8 * ended[1e9]


def test_the_covariance_of_a_pose_decides_how_far_the_image_corrects_it():
    true, told = TARGET, TARGET.integrate([0.004, 0.0, 0.0, 0.0, 0.0, 0.0], 1.0)
    observation = LineObservation(
        LINES.ids, seen_by(true).image_lines, np.ones(5, dtype=bool), seen_by(told).lines_camera
    )
    asked = []
    for std in (1e-5, 0.05):
        servo = servo_with("fused", **{"fused.map_std": 0.0})
        servo.receive_pose(told, SECOND, covariance(std, std))
        asked.append(float(np.linalg.norm(servo.answer(observation, SECOND, SECOND).twist)))
    # By the pose the camera is 4 mm off, by the image it is there.
    assert asked[0] == pytest.approx(0.1 * 0.004, rel=0.02) and asked[1] < 0.5 * asked[0]


def test_a_shown_target_is_reached_by_the_image_where_map_and_focal_length_are_wrong():
    rng = np.random.default_rng(0)
    wrong_map = LineSet.from_points_directions(LINES.point + 0.02 * rng.normal(size=(5, 3)), LINES.direction)

    def frame(pose, told):
        image = seen_by(pose).image_lines * [1.0, 1.0, 1.02]
        return LineObservation(LINES.ids, image, np.ones(5, dtype=bool), seen_by(told, wrong_map).lines_camera)

    bias = [0.02, -0.01, 0.015, 0.004, 0.0, -0.003]
    ends = {}
    for law in ("position", "fused"):
        servo = servo_with(law, gain=1.0)
        servo.set_target(frame(TARGET, TARGET))
        pose = TARGET.integrate([0.2, -0.1, 0.3, 0.1, -0.1, 0.2], 1.0)
        for k in range(300):
            now = (k + 1) * SECOND // 10
            pose = pose.integrate(servo.answer(frame(pose, pose.integrate(bias, 1.0)), now, now).twist, 0.1)
        ends[law] = float(np.linalg.norm(pose.translation - TARGET.translation))
    assert ends["position"] == pytest.approx(np.linalg.norm(bias[:3]), rel=0.2)
    assert ends["fused"] < 0.75 * ends["position"]


@pytest.mark.parametrize("law", ["position", "fused"])
def test_a_target_without_3d_lines_is_said(law):
    servo = servo_with(law)
    image = seen_by(TARGET)
    servo.set_target(LineObservation(image.ids, image.image_lines, image.usable, None))
    with pytest.raises(ObservationError, match="target.*3-D lines"):
        servo.answer(seen_by(TARGET), SECOND, SECOND)


def run_late(law, gain, frames_late, latency):
    servo = servo_with(law, gain=gain, latency=latency)
    pose = TARGET.integrate([0.1, -0.05, 0.2, 0.05, -0.1, 0.1], 1.0)
    waiting = [np.zeros(6)] * frames_late
    for k in range(round(8.0 / gain / 0.04)):
        now = SECOND + k * 4 * SECOND // 100
        command = servo.answer(seen_by(pose), now, now)
        assert command.mode is not Mode.HALTED
        waiting.append(command.twist)
        pose = pose.integrate(waiting.pop(0), 0.04)
    return float(np.linalg.norm(pose.translation - TARGET.translation))


@pytest.mark.parametrize("law", ["pinv", "position", "fused"])
def test_gain_times_latency_of_1_6_converges_when_the_latency_is_known(law):
    assert run_late(law, 4.0, 10, 0.0) > 0.02
    assert run_late(law, 4.0, 10, 0.4) < 2e-3


def last_reasons(servo):
    """Return the first and the last reason for features that are answered 0.4 s late, 30 a second."""
    stamps = [SECOND + k * SECOND // 30 for k in range(100)]
    reasons = [servo.answer(seen_by(TARGET), stamp, stamp + 4 * SECOND // 10).reason for stamp in stamps]
    return reasons[0], reasons[-1]


def test_features_that_are_answered_late_are_said_unless_looked_ahead_by():
    for gain, latency, said in ((2.0, 0.0, True), (2.0, 0.4, False), (0.2, 0.0, False)):
        first, last = last_reasons(servo_with("pinv", gain=gain, latency=latency))
        assert "latency" not in first and ("latency" in last) is said


def test_gain_times_latency_is_limited():
    with pytest.raises(ParameterError, match="'latency'"):
        servo_with("pinv", gain=10.0, latency=0.5)


@given(first=vectors(6, -1.0, 1.0), second=vectors(6, -1.0, 1.0))
def test_looking_ahead_is_the_motion_of_the_twists_under_way(first, second):
    ahead = LookAhead()
    ahead.sent(first, SECOND)
    ahead.sent(second, SECOND + 10**8)
    # Of the first twist half a tenth of a second is over.
    expected = EYE.integrate(first, 0.05) @ EYE.integrate(second, 0.1)
    assert ahead.motion(SECOND + 2 * 10**8, 0.15).is_close(expected, 1e-9)
