# SPDX-License-Identifier: Apache-2.0
"""Each live parameter of the monitor, changed at run time, shows in the next assessment."""

import re
from dataclasses import replace

import numpy as np
import pytest
from messages import mentions
from near_transversal_scene import FALLING, JUDGED, LOOK, OFF, ON_TRANSVERSAL, SCENE, SECOND, START_2, TARGET

from plsing_ros.errors import ParameterError
from plsing_ros.features import LineObservation, interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.approach import Trend
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters import MonitorParameters
from plsing_ros.parameters.loop import LoopParameters
from plsing_ros.parameters.task import TaskParameters
from plsing_ros.singularities import singular_set

HERE = Pose(LOOK, ON_TRANSVERSAL + [0.1, 0.2, 0.1])
STEP = 40_000_000

LIVE = [name for name, (_, spec) in MonitorParameters.specifications().items() if spec.live]
TASK = set(TaskParameters.specifications())
# Nothing alerts, and what does is seen at once.
QUIET = OFF | {
    "debounce.raise": 1,
    "debounce.lower": 1,
    "prediction.rollout_rules": False,
    "prediction.horizon": 0.0,
    "prediction.controller": "unknown",
    "condition_thresholds": "both",
    "target.known": True,
    "target.position": TARGET.translation,
    "target.orientation": TARGET.quaternion_xyzw,
}


class Rig:
    """A monitor whose camera is where it is told, cycle after cycle."""

    def __init__(self, scene=SCENE, **changes):
        self.scene, self.now = scene, 10**12
        lines = {"lines.points": scene.point.ravel(), "lines.directions": scene.direction.ravel()}
        self.monitor = SingularityMonitor.from_parameters(
            MonitorParameters.from_values(lines | QUIET | dotted(changes))
        )

    def set(self, changes):
        self.monitor.parameters = self.monitor.parameters.with_values(dotted(changes))

    def see(self, pose=HERE, ahead=0, pose_late=0):
        self.now += STEP
        self.monitor.receive_pose(pose, self.now - pose_late)
        seen = LineObservation.of_lines(self.scene.transformed(pose.inverse(), "camera"))
        return self.monitor.answer(seen, self.now + ahead, self.now)

    def level(self):
        return self.see().level

    def twist(self, values, late=0):
        self.monitor.receive_twist(values, self.now - late)

    def servo(self, frames, pose=START_2):
        """Follow the plain law, and return the latest assessment."""
        target_image = project_lines(self.scene.transformed(TARGET.inverse(), "camera"))
        for _ in range(frames):
            found = self.see(pose)
            lines = self.scene.transformed(pose.inverse(), "camera")
            error = project_lines(lines) - target_image
            twist = -0.1 * np.linalg.lstsq(interaction_matrix(lines), error, rcond=None)[0]
            self.twist(twist)
            pose = pose.integrate(twist, 0.04)
        self.pose = pose
        return found


def dotted(changes):
    return {name.replace("__", "."): value for name, value in changes.items()}


def number_here(name):
    """Return a rig, and the value of a number where its camera is."""
    rig = Rig(SCENE.select([0, 1, 2]) if name == "surface_distance" else SCENE)
    found = rig.see()
    kinds = {"transversal_distance": "transversal", "isolated_point_distance": "isolated"}
    names = rig.monitor.singular_set.locus_names
    if name.endswith("_distance"):
        lines = [each for each in names if each.startswith("line")]
        rows = [
            i for i, each in enumerate(names) if (each.startswith(kinds[name]) if name in kinds else each not in lines)
        ]
        return rig, min(found.locus_distances[rows])
    inverse = found.conditioning.inverse_condition_number
    return rig, {
        "inverse_condition_number": inverse,
        "relative_inverse_condition_number": inverse / found.target_inverse_condition_number,
        "smallest_singular_value": found.conditioning.smallest_singular_value,
        "z": found.proximity.z,
        "distance": found.proximity.distance,
    }[name]


@pytest.mark.parametrize("name", FALLING)
def test_thresholds_of_numbers_that_fall(name):
    rig, value = number_here(name)
    assert rig.level() is Level.OK
    rig.set({f"warn.{name}": 1.01 * value})
    assert rig.level() is Level.WARN
    rig.set({f"critical.{name}": 1.005 * value})
    assert rig.level() is Level.CRITICAL
    rig.set({f"critical.{name}": 0.9 * value})
    assert rig.level() is Level.CRITICAL
    rig.set({f"critical.{name}_exit": 0.95 * value})
    assert rig.level() is Level.WARN
    rig.set({f"critical.{name}": 0.0, f"warn.{name}": 0.9 * value})
    assert rig.level() is Level.WARN
    rig.set({f"warn.{name}_exit": 0.95 * value})
    assert rig.level() is Level.OK


@pytest.mark.parametrize(("name", "word"), [("position_std", "position"), ("rotation_std", "orientation")])
def test_thresholds_of_the_precision_left(name, word):
    rig = Rig()
    value = getattr(rig.see().proximity, name)
    for changes, expected in (
        ({"warn": 1.1 * value}, Level.OK),
        ({"warn": 0.98 * value}, Level.WARN),
        ({"critical": 0.985 * value}, Level.CRITICAL),
        ({"critical": 1.1 * value}, Level.CRITICAL),
        ({"critical_exit": 1.05 * value}, Level.WARN),
        ({"critical": 0.0, "warn": 1.1 * value}, Level.WARN),
        ({"warn_exit": 1.05 * value}, Level.OK),
    ):
        levels = {each.replace("_exit", ""): f"{name}_exit" if each.endswith("_exit") else name for each in changes}
        rig.set({f"{level}.{levels[level]}": changes[each] for each, level in zip(changes, levels, strict=True)})
        found = rig.see()
        assert found.level is expected, changes
        assert expected is Level.OK or mentions(found.reason, f"{word} error")


def test_the_precision_is_that_of_the_features():
    rig = Rig()
    seen = LineObservation.of_lines(SCENE.transformed(HERE.inverse(), "camera"))
    for std in (1e-3, 1e-2):
        rig.monitor.receive_pose(HERE, rig.now + STEP)
        rig.now += STEP
        covariances = np.tile([std**2, 0.0, std**2], (len(SCENE), 1))
        found = rig.monitor.answer(replace(seen, covariances=covariances), rig.now, rig.now).proximity
        expected = rig.monitor.singular_set.proximity(HERE, covariances=covariances)
        assert found.position_std == pytest.approx(expected.position_std)
    assert found.position_std != pytest.approx(rig.see().proximity.position_std, rel=0.5)


def test_a_singular_pose_without_a_locus_warns_by_its_distance():
    """Five lines off a common transversal by millimetres, taken as exact: nothing is listed, and the pose is bad."""
    transversal = singular_set(SCENE).transversals[0]
    meeting = transversal.point + 3.0 * transversal.direction + [2e-3, 0.0, 1e-3]
    scene = LineSet.from_points_directions(
        np.concatenate([SCENE.point, [meeting]]), np.concatenate([SCENE.direction, [[2.0, 1.0, 0.5]]])
    )
    rig = Rig(scene, lines__position_std=[0.0], lines__direction_std=[0.0])
    assert rig.monitor.singular_set.loci == ()
    rig.set({"warn.distance": 0.05})
    found = rig.see(Pose(LOOK, transversal.point - 4.0 * transversal.direction))
    assert found.nearest is None
    assert found.proximity.distance < 0.05
    assert found.level is Level.WARN
    assert mentions(found.reason, "distance", "singular pose")


def test_a_scene_that_is_bad_everywhere_warns_in_metres():
    """Five nosings that are parallel but for 1.5 mrad, which is far more than their tolerances."""
    points = [[0.0, 0.28 * i, 0.17 * i] for i in range(5)]
    directions = [[1.0, 1.5e-3 * (-1) ** i, 1.5e-3 * (i % 3 - 1)] for i in range(5)]
    scene = LineSet.from_points_directions(points, directions)
    monitor = SingularityMonitor.from_parameters(
        MonitorParameters.from_values(
            {"lines.points": np.ravel(points), "lines.directions": np.ravel(scene.direction)}
            | {"lines.position_std": [1e-3] * 5, "lines.direction_std": [1e-4] * 5}
        )
    )
    pose = Pose.look_at([0.5, -1.5, 1.5], [0.0, 0.5, 0.3])
    found = monitor.assess_pose(pose)
    assert found.level >= Level.WARN
    assert found.proximity.position_std > 0.1


def test_thresholds_of_the_growth_expected():
    rig = Rig(prediction__horizon=1.0, warn__speed_growth=1e-6)
    reason = rig.servo(20).reason
    growth = float(re.search(r"expected in [\d.]+ s, ([\d.e+-]+) times", reason).group(1))
    steps = (
        ({"warn.speed_growth": 0.98 * growth}, Level.WARN),
        ({"critical.speed_growth": 0.985 * growth}, Level.CRITICAL),
        ({"critical.speed_growth": 1.1 * growth}, Level.CRITICAL),
        ({"critical.speed_growth_exit": 1.05 * growth}, Level.WARN),
        ({"critical.speed_growth": 0.0, "warn.speed_growth": 1.1 * growth}, Level.WARN),
        ({"warn.speed_growth_exit": 1.05 * growth}, Level.OK),
    )
    for changes, expected in steps:
        rig.set(changes)
        assert rig.servo(1, rig.pose).level is expected, changes


def test_the_growth_expected_is_switched_off_while_it_alerts():
    rig = Rig(prediction__horizon=1.0, warn__speed_growth=1e-6, debounce__lower=100)
    assert rig.servo(20).level is Level.WARN
    rig.set({"warn.speed_growth": 0.0})
    found = rig.servo(1, rig.pose)
    assert found.level is Level.OK and "speed" not in found.reason


def scene_moved(rig):
    before = rig.see().locus_distances
    # As the camera, so that what it sees fits the scene; it knows its pose to the shift.
    rig.set({"lines.points": rig.scene.point.ravel() + 0.02})
    assert np.abs(rig.see().locus_distances - before).max() > 0.01


def scene_turned(rig):
    before = rig.see().locus_distances
    rig.set({"lines.directions": rig.scene.direction.ravel() + 0.05 * np.eye(12)[4]})
    assert np.abs(rig.see().locus_distances - before).max() > 1e-3


def scene_renamed(rig):
    assert rig.level() is Level.OK
    rig.set({"lines.ids": [1, 2, 3, 5]})
    found = rig.see()
    assert found.line_count == 3 and mentions(found.reason, "id 4", "scene")


def target_moved(rig):
    before = rig.see().target_inverse_condition_number
    rig.set({"target.position": START_2.translation})
    assert rig.see().target_inverse_condition_number != pytest.approx(before, rel=1e-3)


def target_turned(rig):
    before = rig.see().target_inverse_condition_number
    rig.set({"target.orientation": TARGET.integrate([0, 0, 0, 0.3, 0.2, 0.1], 1.0).quaternion_xyzw})
    assert rig.see().target_inverse_condition_number != pytest.approx(before, rel=1e-3)


def target_unknown(rig):
    assert rig.see().target_inverse_condition_number is not None
    rig.set({"target.known": False})
    assert rig.see().target_inverse_condition_number is None


def clock_tolerated(rig):
    rig.see()
    assert rig.see(ahead=SECOND // 5) is None
    rig.set({"future_tolerance": 0.5})
    assert rig.see(ahead=SECOND // 5).level is Level.OK


def conditions_chosen(rig):
    rig.set({"condition_thresholds": "relative", "warn.inverse_condition_number": 1.0})
    assert rig.level() is Level.OK
    rig.set({"condition_thresholds": "absolute"})
    assert rig.level() is Level.WARN


def raised_at_once(rig):
    rig.set({"debounce.raise": 3})
    rig.see()
    rig.set({"warn.transversal_distance": 10.0})
    assert rig.level() is Level.OK
    rig.set({"debounce.raise": 2})
    assert rig.level() is Level.WARN


def lowered_at_once(rig):
    rig.set({"debounce.lower": 100, "warn.transversal_distance": 10.0})
    rig.see()
    rig.set({"warn.transversal_distance": 0.01})
    assert rig.level() is Level.WARN
    rig.set({"debounce.lower": 2})
    assert rig.level() is Level.OK


def looks_ahead(rig):
    rig.set({"critical.transversal_distance": 0.05, "warn.transversal_distance": 0.05})
    rig.see()
    transversal = rig.monitor.singular_set.transversals[0]
    away = rig.monitor.singular_set.distance_arrays(HERE.translation).closest_point[0] - HERE.translation
    rig.twist(np.concatenate([HERE.rotation.T @ away / 3.0, np.zeros(3)]))
    assert transversal.name == "transversal 1" and rig.level() is Level.OK
    rig.set({"prediction.horizon": 5.0})
    found = rig.see()
    assert found.level is Level.WARN and found.kind == "time" and mentions(found.reason, "transversal 1")


def rollout_decides(rig):
    rig.set({"prediction.rollout_rules": True, "prediction.horizon": 1.0, "warn.transversal_distance": 10.0})
    found = rig.see()
    assert found.level is Level.OK and mentions(found.reason, "roll-out")
    rig.set({"prediction.rollout_rules": False})
    assert rig.level() is Level.WARN


def rest_is_faster(rig):
    rig.set({"prediction.horizon": 1.0, "warn.speed_growth": 100.0})
    assert rig.servo(10).level is Level.OK
    rig.set({"prediction.min_speed": 100.0})
    assert rig.servo(1, rig.pose).level is Level.WARN


def rate_starts_anew(rig):
    poses = [HERE.integrate([0.01 * i * i, 0, 0, 0, 0, 0], 1.0) for i in range(6)]
    for pose in poses:
        assert rig.see(pose) is not None
    rig.set({"rate_window": 2})
    assert rig.see(poses[3]).inverse_condition_number_rate is None
    first, second = rig.see(poses[4]), rig.see(poses[5])
    change = second.conditioning.inverse_condition_number - first.conditioning.inverse_condition_number
    assert second.inverse_condition_number_rate == pytest.approx(change / 0.04)


def twist_too_old(rig):
    rig.see()
    rig.twist([0.1, 0, 0, 0, 0, 0], late=SECOND // 5)
    assert rig.see().trend is not Trend.UNKNOWN
    rig.set({"twist_timeout": 0.1})
    assert rig.see().trend is Trend.UNKNOWN


def length_counts(rig):
    before = rig.see().conditioning.scaled_inverse_condition_number
    rig.set({"characteristic_length": 3.0})
    found = rig.see().conditioning
    assert found.characteristic_length == 3.0 and found.scaled_inverse_condition_number != pytest.approx(before)


def silence_noticed(rig):
    rig.see()
    later = rig.now + SECOND // 4
    assert rig.monitor.silence(later) is None
    rig.set({"features_timeout": 0.1})
    assert rig.monitor.silence(later).level is Level.STALE


def pose_accepted(rig):
    assert rig.see(pose_late=SECOND // 2).position_source == "features"
    rig.set({"pose_tolerance": 1.0})
    assert rig.see(pose_late=SECOND // 2).position_source == "camera_pose"


def law_rolled_out(rig):
    rig.set({"prediction.horizon": 1.0})
    assert rig.see().risk is None
    rig.set({"prediction.controller": "law"})
    assert rig.see().risk is not None


def answers_come_more_often(rig):
    rig.set({"prediction.horizon": 1.0, "prediction.controller": "law", "prediction.period": 10.0})
    first = rig.see().risk
    assert rig.see().risk is first
    rig.set({"prediction.period": 0.04})
    assert rig.see().risk is not first


def missing_lines_are_waited_for(rig):
    def see_two():
        rig.now += STEP
        lines = rig.scene.select([0, 1]).transformed(HERE.inverse(), "camera")
        return rig.monitor.answer(LineObservation.of_lines(lines), rig.now, rig.now)

    rig.see()
    found = see_two()
    assert found.level is Level.OK and mentions(found.reason, "1 frame", "2 of 2 lines")
    rig.set({"debounce.dropout": 2})
    assert see_two().level is Level.UNOBSERVABLE


def a_pose_is_waited_for(rig):
    def see_without_pose():
        rig.now += STEP
        image = LineObservation.of_lines(rig.scene.transformed(HERE.inverse(), "camera"))
        return rig.monitor.answer(replace(image, lines_camera=None), rig.now, rig.now)

    assert [see_without_pose().level for _ in range(3)] == [Level.UNOBSERVABLE] * 3
    rig.set({"no_pose_timeout": 0.1})
    assert see_without_pose().level is Level.CRITICAL


def poses_off_are_tolerated(rig):
    off = Pose(HERE.rotation, HERE.translation + [0.1, 0.0, 0.0])
    seen = LineObservation.of_lines(SCENE.transformed(off.inverse(), "camera"))

    def see():
        rig.now += STEP
        rig.monitor.receive_pose(HERE, rig.now)
        return rig.monitor.answer(seen, rig.now, rig.now)

    found = see()
    assert found.level is Level.UNOBSERVABLE and "0.1 m" in found.reason
    rig.set({"tolerance.position": 0.2})
    assert see().level is Level.OK


EFFECTS = {
    "prediction.controller": law_rolled_out,
    "prediction.period": answers_come_more_often,
    "debounce.dropout": missing_lines_are_waited_for,
    "no_pose_timeout": a_pose_is_waited_for,
    "tolerance.position": poses_off_are_tolerated,
    "lines.points": scene_moved,
    "lines.directions": scene_turned,
    "lines.ids": scene_renamed,
    "target.position": target_moved,
    "target.orientation": target_turned,
    "target.known": target_unknown,
    "future_tolerance": clock_tolerated,
    "condition_thresholds": conditions_chosen,
    "debounce.raise": raised_at_once,
    "debounce.lower": lowered_at_once,
    "prediction.horizon": looks_ahead,
    "prediction.rollout_rules": rollout_decides,
    "prediction.min_speed": rest_is_faster,
    "rate_window": rate_starts_anew,
    "twist_timeout": twist_too_old,
    "characteristic_length": length_counts,
    "features_timeout": silence_noticed,
    "pose_tolerance": pose_accepted,
}


@pytest.mark.parametrize("name", EFFECTS)
def test_a_change_shows_in_the_next_assessment(name):
    EFFECTS[name](Rig())


def test_no_live_parameter_is_left_out():
    monitored = (*JUDGED, "risk", "demand", "shaking", "time_to_harm")
    thresholds = {
        f"{level}.{name}{end}" for level in ("warn", "critical") for name in monitored for end in ("", "_exit")
    }
    # test_risk changes each parameter of the loop, test_consistency the tolerances.
    loop = {name for name, _ in LoopParameters.specifications().items()}
    assert thresholds | set(EFFECTS) == set(LIVE) - (loop - set(EFFECTS) - TASK)


def test_a_refused_set_changes_nothing():
    rig = Rig()
    before = rig.monitor.parameters
    with pytest.raises(ParameterError, match="'critical.transversal_distance'"):
        rig.set({"warn.transversal_distance": 0.1, "critical.transversal_distance": 0.2, "rate_window": 5})
    assert rig.monitor.parameters is before and rig.level() is Level.OK
