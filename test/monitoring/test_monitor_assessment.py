# SPDX-License-Identifier: Apache-2.0
"""The monitor's cycle without ROS: target, prediction, position, faults, and noise at the thresholds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from near_transversal_scene import LOOK, OFF, ON_TRANSVERSAL, SCENE, SECOND, START_2, TARGET
from strategies import vectors

from plsing_ros.errors import GeometryError, ObservationError, ParameterError
from plsing_ros.features import (
    LineObservation,
    LinesVerdict,
    interaction_matrix,
    inverse_condition_number,
    project_lines,
)
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.approach import Trend
from plsing_ros.monitoring.hysteresis import Debounce, Hysteresis, Thresholds
from plsing_ros.monitoring.prediction import Prediction
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters import MonitorParameters
from plsing_ros.simulation.simulated_camera import SimulatedCamera
from plsing_ros.singularities import Kind

START = Pose(LOOK, ON_TRANSVERSAL + [0.2, 0.3, 0.0])
NOW, STEP = 10**12, 40_000_000


def monitor_for(target=None, scene=SCENE, **values):
    # What is known of the law itself is in test_risk.
    parameters = {"lines.points": scene.point.ravel(), "lines.directions": scene.direction.ravel()}
    parameters["prediction.controller"] = "unknown"
    if target is not None:
        parameters |= {"target.known": True, "target.position": target.translation}
        parameters |= {"target.orientation": target.quaternion_xyzw}
    return SingularityMonitor.from_parameters(
        MonitorParameters.from_values(parameters | {name.replace("__", "."): value for name, value in values.items()})
    )


def seen(pose, scene=SCENE):
    return LineObservation.of_lines(scene.transformed(pose.inverse(), "camera"))


def inverse_at(pose):
    return inverse_condition_number(interaction_matrix(seen(pose).lines_camera))


def servo(monitor, start, target, frames, with_pose=False):
    """Run the plain law and return the assessments; the twist of a frame comes after its assessment."""
    pose, found = start, []
    target_image = project_lines(SCENE.transformed(target.inverse(), "camera"))
    for stamp in range(NOW, NOW + frames * STEP, STEP):
        lines = SCENE.transformed(pose.inverse(), "camera")
        if with_pose:
            monitor.receive_pose(pose, stamp)
        found.append(monitor.answer(LineObservation.of_lines(lines), stamp, stamp))
        twist = -0.1 * np.linalg.lstsq(interaction_matrix(lines), project_lines(lines) - target_image, rcond=None)[0]
        monitor.receive_twist(twist, stamp)
        pose = pose.integrate(twist, 0.04)
    return found


def test_the_healthy_goal_of_the_paper_is_not_alerted_once_it_is_known():
    assert monitor_for(prediction__rollout_rules=False).answer(seen(TARGET), NOW, NOW).level is Level.WARN
    known = monitor_for(TARGET).answer(seen(TARGET), NOW, NOW)
    assert known.level is Level.OK
    assert known.target_inverse_condition_number == pytest.approx(inverse_at(TARGET)) == pytest.approx(4.1e-4, rel=0.02)
    by_topic = monitor_for()
    by_topic.set_target(seen(TARGET))
    assert by_topic.answer(seen(TARGET), NOW, NOW).level is Level.OK


def test_a_goal_without_lines_in_space_is_refused():
    image = seen(TARGET)
    with pytest.raises(ObservationError, match="desired features.*3-D lines"):
        monitor_for().set_target(LineObservation(image.ids, image.image_lines, image.usable, None))


def test_a_goal_with_two_lines_is_refused():
    two = LineObservation.of_lines(seen(TARGET).lines_camera.select([0, 2]))
    with pytest.raises(ObservationError, match=r"desired features.*\b2 usable.*\[1, 3\].*\b3\b"):
        monitor_for().set_target(two)


def test_lost_lines_are_compared_with_the_goal_of_the_same_lines():
    monitor = monitor_for(TARGET)
    three = LineObservation.of_lines(seen(START).lines_camera.select([0, 1, 3]))
    L = interaction_matrix(seen(TARGET).lines_camera.select([0, 1, 3]))
    expected = inverse_condition_number(L)
    assert monitor.answer(three, NOW, NOW).target_inverse_condition_number == pytest.approx(expected)


def test_start_2_is_announced_before_the_speed_grows_and_before_any_threshold():
    found = servo(monitor_for(TARGET), START_2, TARGET, 190)
    first = next(i for i, each in enumerate(found) if each.level is Level.WARN)
    assert found[first].kind == "speed_growth" and "speed" in found[first].reason
    assert found[first].nearest.distance > 0.02
    assert found[first].trend is Trend.APPROACHING and found[first].approach.name == "transversal 1"
    assert "translation" in (text := found[first].unobservable_motion_text) and "transversal 1" in text
    assert Level.CRITICAL in [each.level for each in found[first:]]


@pytest.mark.parametrize("with_pose", [True, False])
def test_start_2_is_announced_as_well_to_a_monitor_that_does_not_know_the_goal(with_pose):
    known, unknown = monitor_for(TARGET), monitor_for()
    assert unknown.answer(seen(START_2), NOW - SECOND, NOW - SECOND).target_inverse_condition_number is None
    first = []
    for monitor in (known, unknown):
        found = servo(monitor, START_2, TARGET, 220, with_pose)
        first.append(next(i for i, each in enumerate(found) if each.level is not Level.OK))
        assert found[first[-1]].kind == "speed_growth"
    assert first[1] == first[0]


def test_a_speed_that_passes_zero_is_no_new_start():
    """A camera that only turns for an instant: growth still refers to the speed at the start of the motion."""
    prediction = Prediction()
    for i in range(30):
        prediction.receive_twist(np.array([0.1 if i != 20 else 1e-5, 0, 0, 0, 0.1, 0]), NOW + i * STEP, 1e-3)
    assert prediction.first_speed == pytest.approx(0.1)
    for i in range(30, 60):
        prediction.receive_twist(np.zeros(6), NOW + i * STEP, 1e-3)
    prediction.receive_twist(np.array([0.02, 0, 0, 0, 0, 0]), NOW + 60 * STEP, 1e-3)
    assert prediction.first_speed == pytest.approx(0.02)


def test_a_single_twist_from_the_future_is_no_start_of_all_motions_until_then():
    monitor = monitor_for(TARGET)
    monitor.receive_twist([5.0, 0, 0, 0, 0, 0], NOW + 10**6 * STEP)
    found, expected = (servo(each, START_2, TARGET, 220) for each in (monitor, monitor_for(TARGET)))
    assert [each.level for each in found] == [each.level for each in expected]
    assert any("speed_growth" in each.kind for each in found)


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        (LinesVerdict.GIVEN, Level.OK),
        (LinesVerdict.OK, Level.OK),
        (LinesVerdict.POOR, Level.WARN),
        (LinesVerdict.AMBIGUOUS, Level.CRITICAL),
    ],
)
def test_no_level_is_better_than_the_lines_it_rests_on(verdict, expected):
    monitor = monitor_for(TARGET)
    doubtful = replace(seen(START), verdict=verdict, verdict_reason="the pose has two solutions")
    for i in range(3):
        found = monitor.answer(doubtful, NOW + i * STEP, NOW + i * STEP)
    assert found.level is expected
    if expected is not Level.OK:
        assert verdict.name in found.reason and doubtful.verdict_reason in found.reason
    levels = [monitor.answer(seen(START), NOW + i * STEP, NOW + i * STEP).level for i in range(3, 40)]
    assert levels[-1] is Level.OK
    assert monitor.assess_pose(START).level is Level.OK


def test_start_1_stays_quiet():
    assert {each.level for each in servo(monitor_for(TARGET), START, TARGET, 200)} == {Level.OK}


def test_without_a_goal_the_approach_itself_warns():
    monitor = monitor_for(**(OFF | {"critical.transversal_distance": 0.02, "warn.transversal_distance": 0.02}))
    along = monitor.singular_set.transversals[0].direction
    across = np.cross(along, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(along, [1.0, 0.0, 0.0]))
    levels, times = [], []
    for i in range(40):
        pose = Pose(LOOK, ON_TRANSVERSAL - (0.4 - 0.008 * i) * across)
        monitor.receive_twist(np.concatenate([LOOK.T @ across * 0.2, np.zeros(3)]), NOW + i * STEP)
        found = monitor.answer(seen(pose), NOW + i * STEP, NOW + i * STEP)
        levels.append(found.level)
        times.append(found.approach.time)
    assert levels[0] is Level.OK and levels[-1] is Level.WARN
    assert found.kind == "time" and "transversal 1" in found.reason and found.nearest.distance > 0.05
    np.testing.assert_allclose(np.diff(times), -0.04, atol=1e-3)


def test_the_position_comes_from_the_pose_or_else_from_the_lines():
    monitor = monitor_for()
    alone = monitor.answer(seen(START), NOW, NOW)
    assert alone.position_source == "features" and "camera_pose" in alone.reason
    monitor.receive_pose(START, NOW)
    posed = monitor.answer(seen(START), NOW, NOW)
    assert posed.position_source == "camera_pose"
    np.testing.assert_allclose(alone.locus_distances, posed.locus_distances, atol=1e-6)


def test_lines_of_another_scene_give_no_position():
    generator = np.random.default_rng(3)
    other = LineSet.from_points_directions(generator.normal(size=(4, 3)), generator.normal(size=(4, 3)))
    found = monitor_for().answer(seen(Pose(np.eye(3), np.array([0, 0, -5.0])), other), NOW, NOW)
    assert found.position_source == "" and found.locus_distances is None and found.trend is Trend.UNKNOWN
    assert "3-D lines" in found.reason


@settings(max_examples=20)
@given(order=st.permutations(range(4)))
def test_the_order_of_lines_does_not_matter(order):
    straight = monitor_for(TARGET).answer(seen(START), NOW, NOW)
    found = monitor_for(TARGET).answer(LineObservation.of_lines(seen(START).lines_camera.select(order)), NOW, NOW)
    np.testing.assert_allclose(found.locus_distances, straight.locus_distances, atol=1e-6)
    assert found.target_inverse_condition_number == pytest.approx(straight.target_inverse_condition_number)


@pytest.mark.parametrize("with_pose", [True, False])
def test_a_reversed_line_is_named(with_pose):
    monitor = monitor_for()
    if with_pose:
        monitor.receive_pose(START, NOW)
    lines = seen(START).lines_camera
    sign = np.array([[1.0], [1.0], [-1.0], [1.0]])
    turned = LineObservation.of_lines(LineSet(lines.direction * sign, lines.moment * sign, "camera", lines.ids))
    found = monitor.answer(turned, NOW, NOW)
    assert found.level is Level.UNOBSERVABLE and "line 3" in found.reason and "reversed" in found.reason
    assert monitor.answer(seen(START), NOW + STEP, NOW + STEP).level is not Level.UNOBSERVABLE


def test_a_clock_that_jumps_back_starts_anew():
    monitor = monitor_for()
    monitor.receive_pose(START, NOW)
    monitor.answer(seen(START), NOW, NOW)
    back = NOW - 100 * SECOND
    found = monitor.answer(seen(START), back, back)
    assert found.position_source == "features" and found.inverse_condition_number_rate is None
    assert monitor.answer(seen(START), back + STEP, back + STEP).inverse_condition_number_rate is not None


def test_switched_off_is_said_at_every_occasion():
    monitor = monitor_for()
    monitor.enabled = False
    for found in (monitor.answer(seen(START), NOW, NOW), monitor.silence(NOW), monitor.unusable("x", NOW)):
        assert found.level is Level.DISABLED and "enable" in found.reason
    monitor.enabled = True
    assert monitor.answer(seen(START), NOW, NOW).level is not Level.DISABLED


def test_a_pose_asked_for_is_judged_and_changes_nothing():
    first, second = monitor_for(TARGET), monitor_for(TARGET)
    one = servo(first, START_2, TARGET, 100)
    other = servo(second, START_2, TARGET, 50)
    asked = second.assess_pose(Pose(LOOK, ON_TRANSVERSAL + [0.0, 0.001, 0.0]))
    assert asked.level is Level.CRITICAL and asked.nearest.name == "transversal 1"
    assert "translation" in (text := asked.unobservable_motion_text) and "transversal 1" in text
    assert [each.reason for each in other] == [each.reason for each in one[:50]]
    assert second.assess_pose(START).conditioning.inverse_condition_number == pytest.approx(inverse_at(START))


def test_a_twist_that_is_not_one_is_refused():
    for value in (np.nan, -np.inf, 1e308, -1e51):
        with pytest.raises(GeometryError, match="twist"):
            monitor_for().receive_twist([0, 0, 0, value, 0, 0], NOW)


@pytest.mark.parametrize("v", [[1e50] * 6, [-1e50, 1e50, 0, 0, 0, 0], [1e-200] * 6])
def test_every_number_is_finite_whatever_the_twist(v):
    monitor = monitor_for(TARGET)
    for i in range(4):
        monitor.receive_twist(v, NOW + i * STEP)
        found = monitor.answer(seen(START.integrate([0.1 * i, 0, 0, 0, 0, 0], 0.04)), NOW + i * STEP, NOW + i * STEP)
        assert found.approach is None or np.isfinite([found.approach.time, found.approach.distance]).all()
        assert found.reason


def test_thresholds_in_the_wrong_order_are_refused():
    for values, words in (
        ({"warn__transversal_distance": 0.001}, "below 'critical.transversal_distance'"),
        ({"warn__transversal_distance_exit": 0.01}, "below 'warn.transversal_distance'"),
        ({"critical__speed_growth": 5.0}, "above 'critical.speed_growth'"),
        ({"critical__speed_growth_exit": 30.0}, "above 'critical.speed_growth'"),
    ):
        with pytest.raises(ParameterError, match=words):
            monitor_for(**values)


# A camera that hovers where the number in question is at its threshold, with the noise of the paper.
HOVER = Pose(LOOK, ON_TRANSVERSAL + [0.1, 0.2, 0.1])


def thresholds_at_hover():
    found = monitor_for(TARGET).answer(seen(HOVER), NOW, NOW)
    inverse = inverse_at(HOVER)
    points = [i for i, name in enumerate(monitor_for().singular_set.locus_names) if name.startswith("isolated")]
    return {
        "inverse_condition_number": inverse,
        "relative_inverse_condition_number": inverse / inverse_at(TARGET),
        "smallest_singular_value": found.conditioning.smallest_singular_value,
        "transversal_distance": found.nearest.distance,
        "isolated_point_distance": min(found.locus_distances[points]),
    }


@pytest.mark.parametrize("with_pose", [True, False])
@pytest.mark.parametrize("level", ["warn", "critical"])
@pytest.mark.parametrize("name", thresholds_at_hover())
def test_noise_at_a_threshold_raises_one_alert(name, level, with_pose):
    value = thresholds_at_hover()[name]
    thresholds = OFF | {f"warn.{name}": value} | ({f"critical.{name}": value} if level == "critical" else {})
    target = TARGET if name.startswith("relative") else None
    monitor = monitor_for(target, **{**thresholds, "condition_thresholds": "both", "prediction.horizon": 1.4})
    camera = SimulatedCamera(SCENE, HOVER, "camera", noise=2e-3, seed=1)
    levels = []
    for stamp in range(NOW, NOW + 600 * STEP, STEP):
        if with_pose:
            monitor.receive_pose(HOVER, stamp)
        monitor.receive_twist(np.zeros(6), stamp)
        levels.append(monitor.answer(camera.observe(), stamp, stamp).level)
    assert np.count_nonzero(np.diff([0, *levels]) > 0) <= 1
    assert np.count_nonzero(np.diff(levels) < 0) == 0


@settings(max_examples=100)
@given(center=vectors(3), v=vectors(6, -1.0, 1.0))
def test_every_number_is_finite_wherever_the_camera_is(center, v):
    monitor = monitor_for(TARGET)
    pose = Pose(LOOK, center)
    monitor.receive_pose(pose, NOW)
    for i in range(4):
        monitor.receive_twist(v, NOW + i * STEP)
        found = monitor.answer(seen(pose), NOW + i * STEP, NOW + i * STEP)
    for number in (
        found.inverse_condition_number_rate,
        found.time_to_critical,
        found.target_inverse_condition_number,
        found.approach and found.approach.time,
        found.approach and found.approach.distance,
    ):
        assert number is None or np.isfinite(number)
    assert "inf" not in found.reason and "nan" not in found.reason


@given(offsets=st.lists(st.sampled_from([0.005, 0.03, 0.1, 0.3]), min_size=1, max_size=20))
@settings(max_examples=40, deadline=None)
def test_frames_above_all_thresholds_count_for_hysteresis_and_debounce(offsets):
    """Levels are those of the distance alone, whether the numbers before were looked at closely or not."""
    thresholds = {"warn.transversal_distance": 0.05, "warn.transversal_distance_exit": 0.2}
    debounce = {"debounce.raise": 2, "debounce.lower": 3, "prediction.rollout_rules": False}
    monitor = monitor_for(**(OFF | thresholds | debounce))
    reference, found, expected = Hysteresis(), [], []
    for frame, offset in enumerate(offsets):
        pose, stamp = Pose(LOOK, ON_TRANSVERSAL + [0.0, offset, 0.0]), NOW + frame * STEP
        monitor.receive_pose(pose, stamp)
        assessment = monitor.answer(seen(pose), stamp, stamp)
        distance = assessment.locus_distances[
            [kind is Kind.TRANSVERSAL for kind in monitor.singular_set.locus_kinds]
        ].min()
        found.append(assessment.level)
        expected.append(reference.update(distance, Thresholds(0.05, 0.0, 0.2, 0.0), Debounce(2, 3)))
        assert ("transversal_distance" in assessment.kind) == (assessment.level is not Level.OK)
    assert found == expected
