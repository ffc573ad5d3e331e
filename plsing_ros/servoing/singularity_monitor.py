"""The monitor's cycle without ROS: an observation in, an assessment out."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.features import Conditioning, LineObservation, conditioning, interaction_matrix
from plsing_ros.geometry import LineSet, Pose, align_lines
from plsing_ros.geometry.line_alignment import lines_to_reverse, reversed_lines
from plsing_ros.parameters import MonitorParameters
from plsing_ros.servoing.freshness import Freshness
from plsing_ros.servoing.goal import Goal
from plsing_ros.servoing.levels import Debounce, Latch, Level, Thresholds, threshold_text
from plsing_ros.servoing.line_servo import MINIMUM_LINES
from plsing_ros.servoing.lost_motion_text import lost_motion_text
from plsing_ros.servoing.prediction import Approach, ApproachTable, LawPreview, Slope, Trend
from plsing_ros.singularities import DistanceArrays, Kind, LocusDistance, SingularSet, singular_set

_SECOND = 1_000_000_000
# Poses and features come on two topics: enough poses to find the one that belongs to features that were overtaken.
_REMEMBERED_POSES = 10
# Features whose directions fit the scene no better than this do not belong to it [rad].
_LARGEST_MISFIT = 0.5
# A rate counts when it is this many times its standard error.
_SIGNIFICANT = 3.0
# How far ahead the closest approach is looked for, at least [s].
_LOOK_AHEAD = 10.0
# Of a number that does not count at present.
_OFF = Thresholds(0.0, 0.0)
_DISABLED = "switched off by ~/enable"
_DISTANCE_GROUPS = {
    "transversal_distance": (Kind.TRANSVERSAL,),
    "isolated_point_distance": (Kind.ISOLATED_POINT,),
    "surface_distance": (Kind.PLANE, Kind.QUADRIC, Kind.CUBIC),
}


@dataclass(frozen=True, eq=False)
class Assessment:
    """How near to a singularity the camera is.

    Attributes:
        level: Level of concern.
        reason: Why, in words.
        stamp: Of the features it speaks of [ns]; of the clock when there are none; 0 for a hypothetical pose.
        line_count: Lines that took part.
        conditioning: Of the interaction matrix, or None without usable features.
        inverse_condition_number_rate: [1/s], fitted to the latest features, or None if there was no earlier value.
        locus_distances: Distances of the camera centre [m] in the order of SingularSet.locus_names, shape (m,), or
            None if the camera position is not known.
        nearest: The nearest locus other than the observed lines, or None if there is none or the position is not known.
        trend: How the camera moves with respect to the nearest locus.
        approach: The closest approach within the horizon if the motion goes on, or None if there is none or the
            position or the twist is not known.
        time_to_critical: When the inverse condition number falls below its critical threshold at its present rate [s],
            or None if it does not, or the rate is not clear of noise.
        position_source: "camera_pose", "features", or "" if the camera position is not known.
        lost_motion_text: The weakest motion in words, near a singularity; else empty.
        goal_inverse_condition_number: At the goal with the same lines, or None if no goal is known.
        pose: T_world_camera that the distances belong to, or None if the camera position is not known.
    """

    level: Level
    reason: str
    stamp: int
    line_count: int = 0
    conditioning: Conditioning | None = None
    inverse_condition_number_rate: float | None = None
    locus_distances: Array | None = None
    nearest: LocusDistance | None = None
    trend: Trend = Trend.UNKNOWN
    approach: Approach | None = None
    time_to_critical: float | None = None
    position_source: str = ""
    lost_motion_text: str = ""
    goal_inverse_condition_number: float | None = None
    pose: Pose | None = None


class _Indicator(NamedTuple):
    """One number that is the worse the smaller it is."""

    name: str
    value: float
    thresholds: Thresholds
    text: str
    unit: str = ""


@dataclass(frozen=True, eq=False)
class _Present:
    """What is known of the present cycle before it is judged."""

    conditioning: Conditioning
    goal_inverse: float | None
    distances: DistanceArrays | None
    nearest: LocusDistance | None


class SingularityMonitor:
    """Assesses each observation against the singular set of the scene, computed once for each scene.

    Attributes:
        enabled: When False, every answer is DISABLED.
    """

    def __init__(self, parameters: MonitorParameters) -> None:
        self.enabled = True
        self._freshness = Freshness("features", parameters.features_timeout, parameters.future_tolerance)
        self._poses: deque[tuple[int, Pose]] = deque(maxlen=_REMEMBERED_POSES)
        self._preview = LawPreview()
        self._twist: tuple[int, Array] | None = None
        self._goal: Goal | None = None
        self._parameters = parameters
        self._use_scene(singular_set(parameters.lines()))
        self._use_target(parameters)
        self._use(parameters)

    @property
    def found(self) -> SingularSet:
        """The singular set of the scene."""
        return self._found

    @property
    def parameters(self) -> MonitorParameters:
        """The parameters in force; setting them takes effect at the next assessment."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: MonitorParameters) -> None:
        before = self._parameters
        new_scene = _scene(parameters) != _scene(before)
        # Whatever raises comes first, so that a refused set changes nothing.
        found = singular_set(parameters.lines()) if new_scene else self._found
        if new_scene or _target(parameters) != _target(before):
            self._use_target(parameters)
        if new_scene:
            self._use_scene(found)
        self._use(parameters)

    def _use_scene(self, found: SingularSet) -> None:
        self._found = found
        self._approaches = ApproachTable(found)
        self._rows = {
            name: np.array([i for i, kind in enumerate(found.locus_kinds) if kind in kinds], dtype=np.intp)
            for name, kinds in _DISTANCE_GROUPS.items()
        }
        self._forget()

    def _use_target(self, parameters: MonitorParameters) -> None:
        goal = None
        if parameters.target_known:
            seen = parameters.lines().transformed(parameters.target_pose().inverse(), "camera at the target")
            goal = Goal(LineObservation.of_lines(seen), "target pose")
        self._set_goal(goal)

    def _use(self, parameters: MonitorParameters) -> None:
        self._freshness.timeout = parameters.features_timeout
        self._freshness.future_tolerance = parameters.future_tolerance
        self._debounce = Debounce(parameters.raise_cycles, parameters.lower_cycles)
        if parameters.rate_window != self._parameters.rate_window:
            self._slope = Slope(parameters.rate_window)
        self._thresholds = {
            name: _thresholds(parameters, name)
            for name in (
                *_DISTANCE_GROUPS,
                "inverse_condition_number",
                "relative_inverse_condition_number",
                "smallest_singular_value",
            )
        }
        # Growth is the worse the larger it is: its inverse is judged.
        growth = Thresholds(
            _inverse(parameters.warn_growth),
            _inverse(parameters.critical_growth),
            _inverse(parameters.warn_growth_exit),
            _inverse(parameters.critical_growth_exit),
        )
        self._thresholds["speed_growth"] = growth
        self._parameters = parameters

    def set_goal(self, observation: LineObservation) -> None:
        """Take what the camera will see at the goal, with 3-D lines, from now on.

        Raises:
            ObservationError: If it has fewer than three usable lines, or no 3-D lines.
        """
        self._set_goal(Goal(observation, "desired features"))

    def _set_goal(self, goal: Goal | None) -> None:
        self._goal = goal
        self._preview.clear()
        self._first_speed = 0.0

    def receive_pose(self, T_world_camera: Pose, stamp: int) -> None:
        """Take the camera's pose in the scene frame at a stamp [ns], for features of about that time."""
        self._poses.append((stamp, T_world_camera))

    def forget_poses(self) -> None:
        """Trust no pose received so far: the latest one was refused."""
        self._poses.clear()

    def receive_twist(self, twist: npt.ArrayLike, stamp: int) -> None:
        """Take the commanded twist of the camera in its optical frame, shape (6,) [m/s, rad/s], at a stamp [ns].

        Raises:
            GeometryError: If it is not six finite numbers.
        """
        values = checked_array("twist", twist, (6,))
        self._twist = (stamp, values)
        speed = float(np.linalg.norm(values[:3]))
        # A motion begins when the camera leaves its rest; that speed is what growth refers to.
        if speed < self.parameters.least_speed:
            self._first_speed = 0.0
        elif self._first_speed == 0.0:
            self._first_speed = speed

    def assess(self, observation: LineObservation, stamp: int, now: int) -> Assessment | None:
        """Return the assessment of an observation, or None if it is refused (too old, out of order) among good ones.

        Args:
            observation: What the camera sees, with 3-D lines.
            stamp: Of the observation [ns].
            now: Of the node clock [ns].
        """
        if not self.enabled:
            return self._disabled(stamp)
        self._follow_clock(now)
        refusal = self._freshness.refusal(stamp, now)
        if refusal is not None:
            # One bad message among good ones changes nothing; a stream of them is as good as silence.
            silence = self._freshness.silence(now)
            return None if silence is None else self._unknown(Level.STALE, silence, now)
        try:
            lines = self._usable_lines(observation)
            pose, source = self._camera_pose(lines, stamp)
        except ObservationError as error:
            return self.unusable(str(error), stamp)
        present = self._measured(lines, None if pose is None else pose.translation)
        inverse = present.conditioning.inverse_condition_number
        indicators = self._indicators(present)
        slope = self._slope.add(inverse, stamp)
        time_to_critical = self._time_to_critical(inverse, slope, present.goal_inverse)
        trend, approach = self._motion(present, pose, stamp)
        growth = self._previewed_growth(lines, stamp)
        near = any(each.thresholds.entered(each.value) for each in indicators)
        if growth is not None and self._parameters.preview_rules:
            # Near a singularity is not yet in trouble: here it is known what the law will do.
            indicators = [each._replace(thresholds=_OFF) for each in indicators]
        indicators += self._predictions(growth, time_to_critical, approach)
        judged = self._judged(present, indicators, [self._latched(each) for each in indicators], source)
        if near and judged.level == Level.OK:
            judged = replace(judged, reason=f"{judged.reason}; near a singularity, passed calmly by the law's preview")
        return replace(
            judged,
            stamp=stamp,
            line_count=len(lines),
            inverse_condition_number_rate=None if slope is None else slope[0],
            trend=trend,
            approach=approach,
            time_to_critical=time_to_critical,
            position_source=source,
            lost_motion_text=self._lost_motion(judged, pose) if near or judged.level != Level.OK else "",
            pose=pose,
        )

    def assess_pose(self, T_world_camera: Pose) -> Assessment:
        """Return what a camera that sees all lines of the scene would be told at a pose; nothing else is changed by it.

        Its level is without hysteresis, debounce and prediction; the relative thresholds take part if a goal is known.
        """
        seen = LineObservation.of_lines(self._found.lines.transformed(T_world_camera.inverse(), "camera"))
        try:
            lines = self._usable_lines(seen)
        except ObservationError as error:
            return Assessment(Level.UNOBSERVABLE, str(error), 0)
        present = self._measured(lines, T_world_camera.translation)
        indicators = self._indicators(present)
        levels = [each.thresholds.entered(each.value) for each in indicators]
        judged = self._judged(present, indicators, levels, "pose asked for")
        text = self._lost_motion(judged, T_world_camera) if judged.level != Level.OK else ""
        return replace(judged, line_count=len(lines), position_source="camera_pose", lost_motion_text=text)

    def silence(self, now: int) -> Assessment | None:
        """Return what to say when no features come (now in ns): STALE, DISABLED, or None if they are recent enough."""
        if not self.enabled:
            return self._disabled(now)
        self._follow_clock(now)
        reason = self._freshness.silence(now)
        return None if reason is None else self._unknown(Level.STALE, reason, now)

    def unusable(self, reason: str, stamp: int) -> Assessment:
        """Return the UNOBSERVABLE assessment of features that cannot be used."""
        if not self.enabled:
            return self._disabled(stamp)
        self._freshness.note_problem(reason)
        return self._unknown(Level.UNOBSERVABLE, reason, stamp)

    def _disabled(self, stamp: int) -> Assessment:
        return self._unknown(Level.DISABLED, _DISABLED, stamp)

    def _unknown(self, level: Level, reason: str, stamp: int) -> Assessment:
        self._forget()
        return Assessment(level, reason, stamp)

    def _forget(self) -> None:
        """Begin anew: what was before says nothing about what comes next."""
        self._latches: dict[str, Latch] = {}
        self._slope = Slope(self._parameters.rate_window)
        self._preview.clear()

    def _follow_clock(self, now: int) -> None:
        """Drop everything stamped by a clock that has since jumped back."""
        if self._freshness.follow_clock(now):
            self._poses.clear()
            self._twist = None
            self._first_speed = 0.0
            self._forget()

    def _usable_lines(self, observation: LineObservation) -> LineSet:
        known = self._found.lines.ids
        if observation.ids != known:
            unknown = sorted(set(observation.ids) - set(known))
            if unknown:
                raise ObservationError(f"line id {unknown[0]} is not in the scene, whose ids are {list(known)}")
        if observation.lines_camera is None and observation.usable_ids:
            raise ObservationError("features have no 3-D lines (directions and moments are empty)")
        if observation.lines_camera is None or len(observation.lines_camera) < MINIMUM_LINES:
            raise ObservationError(
                f"{len(observation.usable_ids)} of {len(observation.ids)} lines are usable "
                f"({list(observation.usable_ids)}); at least {MINIMUM_LINES} are needed"
            )
        return observation.lines_camera

    def _camera_pose(self, lines: LineSet, stamp: int) -> tuple[Pose | None, str]:
        """Return where the camera is, by the pose of about that time or else by the lines, and which of the two."""
        scene = self._found.lines
        pose = self._received_pose(stamp)
        if pose is not None:
            against = reversed_lines(scene, lines, pose.rotation)
            source = "camera_pose"
        else:
            try:
                aligned = align_lines(scene, lines)
            except (GeometryError, np.linalg.LinAlgError):
                return None, ""
            pose, source, against = aligned.T_scene_camera, "features", ()
            if aligned.angle > _LARGEST_MISFIT:
                against = lines_to_reverse(scene, lines, _LARGEST_MISFIT)
                if not against:
                    return None, ""
        if against:
            several = len(against) > 1
            raise ObservationError(
                f"line{'s' if several else ''} {', '.join(map(str, against))} {'are' if several else 'is'} reversed "
                "with respect to the scene: the direction's sign must agree with lines.directions"
            )
        return pose, source

    def _received_pose(self, stamp: int) -> Pose | None:
        if not self._poses:
            return None
        pose_stamp, T_world_camera = min(self._poses, key=lambda each: abs(each[0] - stamp))
        return T_world_camera if abs(pose_stamp - stamp) <= self._parameters.pose_tolerance * _SECOND else None

    def _measured(self, lines: LineSet, camera_center: Array | None) -> _Present:
        numbers = conditioning(interaction_matrix(lines), self._parameters.characteristic_length)
        goal_inverse = None if self._goal is None else self._goal.inverse_condition_number(lines.ids)
        if camera_center is None:
            return _Present(numbers, goal_inverse, None, None)
        arrays = self._found.distance_arrays(camera_center)
        rows = self._approaches.rows
        nearest = None
        if len(rows):
            row = int(rows[arrays.distance[rows].argmin()])
            kind, name = self._found.locus_kinds[row], self._found.locus_names[row]
            nearest = LocusDistance(kind, name, float(arrays.distance[row]), arrays.closest_point[row])
        return _Present(numbers, goal_inverse, arrays, nearest)

    def _condition_rules(self, goal_inverse: float | None) -> tuple[bool, bool]:
        """Return whether the absolute and whether the relative thresholds rule."""
        mode = self._parameters.condition_thresholds
        relative = goal_inverse is not None and goal_inverse > 0.0 and mode != "absolute"
        return mode in ("absolute", "both") or (mode == "auto" and not relative), relative

    def _indicators(self, present: _Present) -> list[_Indicator]:
        inverse = present.conditioning.inverse_condition_number
        absolute, relative = self._condition_rules(present.goal_inverse)
        found = []
        if absolute:
            name = "inverse_condition_number"
            found.append(_Indicator(name, inverse, self._thresholds[name], f"inverse condition number {inverse:.4g}"))
        if relative and present.goal_inverse is not None:
            name, ratio = "relative_inverse_condition_number", inverse / present.goal_inverse
            text = f"inverse condition number {inverse:.4g}, {ratio:.3g} of that at the goal,"
            found.append(_Indicator(name, ratio, self._thresholds[name], text))
        name, value = "smallest_singular_value", present.conditioning.smallest_singular_value
        found.append(_Indicator(name, value, self._thresholds[name], f"smallest singular value {value:.4g}"))
        if present.distances is not None:
            for name, rows in self._rows.items():
                if len(rows) == 0:
                    continue
                row = int(rows[present.distances.distance[rows].argmin()])
                value = float(present.distances.distance[row])
                text = f"distance {value:.3f} m from {self._found.locus_names[row]}"
                found.append(_Indicator(name, value, self._thresholds[name], text, " m"))
        return found

    def _time_to_critical(
        self, inverse: float, slope: tuple[float, float] | None, goal_inverse: float | None
    ) -> float | None:
        if slope is None or slope[0] >= -_SIGNIFICANT * slope[1] or slope[0] >= 0.0:
            return None
        absolute, relative = self._condition_rules(goal_inverse)
        limit = self._thresholds["inverse_condition_number"].critical if absolute else 0.0
        if relative and goal_inverse is not None:
            limit = max(limit, self._thresholds["relative_inverse_condition_number"].critical * goal_inverse)
        if inverse <= limit:
            return 0.0
        # Never infinite: a rate that is almost nothing leads nowhere.
        time = (inverse - limit) / -slope[0] if -slope[0] > 1e-300 else math.inf
        return time if time < 1e9 and limit > 0.0 else None

    def _recent_twist(self, stamp: int) -> Array | None:
        if self._twist is None or abs(stamp - self._twist[0]) > self._parameters.twist_timeout * _SECOND:
            return None
        return self._twist[1]

    def _motion(self, present: _Present, pose: Pose | None, stamp: int) -> tuple[Trend, Approach | None]:
        twist = self._recent_twist(stamp)
        if twist is None or pose is None or present.distances is None:
            return Trend.UNKNOWN, None
        horizon = max(self._parameters.horizon, _LOOK_AHEAD)
        return self._approaches.ahead(present.distances, pose.translation, pose.rotation @ twist[:3], horizon)

    def _previewed_growth(self, lines: LineSet, stamp: int) -> tuple[float, float] | None:
        """Return how many times the speed at the start is expected within the horizon, and when [s], or None."""
        twist = self._recent_twist(stamp)
        desired = None if self._goal is None else self._goal.image_lines(lines.ids)
        if twist is None or desired is None or self._first_speed == 0.0 or self._parameters.horizon == 0.0:
            self._preview.clear()
            return None
        ahead = self._preview.advance(lines, desired, twist, self._parameters.horizon)
        if ahead is None:
            return None
        return max(ahead[0], self._parameters.least_speed) / self._first_speed, ahead[1]

    def _predictions(
        self, growth: tuple[float, float] | None, time_to_critical: float | None, approach: Approach | None
    ) -> list[_Indicator]:
        """Return what is to come as numbers; infinite where nothing is, so that an alert ends by its debounce."""
        thresholds = self._thresholds["speed_growth"]
        horizon = self._parameters.horizon
        soon, what = math.inf, "the critical inverse condition number"
        if growth is not None:
            text = f"speed expected in {growth[1]:.2f} s, {growth[0]:.3g} times that at the start,"
            speed = _Indicator("speed_growth", 1.0 / growth[0], thresholds, text)
        else:
            speed = _Indicator("speed_growth", math.inf, thresholds, "speed, no longer predicted,")
            # Without the law, only where the motion leads if it goes on as it is.
            if time_to_critical is not None:
                soon = time_to_critical
            if approach is not None and approach.time < soon and self._is_critical(approach):
                soon, what = approach.time, f"the closest approach to {approach.name}"
        ahead = f"{soon:.2f} s" if math.isfinite(soon) else "no longer expected,"
        return [speed, _Indicator("time", soon, Thresholds(horizon, 0.0), f"time to {what}, {ahead}", " s")]

    def _is_critical(self, approach: Approach) -> bool:
        name = next(name for name, kinds in _DISTANCE_GROUPS.items() if approach.kind in kinds)
        return approach.distance < self._thresholds[name].critical

    def _latched(self, indicator: _Indicator) -> Level:
        latch = self._latches.setdefault(indicator.name, Latch())
        return latch.update(indicator.value, indicator.thresholds, self._debounce)

    def _judged(self, present: _Present, indicators: list[_Indicator], levels: list[Level], source: str) -> Assessment:
        inverse = present.conditioning.inverse_condition_number
        level = max(levels, default=Level.OK)
        if self._found.singular_everywhere:
            level, reason = Level.UNOBSERVABLE, f"the scene is singular for every camera: {self._found.description}"
        elif level == Level.OK:
            reason = f"inverse condition number {inverse:.4g}"
        else:
            reason = "; ".join(
                _growth_text(each, level)
                if each.name == "speed_growth"
                else f"{each.text} is {threshold_text(each.value, each.thresholds, level, each.unit)}"
                for each, own in zip(indicators, levels, strict=True)
                if own == level
            )
        nearest = present.nearest
        if source == "":
            reason += (
                f"; distances not known: no camera_pose within {self._parameters.pose_tolerance:g} s of the features, "
                "and their 3-D lines do not fit the scene"
            )
        elif nearest is not None and f"from {nearest.name}" not in reason:
            reason += f"; {nearest.distance:.3f} m from {nearest.name}"
        if source == "features":
            reason += " (camera position from the features, no recent camera_pose)"
        distances = None if present.distances is None else present.distances.distance
        return Assessment(
            level,
            reason,
            0,
            conditioning=present.conditioning,
            locus_distances=distances,
            nearest=nearest,
            goal_inverse_condition_number=present.goal_inverse,
        )

    def _lost_motion(self, judged: Assessment, pose: Pose | None) -> str:
        if judged.conditioning is None:
            return ""
        return lost_motion_text(judged.conditioning.weakest_motion, pose, self._found, judged.nearest)


def _scene(parameters: MonitorParameters) -> tuple[object, ...]:
    return parameters.lines_points, parameters.lines_directions, parameters.lines_ids


def _target(parameters: MonitorParameters) -> tuple[object, ...]:
    return parameters.target_known, parameters.target_position, parameters.target_orientation


def _thresholds(parameters: MonitorParameters, name: str) -> Thresholds:
    warn, warn_exit, critical, critical_exit = parameters.thresholds(name)
    return Thresholds(warn, critical, warn_exit, critical_exit)


def _inverse(value: float) -> float:
    return 1.0 / value if value > 0.0 else 0.0


def _growth_text(indicator: _Indicator, level: Level) -> str:
    threshold = indicator.thresholds.critical if level == Level.CRITICAL else indicator.thresholds.warn
    side = "above" if indicator.value < threshold else "not yet clearly below"
    return f"{indicator.text} is {side} {1.0 / threshold:.4g} times"
