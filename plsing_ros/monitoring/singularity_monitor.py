# SPDX-License-Identifier: Apache-2.0
"""The monitor's cycle without ROS: an observation in, an assessment out."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError, PlsingError
from plsing_ros.features import (
    Conditioning,
    LineObservation,
    LinesVerdict,
    checked_observation,
    decompose,
    interaction_conditioning,
    smallest_over_largest,
)
from plsing_ros.features.consistency import ConsistencyCheck, left_out_text
from plsing_ros.features.target import MINIMUM_LINES
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.line_alignment import pose_by_lines
from plsing_ros.geometry.pose import checked_twist
from plsing_ros.levels import Level
from plsing_ros.monitoring.alarm_state import AlarmState, reasons, with_position, worst, worst_names
from plsing_ros.monitoring.approach import Approach, ApproachTable, Trend
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.camera_position import CameraPosition, locate
from plsing_ros.monitoring.hysteresis import OK, Debounce
from plsing_ros.monitoring.indicators import Indicators, below_alarm, condition_text, precision_text, verdict_indicator
from plsing_ros.monitoring.law_risks import laws_text, risks_of_laws
from plsing_ros.monitoring.monitored_target import NOT_KNOWN, MonitoredTarget
from plsing_ros.monitoring.prediction import Prediction
from plsing_ros.monitoring.risk import Risk, RiskPredictor
from plsing_ros.monitoring.slope import Slope
from plsing_ros.monitoring.unobservable_motion_text import unobservable_motion_text
from plsing_ros.parameters import MonitorParameters
from plsing_ros.parameters.options import parameters_from_options, pose_options
from plsing_ros.pose.line_lifting import lift_lines_at
from plsing_ros.singularities import DistanceArrays, Proximity, SingularSet, singular_set
from plsing_ros.stamp_filter import StampFilter, stamp_from_seconds

_SECOND = 1_000_000_000
# How far ahead the closest approach is looked for, at least [s].
_LOOK_AHEAD = 10.0
_DISABLED = "switched off by ~/enable"
# Kind of an alert.
_NO_POSE = "no pose"


class SingularityMonitor:
    """Assesses each observation against the singular set of the scene, computed once for each scene.

    Args:
        lines: The scene, in the world frame.
        target: T_world_camera of the target, or what the camera sees there; None if it is not known.
        options: Every parameter of the monitor by its name (docs/reference), nested where it has dots:
            warn={"transversal_distance": 0.05}.

    Raises:
        ParameterError: If an option is unknown or not allowed.
        ObservationError: If the target shows fewer than three usable lines.

    Attributes:
        enabled: When False, every answer is DISABLED.
    """

    def __init__(self, lines: LineSet, target: Pose | LineObservation | None = None, **options: Any) -> None:
        given = dict(options)
        if isinstance(target, Pose):
            given["target"] = {"known": True} | pose_options(target) | given.get("target", {})
        self._start(parameters_from_options(MonitorParameters, given, lines))
        if isinstance(target, LineObservation):
            self.set_target(target)

    @classmethod
    def from_parameters(cls, parameters: MonitorParameters, executor: Executor | None = None) -> SingularityMonitor:
        """Return a monitor with the parameters of a node.

        Args:
            parameters: In force.
            executor: Makes the roll-outs, each when begin_rollout is called; None: they are made within `answer`.
        """
        monitor = cls.__new__(cls)
        monitor._start(parameters, executor)
        return monitor

    def _start(self, parameters: MonitorParameters, executor: Executor | None = None) -> None:
        self.enabled = True
        self._latest: Assessment | None = None
        self._stamp_filter = StampFilter("features", parameters.features_timeout, parameters.future_tolerance)
        self._position = CameraPosition()
        self._prediction = Prediction()
        self._risk = RiskPredictor(executor)
        self._refused_as = Level.STALE
        self._held: Assessment | None = None
        self._missing = 0
        self._blind_since: int | None = None
        self._check = ConsistencyCheck(None)
        self._T_world_target: Pose | None = None
        self._motion_at_target: str | None = None
        self._alarm_state = AlarmState(Debounce(parameters.raise_cycles, parameters.lower_cycles))
        self._parameters = parameters
        self._use_scene(singular_set(parameters.lines()))
        self._set_target(_monitored_target(parameters), _target_pose(parameters))
        self._use(parameters)

    @property
    def singular_set(self) -> SingularSet:
        """The singular set of the scene."""
        return self._singular_set

    @property
    def parameters(self) -> MonitorParameters:
        """The parameters in force; setting them takes effect at the next assessment."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: MonitorParameters) -> None:
        self.prepare(parameters)()

    def prepare(self, parameters: MonitorParameters) -> Callable[[], None]:
        """Return what puts changed parameters in force; a PlsingError if they are refused, with nothing changed."""
        before = self._parameters
        new_scene = parameters.scene != before.scene
        new_target = new_scene or _target(parameters) != _target(before)
        singular = singular_set(parameters.lines()) if new_scene else self._singular_set
        target = _monitored_target(parameters) if new_target else None

        def put_in_force() -> None:
            if new_target:
                self._set_target(target, _target_pose(parameters))
            if new_scene:
                self._use_scene(singular)
            self._use(parameters)

        return put_in_force

    def _use_scene(self, singular: SingularSet) -> None:
        self._singular_set = singular
        # Computed now, not in the first cycle that needs it.
        _ = singular.normal_condition
        self._approaches = ApproachTable(singular)
        self._check = ConsistencyCheck(singular.lines, self._parameters.tolerances)
        self._risk.restart()
        self._forget()

    def _use(self, parameters: MonitorParameters) -> None:
        self._stamp_filter.timeout = parameters.features_timeout
        self._stamp_filter.future_tolerance = parameters.future_tolerance
        self._alarm_state.debounce = Debounce(parameters.raise_cycles, parameters.lower_cycles)
        self._indicators = Indicators(self._singular_set, parameters)
        if parameters.tolerances != self._check.tolerances:
            self._check = ConsistencyCheck(self._singular_set.lines, parameters.tolerances)
        if parameters.rate_window != self._parameters.rate_window:
            self._slope = Slope(parameters.rate_window)
        self._parameters = parameters

    def set_target(self, observation: LineObservation) -> None:
        """Take what the camera will see at the target, with 3-D lines, from now on.

        Raises:
            ObservationError: If it has fewer than three usable lines, or no 3-D lines.
        """
        target, pose = MonitoredTarget(observation, "desired features", self._parameters.columns), None
        if target.lines is not None:
            try:
                pose = pose_by_lines(self._singular_set.lines, target.lines)
            except ObservationError as error:
                raise ObservationError(f"desired features: {error}") from None
        self._set_target(target, pose)

    def _set_target(self, target: MonitoredTarget | None, T_world_target: Pose | None) -> None:
        self._target, self._T_world_target = target, T_world_target
        self._motion_at_target = None
        self._blind_since = None
        self._prediction.restart()
        self._risk.restart()

    def receive_pose(self, T_world_camera: Pose, stamp: int, covariance: Array | None = None) -> None:
        """Take the camera's pose in the scene frame at a stamp [ns], for features of about that time.

        Args:
            T_world_camera: Where it is.
            stamp: [ns].
            covariance: In the scene's axes, (position [m], rotation [rad]), shape (6, 6); None: exact.
        """
        self._position.receive(T_world_camera, stamp, covariance)

    def forget_poses(self) -> None:
        """Trust no pose received so far: the latest one was refused."""
        self._position.forget()

    def receive_twist(self, twist: npt.ArrayLike, stamp: int) -> None:
        """Take the commanded twist of the camera in its optical frame, shape (6,) [m/s, rad/s], at a stamp [ns].

        Raises:
            GeometryError: If it is not six finite numbers, or one is beyond 1e50.
        """
        checked = checked_twist("twist", twist)
        self._prediction.receive_twist(checked, stamp, self._parameters.min_speed)
        self._risk.receive_twist(checked, stamp, self._parameters.min_speed)

    def receive_controller(self, law: str, gain: float) -> None:
        """Take the law and lambda [1/s] that the controller says are in force."""
        self._risk.receive_controller(law, gain)

    def receive_path(self, poses: Sequence[Pose]) -> None:
        """Take the path of law = detour, T_world_camera from start to target, as it is planned; none: it has none."""
        self._risk.receive_path(poses)

    def begin_rollout(self) -> None:
        """Hand over the roll-out that the latest answer asked for, if any, to the executor."""
        self._risk.begin_rollout()

    def assess(
        self,
        observation: LineObservation,
        time: float,
        pose: Pose | None = None,
        twist: npt.ArrayLike | None = None,
    ) -> Assessment:
        """Return the assessment of an observation that is made now.

        Args:
            observation: What the camera sees. Image lines alone are lifted to 3-D lines by the pose.
            time: Of the observation [s], from any origin. One that is earlier than the last changes nothing.
            pose: T_world_camera at that time, if it is known.
            twist: (v, omega) that is commanded in answer, shape (6,) [m/s, rad/s], if it is known.

        Raises:
            ObservationError: If the time is not a finite number, or beyond 1e9 s, or the observation is something else.
        """
        stamp = stamp_from_seconds(time)
        checked_observation(observation)
        if pose is not None:
            self.receive_pose(pose, stamp)
            if observation.lines_camera is None and observation.usable_ids:
                observation = lift_lines_at(self._singular_set.lines, pose, observation)
        try:
            if twist is not None:
                self.receive_twist(twist, stamp)
            assessment = self.answer(observation, stamp, stamp)
        except PlsingError as error:
            assessment = self.unusable(str(error), stamp)
        if assessment is not None:
            self._latest = assessment
        assert self._latest is not None
        return self._latest

    def answer(self, observation: LineObservation, stamp: int, now: int) -> Assessment | None:
        """Return the assessment of an observation with the stamp of its message.

        None if it is refused (too old, out of order) among good ones.

        Args:
            observation: What the camera sees, with 3-D lines.
            stamp: Of the observation [ns].
            now: Of the node clock [ns].
        """
        if not self.enabled:
            return self._disabled(stamp)
        self._follow_clock(now)
        refusal = self._stamp_filter.refusal(stamp, now)
        if refusal is not None:
            # One bad message among good ones changes nothing; a stream of them is as good as silence.
            self._refused_as = Level.STALE
            silence = self._stamp_filter.silence(now)
            return None if silence is None else self._unknown(Level.STALE, silence, now)
        parameters, singular = self._parameters, self._singular_set
        observation, note = self._without_unknown(observation)
        try:
            lines = self._usable_lines(observation)
        except ObservationError as error:
            return self._hold_or_refuse(str(error) + note, stamp, observation)
        told = self._position.received(stamp, parameters.pose_tolerance)
        problem = self._check.contradiction(observation, told)
        if problem is not None:
            return self.unusable(problem, stamp)
        try:
            pose, source = locate(singular.lines, lines, told)
        except ObservationError as error:
            return self.unusable(str(error), stamp)
        self._missing, self._blind_since = 0, None
        numbers = interaction_conditioning(lines, parameters.characteristic_length)
        ruling = self._ruling(numbers)
        target_inverse, target_image = NOT_KNOWN if self._target is None else self._target.at(lines.ids)
        distances = None if pose is None else singular.distance_arrays(pose.translation)
        known = observation.usable_covariances
        near_by = None if pose is None else singular.proximity(pose, ids=lines.ids, covariances=known)
        away = None if distances is None else distances.distance
        slope = self._slope.add(ruling.inverse_condition_number, stamp)
        time_to_critical = self._indicators.time_to_critical(ruling.inverse_condition_number, slope, target_inverse)
        twist = self._prediction.recent_twist(stamp, parameters.twist_timeout)
        trend, approach = self._motion(distances, pose, twist)
        covariance = self._position.covariance if source == "camera_pose" else None
        risk = self._risk.latest(stamp, pose, covariance, observation, singular, self._T_world_target, parameters)
        if self._risk.other_law:
            note += f"; the twists are not those of {self._risk.other_law}: the law in force is not known"
        growth = None
        if risk is None:
            growth = self._prediction.growth(observation, pose, singular.lines, target_image, twist, stamp, parameters)
        calm, foreseen = "", (time_to_critical, approach)
        if parameters.rollout_rules and (risk is not None or self._risk.is_awaited):
            # Near a singularity is not yet in trouble: what comes of it is known, or will be in a moment.
            calm = "awaiting the roll-out" if risk is None else "passed calmly by the roll-out"
            foreseen = (None, None)
        elif parameters.rollout_rules and self._prediction.rules:
            # Near a singularity is not yet in trouble: here it is known what the law will do, or will be in a moment.
            calm = "awaiting the law's roll-out" if growth is None else "passed calmly by the law's roll-out"
            foreseen = (None, None)
        expected = (
            self._indicators.expected(growth, *foreseen)
            if risk is None or risk.lacks_path
            else self._indicators.predicted(risk, stamp, self._describe_motion_at_target)
        )
        is_rolled_out = risk is not None and covariance is not None and parameters.rollout_rules
        indicators = [*expected, verdict_indicator(observation, is_rolled_out)]
        nearest = None if distances is None else self._approaches.nearest(distances)
        of_loci = self._of_loci(away, near_by)
        kinds = (*self._indicators.kinds(target_inverse, *of_loci), len(indicators))
        near = False
        levels: list[Level] = []
        if (
            not self._alarm_state.is_calm(kinds)
            or not self._indicators.are_calm(ruling, target_inverse, nearest, of_loci[1])
            or below_alarm(indicators)
        ):
            measured = self._indicators.measured(ruling, target_inverse, *of_loci)
            near = below_alarm(measured)
            indicators = self._alarm_state.with_missing([*measured, *indicators])
            levels = self._alarm_state.levels(indicators, len(measured) if calm else 0, kinds)
        else:
            # Everything is as well as it was: no words are needed.
            indicators = []
        level = worst(levels, self._singular_everywhere)

        def explain() -> str:
            reason = reasons(
                indicators, levels, self._singular_everywhere, condition_text(ruling.inverse_condition_number)
            )
            reason = with_position(reason, nearest, source, parameters.pose_tolerance) + self._absolute_text(near_by)
            return (f"{reason}; near a singularity, {calm}" if calm and near and level is OK else reason) + note

        def describe_unobservable_motion() -> str:
            return (
                unobservable_motion_text(ruling.least_observable_direction, pose, singular, nearest)
                if near or level is not OK
                else ""
            )

        self._held = Assessment(
            level,
            explain,
            stamp,
            line_count=len(lines),
            conditioning=numbers,
            inverse_condition_number_rate=None if slope is None else slope[0],
            locus_distances=None if distances is None else distances.distance,
            nearest=nearest,
            trend=trend,
            approach=approach,
            time_to_critical=time_to_critical,
            position_source=source,
            describe_unobservable_motion=describe_unobservable_motion,
            target_inverse_condition_number=target_inverse,
            pose=pose,
            proximity=near_by,
            risk=risk,
            kind=worst_names(indicators, levels, level) + (" other law" if self._risk.other_law else ""),
        )
        return self._held

    @property
    def _singular_everywhere(self) -> str:
        """Why every camera is singular, or "": also where the motion that is lost is one that nobody asked for."""
        singular = self._singular_set
        all_used = len(self._parameters.columns) == 6
        return singular.description if singular.singular_everywhere and all_used else ""

    def _absolute_text(self, near: Proximity | None) -> str:
        """Return what is left of the precision of a pose in a scene that is singular everywhere, or ""."""
        return "" if near is None or not self._singular_everywhere else f"; {precision_text(near)}"

    def _ruling(self, numbers: Conditioning) -> Conditioning:
        """Return the conditioning that levels are judged by: that of the degrees of freedom in use."""
        columns = self._parameters.columns
        if len(columns) == 6:
            return numbers
        # The left singular vectors change nothing.
        used = np.zeros(6)
        used[list(columns)] = 1.0
        part = decompose(numbers.singular_values[:, np.newaxis] * numbers.right * used)
        values = part.singular_values[: len(columns)]
        return numbers._replace(
            singular_values=values, inverse_condition_number=smallest_over_largest(values.tolist()), right=part.right
        )

    def _of_loci(self, distance: Array | None, near: Proximity | None) -> tuple[Array | None, Proximity | None]:
        """Return what is judged of the loci, which are those of a camera that moves in all directions."""
        return (distance, near) if len(self._parameters.columns) == 6 else (None, None)

    def _describe_motion_at_target(self) -> str:
        if self._motion_at_target is None:
            target, pose = self._target, self._T_world_target
            text = "the least observable motion"
            if target is not None and target.lines is not None and pose is not None:
                weakest = self._ruling(interaction_conditioning(target.lines)).least_observable_direction
                singular = self._singular_set
                text = unobservable_motion_text(weakest, pose, singular, singular.nearest_locus(pose.translation))
            self._motion_at_target = text
        return self._motion_at_target

    def _without_unknown(self, observation: LineObservation) -> tuple[LineObservation, str]:
        """Return an observation without the lines that are not in the scene, and what to say about them."""
        known = self._singular_set.lines.ids
        if observation.ids == known:
            return observation, ""
        unknown = sorted(set(observation.ids).difference(known))
        if not unknown:
            return observation, ""
        kept = observation.select([row for row, i in enumerate(observation.ids) if i not in unknown])
        return kept, f"; {left_out_text(unknown)}"

    def _hold_or_refuse(self, reason: str, stamp: int, observation: LineObservation) -> Assessment:
        """Return what was said last while lines or the pose are missing for a few frames, else UNOBSERVABLE.

        CRITICAL once the camera has seen lines for long and no pose was found: the robot stands still.
        """
        self._missing += 1
        held, missing = self._held, self._missing
        blind = self._blind_for(observation, stamp)
        has_source = observation.lines_camera is not None or observation.verdict is not LinesVerdict.GIVEN
        if held is None or not has_source or missing >= self._parameters.dropout_cycles:
            refused = self.unusable(reason, stamp)
            if not 0.0 < self._parameters.no_pose_timeout <= blind:
                return refused
            words = f"not on its way to the target: lines are seen, but no pose for {blind:.1f} s; {reason}"
            return refused._replace(level=Level.CRITICAL, explain=lambda: words, kind=_NO_POSE)
        return held._replace(
            stamp=stamp, explain=lambda: f"{held.reason}; held for {missing} frame(s), in which {reason}"
        )

    def _blind_for(self, observation: LineObservation, stamp: int) -> float:
        """Return since when a camera that has a target sees lines without their 3-D lines [s]; 0: it does not."""
        if self._blind_since is None:
            if observation.lines_camera is not None or len(observation.usable_ids) < MINIMUM_LINES:
                return 0.0
            self._blind_since = stamp
        return 0.0 if self._target is None else (stamp - self._blind_since) / _SECOND

    def assess_pose(self, T_world_camera: Pose) -> Assessment:
        """Return what a camera that sees all lines of the scene would be told at a pose; nothing else is changed by it.

        Its level is without hysteresis, debounce and prediction; relative thresholds take part if a target is known.
        If it is, and so is the loop, its reason says what each law would do from there; its risk is the plain law's.
        """
        seen = LineObservation.of_lines(self._singular_set.lines.transformed(T_world_camera.inverse(), "camera"))
        try:
            lines = self._usable_lines(seen)
        except ObservationError as error:
            why = str(error)
            return Assessment(Level.UNOBSERVABLE, lambda: why, 0)
        numbers = interaction_conditioning(lines, self._parameters.characteristic_length)
        ruling = self._ruling(numbers)
        target_inverse = None if self._target is None else self._target.at(lines.ids).inverse_condition_number
        distances = self._singular_set.distance_arrays(T_world_camera.translation)
        nearest = self._approaches.nearest(distances)
        near_by = self._singular_set.proximity(T_world_camera, ids=lines.ids)
        indicators = self._indicators.measured(ruling, target_inverse, *self._of_loci(distances.distance, near_by))
        levels = [each.thresholds.entered(each.value) for each in indicators]
        level = worst(levels, self._singular_everywhere)
        reason = reasons(indicators, levels, self._singular_everywhere, condition_text(ruling.inverse_condition_number))
        reason = with_position(reason, nearest, "pose asked for", self._parameters.pose_tolerance)
        reason += self._absolute_text(near_by)
        risks: dict[str, Risk] = {}
        if self._T_world_target is not None and self._parameters.controller == "law":
            singular, ends = self._singular_set, self._risk.seen_ends
            risks = risks_of_laws(T_world_camera, singular, self._T_world_target, self._parameters, ends)
            reason = f"{reason}; rolled out to the target, {laws_text(risks)}"
        lost = (
            ""
            if level is OK
            else unobservable_motion_text(
                ruling.least_observable_direction, T_world_camera, self._singular_set, nearest
            )
        )
        return Assessment(
            level,
            lambda: reason,
            0,
            line_count=len(lines),
            conditioning=numbers,
            locus_distances=distances.distance,
            nearest=nearest,
            position_source="camera_pose",
            describe_unobservable_motion=lambda: lost,
            target_inverse_condition_number=target_inverse,
            proximity=near_by,
            risk=risks.get("pinv"),
        )

    def silence(self, now: int) -> Assessment | None:
        """Return what to say when no features come (now in ns): STALE, DISABLED, or None if they are recent enough."""
        if not self.enabled:
            return self._disabled(now)
        self._follow_clock(now)
        reason = self._stamp_filter.silence(now)
        if reason is None:
            return None
        self._blind_since = None
        return self._unknown(self._silence_level(), reason, now)

    def _silence_level(self) -> Level:
        """Return the level of a silence: that of the messages which come and are refused, if any do."""
        return self._refused_as if self._stamp_filter.last_problem is not None else Level.STALE

    def unusable(self, reason: str, stamp: int) -> Assessment:
        """Return the UNOBSERVABLE assessment of features that cannot be used."""
        if not self.enabled:
            return self._disabled(stamp)
        self._stamp_filter.note_problem(reason)
        self._refused_as = Level.UNOBSERVABLE
        return self._unknown(Level.UNOBSERVABLE, reason, stamp)

    def _disabled(self, stamp: int) -> Assessment:
        return self._unknown(Level.DISABLED, _DISABLED, stamp)

    def _unknown(self, level: Level, reason: str, stamp: int) -> Assessment:
        self._forget()
        kind = re.sub(r"[0-9.e+-]+", "", self._stamp_filter.last_problem or reason)
        return Assessment(level, lambda: reason, stamp, kind=kind)

    def _forget(self) -> None:
        """Begin anew: what was before says nothing about what comes next."""
        self._held = None
        self._alarm_state.forget()
        self._slope = Slope(self._parameters.rate_window)
        self._prediction.interrupt()

    def _follow_clock(self, now: int) -> None:
        """Drop everything stamped by a clock that has since jumped back."""
        if self._stamp_filter.follow_clock(now):
            self._position.forget()
            self._blind_since = None
            self._prediction.restart()
            self._risk.restart()
            self._forget()

    def _usable_lines(self, observation: LineObservation) -> LineSet:
        if observation.lines_camera is None and observation.usable_ids:
            why = observation.verdict_reason or "directions and moments are empty"
            raise ObservationError(f"features have no 3-D lines ({why})")
        if observation.lines_camera is None or len(observation.lines_camera) < MINIMUM_LINES:
            raise ObservationError(
                f"{len(observation.usable_ids)} of {len(observation.ids)} lines are usable "
                f"({list(observation.usable_ids)}); at least {MINIMUM_LINES} are needed"
            )
        return observation.lines_camera

    def _motion(
        self, distances: DistanceArrays | None, pose: Pose | None, twist: Array | None
    ) -> tuple[Trend, Approach | None]:
        if twist is None or pose is None or distances is None:
            return Trend.UNKNOWN, None
        horizon = max(self._parameters.horizon, _LOOK_AHEAD)
        return self._approaches.ahead(distances, pose, twist, horizon)


def _target_pose(parameters: MonitorParameters) -> Pose | None:
    return parameters.target_pose() if parameters.target_known else None


def _target(parameters: MonitorParameters) -> tuple[object, ...]:
    return parameters.target_known, parameters.target_position, parameters.target_orientation, parameters.columns


def _monitored_target(parameters: MonitorParameters) -> MonitoredTarget | None:
    if not parameters.target_known:
        return None
    seen = parameters.lines().transformed(parameters.target_pose().inverse(), "camera at the target")
    return MonitoredTarget(LineObservation.of_lines(seen), "target pose", parameters.columns)
