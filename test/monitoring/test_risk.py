# SPDX-License-Identifier: Apache-2.0
"""Risk, demand and time to harm of the monitor, against runs of the controller itself."""

import dataclasses

import numpy as np
import pytest
from messages import mentions
from near_transversal_scene import LOOK, SCENE, SECOND, START_2, TARGET
from scipy.spatial.transform import Rotation

from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.risk_predictor import RiskPredictor
from plsing_ros.monitoring.rollout_setup import roll_out_around, rollout_task
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters import MonitorParameters
from plsing_ros.parameters.law import LawParameters
from plsing_ros.parameters.loop import LoopParameters
from plsing_ros.parameters.task import TaskParameters
from plsing_ros.parameters.tolerance import ToleranceParameters
from plsing_ros.planning.rollout import Harm, RunState, poses_around
from plsing_ros.singularities import singular_set

STEP = SECOND // 30
SINGULAR = singular_set(SCENE)
BASE = {
    "lines.points": SCENE.point.ravel(),
    "lines.directions": SCENE.direction.ravel(),
    "lines.position_std": [0.0],
    "lines.direction_std": [0.0],
    "target.known": True,
    "target.position": TARGET.translation,
    "target.orientation": TARGET.quaternion_xyzw,
    "camera.image_noise": 0.0,
}
CALM = Pose(LOOK, TARGET.translation + [0.1, -0.1, 0.1])


def parameters_with(**changes):
    return MonitorParameters.from_values(BASE | {name.replace("__", "."): value for name, value in changes.items()})


def image_of(ends, pose):
    """The ends (n, 2, 3) of segments as a tracker reports them, (n, 4)."""
    corners = (ends - pose.translation) @ pose.rotation
    return (corners[..., :2] / corners[..., 2:]).reshape(-1, 4)


class Watched:
    """A monitor, and a camera that it watches."""

    def __init__(self, **changes):
        self.monitor = SingularityMonitor.from_parameters(parameters_with(**changes))
        self.now = 10**12

    def see(self, pose, ids=None, ends=None):
        self.now += STEP
        lines = SCENE.transformed(pose.inverse(), "camera")
        if ids is not None:
            lines = lines.select([SCENE.ids.index(i) for i in ids])
        self.monitor.receive_pose(pose, self.now)
        seen = LineObservation.of_lines(lines)
        if ends is not None:
            seen = dataclasses.replace(seen, ends=image_of(ends, pose))
        return self.monitor.answer(seen, self.now, self.now)


def test_the_papers_start_2_is_announced_at_the_first_features_and_start_1_is_not():
    unlimited = {"max_linear_speed": 0.0, "max_angular_speed": 0.0}
    bad, good = Watched(**unlimited).see(START_2), Watched(**unlimited).see(CALM)
    assert bad.level in (Level.WARN, Level.CRITICAL)
    assert bad.risk.demand > 1.0 and mentions(bad.reason, "speed")
    assert good.level is Level.OK and good.risk.probability < 0.05 and good.risk.time_to_harm is None


def test_harm_is_told_with_its_kind_and_time_which_runs_down():
    # A field of view so narrow that lines are lost soon after the start.
    watched = Watched(camera__half_view=[0.02, 0.02], prediction__period=60.0)
    first = watched.see(CALM)
    assert first.risk.probability > 0.95 and first.risk.harm is Harm.FEW_LINES
    assert first.level is Level.CRITICAL and mentions(first.reason, "three lines", "view")
    late = Watched(max_linear_speed=0.001, prediction__period=60.0)
    found = late.see(START_2)
    assert found.risk.harm is Harm.LATE
    # 10 / 0.1 + 4 s.
    assert found.risk.time_to_harm == pytest.approx(104.0, abs=0.1)


def test_ends_that_a_tracker_sees_count_where_the_scene_tells_none():
    # Short segments, in the middle of what is seen at first and outside of what is seen from the target.
    options = {"camera__half_view": [0.15, 0.15], "prediction__period": 60.0, "law": "position"}
    start = Pose(LOOK, TARGET.translation + [2.0, -2.0, 0.0])
    axis = start.translation + (-start.translation[2] / start.rotation[2, 2]) * start.rotation[:, 2]
    middle = SCENE.point + np.sum((axis - SCENE.point) * SCENE.direction, axis=1)[:, None] * SCENE.direction
    ends = np.stack([middle - 0.1 * SCENE.direction, middle + 0.1 * SCENE.direction], axis=1)
    seen = Watched(**options).see(start, ends=ends).risk
    told = Watched(lines__ends=ends.ravel(), **options).see(start).risk
    assert seen.harm is told.harm is Harm.FEW_LINES
    assert seen.time_to_harm == pytest.approx(told.time_to_harm)
    assert Watched(**options).see(start).risk.probability < 0.05


def test_a_soft_start_is_no_demand():
    # Told to move slowly at first: what counts is the law's first speed, not the ramp's.
    watched = Watched(gain=0.5, robot__clamps=False)
    start = Pose(LOOK, TARGET.translation + [0.5, -0.5, 0.5])
    law = RiskPredictor().law(watched.monitor.parameters)
    twist = rollout_task(SINGULAR, TARGET, law, watched.monitor.parameters, 0.1).twist(start)
    levels = set()
    for frame in range(30):
        found = watched.see(start)
        levels.add(found.level)
        watched.monitor.receive_twist(frame / 30.0 * twist, watched.now)
    assert levels == {Level.OK} and found.risk is not None


def test_samples_of_the_pose_have_its_covariance_in_the_worlds_axes():
    covariance = np.diag([4e-4, 1e-4, 1e-6, 1e-6, 4e-4, 1e-4])
    covariance[0, 4] = covariance[4, 0] = 2e-4
    samples = poses_around(START_2, covariance, 4000, 3)
    turns = Rotation.from_matrix([each.rotation @ START_2.rotation.T for each in samples]).as_rotvec()
    drawn = np.hstack([np.array([each.translation - START_2.translation for each in samples]), turns])
    spread = drawn.T @ drawn / len(drawn)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    np.testing.assert_allclose(spread / scale, covariance / scale, atol=0.08)
    assert poses_around(START_2, None, 3, 0) == [START_2] * 3


def test_samples_see_the_lines_that_the_camera_sees():
    # 30 m along one direction: most of these cameras would look at nothing.
    covariance = np.diag([900.0, 1e-6, 1e-6, 1e-8, 1e-8, 1e-8])
    parameters = parameters_with(camera__half_view=[0.7, 0.7], gain=1.0)
    law = RiskPredictor().law(parameters)
    task = rollout_task(SINGULAR, TARGET, law, parameters, 1.0 / 30.0)
    state = RunState(law.deadline, 100.0)
    as_drawn = task.roll_out(poses_around(CALM, covariance, 16, 1), state, 1)
    assert np.count_nonzero((as_drawn.kind == Harm.FEW_LINES) & (as_drawn.harm_time == 0.0)) >= 8
    found = roll_out_around(task, CALM, covariance, 16, state, 1)
    assert not np.any((found.kind == Harm.FEW_LINES) & (found.harm_time == 0.0))
    # The others are those that were drawn.
    kept = ~((as_drawn.kind == Harm.FEW_LINES) & (as_drawn.harm_time == 0.0))
    np.testing.assert_array_equal(found.distance[kept], as_drawn.distance[kept])


@pytest.mark.parametrize(
    ("law", "verdict", "source", "lasts"),
    [
        ("fused", LinesVerdict.POOR, "filter", False),
        ("position", LinesVerdict.POOR, "filter", False),
        ("position", LinesVerdict.OK, "filter", True),
        ("pinv", LinesVerdict.POOR, "filter", True),
        ("pinv", LinesVerdict.GIVEN, "", False),
    ],
)
def test_what_an_estimator_learns_on_its_way_does_not_last(law, verdict, source, lasts):
    seen = LineObservation.of_lines(SCENE.transformed(CALM.inverse(), "camera"))
    seen = dataclasses.replace(seen, verdict=verdict, lines_source=source)
    parameters = parameters_with(law=law)
    task = rollout_task(SINGULAR, TARGET, RiskPredictor().law(parameters), parameters, 0.1, seen)
    assert task.loop.pose_error_lasts == lasts


def test_detour_does_not_alert_by_the_straight_way_before_its_path_is_known():
    # The robot is far too slow to be there in time.
    watched = Watched(law="detour", detour__linear_speed=1.0, robot__linear_speed=0.01, gain=1.0, warn__shaking=0.0)
    start = Pose(LOOK, TARGET.translation + [0.5, -0.5, 0.5])
    found = watched.see(start)
    assert found.risk.lacks_path and found.risk.probability > 0.9 and found.level is Level.OK
    path = [start, Pose(LOOK, TARGET.translation + [0.2, -0.5, 0.5]), TARGET]
    watched.monitor.receive_path(path)
    # It is asked for at the next frame, and not a period later.
    again = watched.see(start)
    assert again.risk is not found.risk and not again.risk.lacks_path
    assert again.level is not Level.OK


CHANGES = {
    "law": "dls",
    "interaction": "target",
    "degrees_of_freedom": [1, 1, 1, 1, 1, 0],
    "prediction.samples": 5,
    "loop.latency": 5,
    "latency": 0.2,
    "camera.half_view": [0.5, 0.4],
    "lines.ends": np.column_stack([SCENE.point - SCENE.direction, SCENE.point + SCENE.direction]).ravel(),
    "robot.clamps": False,
    "gain_slope": 0.01,
}
# Neither an integral nor a secondary twist nor the details of a path are rolled out; fused goes as position does.
NOT_ROLLED_OUT = {"secondary_twist", "integral_gain", "integral_limit", "detour.margin", "detour.replan_distance"}
NOT_ROLLED_OUT |= {
    "detour.pose_onset",
    "detour.max_scale_error",
    "detour.risk_margin",
    "fused.position_std",
    "fused.rotation_std",
}
NOT_ROLLED_OUT |= {"fused.angle_std", "fused.offset_std", "fused.map_std"}
OTHERS = set(TaskParameters.specifications()) | set(ToleranceParameters.specifications())
OTHERS |= {"prediction.controller", "prediction.period"}
ROLLED_OUT = sorted(set(LoopParameters.specifications()) - OTHERS - NOT_ROLLED_OUT)


@pytest.mark.parametrize("name", ROLLED_OUT)
def test_each_parameter_of_the_loop_reaches_the_roll_out(name):
    def asked(parameters):
        task = rollout_task(SINGULAR, TARGET, RiskPredictor().law(parameters), parameters, 0.1)
        ends = None if task.ends is None else task.ends.tolist()
        return dataclasses.astuple(task.law), dataclasses.astuple(task.loop), ends, parameters.samples

    assert set(LawParameters.specifications()) <= set(LoopParameters.specifications())
    # Three frames late, of which the law may look ahead by itself.
    before = parameters_with(loop__latency=3)
    value = CHANGES.get(name)
    if value is None:
        value = getattr(before, MonitorParameters.specifications()[name][0].name) * 1.5 + 0.01
        if name == "gain_at_infinity":
            value = 0.02
    assert asked(before.with_values({name: value})) != asked(before)


def test_the_controller_says_which_law_is_in_force():
    predictor, parameters = RiskPredictor(), parameters_with()
    predictor.receive_controller("dls", 0.7)
    law = predictor.law(parameters)
    assert (law.law, law.gain, law.deadline) == ("dls", 0.7, pytest.approx(10.0 / 0.7 + 4.0))


def test_features_that_are_refused_keep_one_state_and_one_kind():
    watched = Watched()
    watched.see(CALM)
    said = set()
    for frame in range(40):
        found = watched.see(CALM, ids=[1, 2])
        if frame < 3:
            assert found.level is Level.OK and mentions(found.reason, f"held for {frame + 1} frame")
            continue
        silent = watched.monitor.silence(watched.now + SECOND)
        said |= {(each.level, each.kind) for each in (found, silent)}
        assert silent.level is not Level.STALE
    assert len(said) == 1 and {level for level, _ in said} == {Level.UNOBSERVABLE}


def test_lines_are_not_rolled_out_while_ambiguous_and_alert_from_the_second_frame_on():
    watched = Watched()
    seen = LineObservation.of_lines(SCENE.transformed(CALM.inverse(), "camera"))
    doubtful = dataclasses.replace(seen, verdict=LinesVerdict.AMBIGUOUS, verdict_reason="another pose fits")
    levels = []
    for _ in range(3):
        watched.now += STEP
        watched.monitor.receive_pose(CALM, watched.now)
        found = watched.monitor.answer(doubtful, watched.now, watched.now)
        assert found.risk is None
        levels.append(found.level)
    assert levels == [Level.OK, Level.CRITICAL, Level.CRITICAL] and mentions(found.reason, "another pose fits")


def test_poor_lines_do_not_alert_where_samples_of_their_pose_are_rolled_out():
    seen = LineObservation.of_lines(SCENE.transformed(CALM.inverse(), "camera"))
    poor = dataclasses.replace(seen, verdict=LinesVerdict.POOR, verdict_reason="few lines")
    levels = set()
    for covariance in (1e-8 * np.eye(6), None):
        watched = Watched()
        for _ in range(3):
            watched.now += STEP
            watched.monitor.receive_pose(CALM, watched.now, covariance)
            found = watched.monitor.answer(poor, watched.now, watched.now)
        levels.add((covariance is None, found.level))
    assert levels == {(False, Level.OK), (True, Level.WARN)}


@pytest.mark.parametrize(
    ("law", "gain", "deviation", "level"),
    [
        ("detour", 1.0, 0.2, Level.WARN),
        # Slowly, or by a pose that is known well, it does not get far before it is corrected.
        ("detour", 0.1, 0.2, Level.OK),
        ("detour", 1.0, 0.05, Level.OK),
        # It goes straight to the target, and not along a path from where the first pose was.
        ("position", 1.0, 0.2, Level.OK),
    ],
)
def test_a_path_that_is_followed_by_a_poor_pose_alerts_where_it_may_lead_away(law, gain, deviation, level):
    seen = LineObservation.of_lines(SCENE.transformed(CALM.inverse(), "camera"))
    poor = dataclasses.replace(seen, verdict=LinesVerdict.POOR, verdict_reason="far off", lines_source="filter")
    watched = Watched(law=law, gain=gain)
    watched.monitor.receive_path([CALM, TARGET])
    covariance = np.diag([deviation**2, 1e-8, 1e-8, 1e-8, 1e-8, 1e-8])
    for _ in range(3):
        watched.now += STEP
        watched.monitor.receive_pose(CALM, watched.now, covariance)
        found = watched.monitor.answer(poor, watched.now, watched.now)
    assert found.level is level, found.reason
    assert ("far off" in found.reason) == (level is Level.WARN)


def test_a_path_of_detour_that_leads_away_is_announced_and_one_of_another_target_is_not():
    start = Pose(LOOK @ Rotation.from_rotvec([0.0, 0.0, 0.2]).as_matrix(), TARGET.translation)
    far = Pose(start.rotation, start.translation + [0.4, 0.0, 0.0])
    for path, level in (((start, far, TARGET), Level.CRITICAL), ((start, far), Level.OK), ((), Level.OK)):
        watched = Watched(law="detour", gain=0.5)
        watched.monitor.receive_path(path)
        found = watched.see(start)
        assert found.level is level, found.reason
        assert (found.risk.harm is Harm.AWAY) == (level is Level.CRITICAL)
