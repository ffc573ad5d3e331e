# SPDX-License-Identifier: Apache-2.0
"""The monitor's cycle without ROS: an observation in, an assessment out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Any

import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError, PlsingError
from plsing_ros.features import LineObservation, checked_observation, interaction_conditioning
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.line_alignment import pose_by_lines
from plsing_ros.geometry.pose import checked_twist
from plsing_ros.levels import Level
from plsing_ros.monitoring.alarm_state import AlarmState, worst, worst_names
from plsing_ros.monitoring.approach import Approach, Trend
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.availability import Availability
from plsing_ros.monitoring.camera_position import CameraPosition, locate
from plsing_ros.monitoring.closed_loop_rollout import Expected
from plsing_ros.monitoring.explanation import Explanation
from plsing_ros.monitoring.hysteresis import Debounce
from plsing_ros.monitoring.indicators import Indicator, Indicators, below_alarm, verdict_indicator
from plsing_ros.monitoring.measurement import Measurement
from plsing_ros.monitoring.monitored_scene import MonitoredScene, usable_lines
from plsing_ros.monitoring.monitored_target import NOT_KNOWN, MonitoredTarget
from plsing_ros.monitoring.pose_check import assess_pose
from plsing_ros.monitoring.prediction import Prediction
from plsing_ros.monitoring.risk import Risk
from plsing_ros.monitoring.risk_predictor import RiskPredictor
from plsing_ros.monitoring.slope import Slope
from plsing_ros.monitoring.unobservable_motion_text import unobservable_motion_text
from plsing_ros.parameters import MonitorParameters
from plsing_ros.parameters.options import parameters_from_options, pose_options
from plsing_ros.pose.line_lifting import lift_lines_at
from plsing_ros.singularities import DistanceArrays, SingularSet, singular_set
from plsing_ros.stamp_filter import stamp_from_seconds

# How far ahead the closest approach is looked for, at least [s].
_LOOK_AHEAD = 10.0


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
        self._position = CameraPosition()
        self._prediction = Prediction()
        self._risk = RiskPredictor(executor)
        self._T_world_target: Pose | None = None
        self._motion_at_target: str | None = None
        self._alarm_state = AlarmState(Debounce(parameters.raise_cycles, parameters.lower_cycles))
        self._parameters = parameters
        self._availability = Availability(parameters, self._forget)
        self._use_scene(singular_set(parameters.lines()), parameters)
        self._set_target(_monitored_target(parameters), _target_pose(parameters))
        self._use(parameters)

    @property
    def singular_set(self) -> SingularSet:
        """The singular set of the scene."""
        return self._scene.singular

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
        singular = singular_set(parameters.lines()) if new_scene else self.singular_set
        target = _monitored_target(parameters) if new_target else None

        def put_in_force() -> None:
            if new_target:
                self._set_target(target, _target_pose(parameters))
            if new_scene:
                self._use_scene(singular, parameters)
            self._use(parameters)

        return put_in_force

    def _use_scene(self, singular: SingularSet, parameters: MonitorParameters) -> None:
        self._scene = MonitoredScene(singular, parameters)
        self._risk.restart()
        self._availability.forget()

    def _use(self, parameters: MonitorParameters) -> None:
        self._availability.use(parameters)
        self._scene.use(parameters)
        self._alarm_state.debounce = Debounce(parameters.raise_cycles, parameters.lower_cycles)
        self._indicators = Indicators(self._scene.singular, parameters)
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
                pose = pose_by_lines(self._scene.singular.lines, target.lines)
            except ObservationError as error:
                raise ObservationError(f"desired features: {error}") from None
        self._set_target(target, pose)

    def _set_target(self, target: MonitoredTarget | None, T_world_target: Pose | None) -> None:
        self._target, self._T_world_target = target, T_world_target
        self._motion_at_target = None
        self._availability.end_blindness()
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
                observation = lift_lines_at(self._scene.singular.lines, pose, observation)
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
            return self._availability.disabled(stamp)
        if self._availability.jumps_back(now):
            self._restart()
        if self._availability.refusal(stamp, now) is not None:
            # One bad message among good ones changes nothing; a stream of them is as good as silence.
            return self._availability.silence(now)
        parameters, scene = self._parameters, self._scene
        observation, note = scene.without_unknown(observation)
        try:
            lines = usable_lines(observation)
        except ObservationError as error:
            return self._availability.hold_or_refuse(str(error) + note, stamp, observation, self._target is not None)
        told = self._position.received(stamp, parameters.pose_tolerance)
        problem = scene.check.contradiction(observation, told)
        if problem is not None:
            return self.unusable(problem, stamp)
        try:
            pose, source = locate(scene.singular.lines, lines, told)
        except ObservationError as error:
            return self.unusable(str(error), stamp)
        target_inverse, target_image = NOT_KNOWN if self._target is None else self._target.at(lines.ids)
        found = scene.measure(lines, pose, target_inverse, observation.usable_covariances)
        inverse = found.ruling.inverse_condition_number
        slope = self._slope.add(inverse, stamp)
        time_to_critical = self._indicators.time_to_critical(inverse, slope, target_inverse)
        twist = self._prediction.recent_twist(stamp, parameters.twist_timeout)
        trend, approach = self._motion(found.distances, pose, twist)
        covariance = self._position.covariance if source == "camera_pose" else None
        risk = self._risk.latest(stamp, pose, covariance, observation, scene.singular, self._T_world_target, parameters)
        other_law = self._risk.other_law
        if other_law:
            note += f"; the twists are not those of {other_law}: the law in force is not known"
        growth = None
        if risk is None:
            growth = self._prediction.growth(
                observation, pose, scene.singular.lines, target_image, twist, stamp, parameters
            )
        calm = self._calm_by_rollout(risk, growth)
        foreseen = (None, None) if calm else (time_to_critical, approach)
        expected = (
            self._indicators.expected(growth, *foreseen)
            if risk is None or risk.lacks_path
            else self._indicators.predicted(risk, stamp, self._describe_motion_at_target)
        )
        is_rolled_out = risk is not None and covariance is not None and parameters.rollout_rules
        is_rolled_out = is_rolled_out and not self._risk.may_stray(observation, parameters)
        expected.append(verdict_indicator(observation, is_rolled_out))
        indicators, levels, is_near = self._judged(found, expected, calm)
        level = worst(levels, scene.singular_everywhere)
        explanation = Explanation(
            scene, found, indicators, levels, level, is_near, calm, source, parameters.pose_tolerance, pose, note
        )
        return self._availability.hold(
            Assessment(
                level,
                explanation.reason,
                stamp,
                line_count=len(lines.ids),
                conditioning=found.conditioning,
                inverse_condition_number_rate=None if slope is None else slope[0],
                locus_distances=None if found.distances is None else found.distances.distance,
                nearest=found.nearest,
                trend=trend,
                approach=approach,
                time_to_critical=time_to_critical,
                position_source=source,
                describe_unobservable_motion=explanation.unobservable_motion,
                target_inverse_condition_number=target_inverse,
                pose=pose,
                proximity=found.proximity,
                risk=risk,
                kind=worst_names(indicators, levels, level) + (" other law" if other_law else ""),
            )
        )

    def _calm_by_rollout(self, risk: Risk | None, growth: Expected | None) -> str:
        """Return why being near a singularity is not yet in trouble, or "" where it is.

        It is not where it is known what will come of it, or will be in a moment.
        """
        if not self._parameters.rollout_rules:
            return ""
        if risk is not None or self._risk.is_awaited:
            return "awaiting the roll-out" if risk is None else "passed calmly by the roll-out"
        if self._prediction.rules:
            return "awaiting the law's roll-out" if growth is None else "passed calmly by the law's roll-out"
        return ""

    def _judged(
        self, present: Measurement, expected: list[Indicator], calm: str
    ) -> tuple[list[Indicator], list[Level], bool]:
        """Return all numbers with their levels, and whether one of the present is below its first threshold.

        No numbers where everything is as well as it was: no words are needed then.
        """
        values = self._indicators.values(present)
        names = [*values, *[each.name for each in expected]]
        if self._alarm_state.is_calm(names) and self._indicators.are_calm(values) and not below_alarm(expected):
            return [], [], False
        measured = self._indicators.measured(present, values)
        indicators = self._alarm_state.with_missing([*measured, *expected])
        levels = self._alarm_state.levels(indicators, len(measured) if calm else 0)
        return indicators, levels, below_alarm(measured)

    def _describe_motion_at_target(self) -> str:
        if self._motion_at_target is None:
            target, pose = self._target, self._T_world_target
            text = "the least observable motion"
            if target is not None and target.lines is not None and pose is not None:
                scene = self._scene
                weakest = scene.ruling(interaction_conditioning(target.lines)).least_observable_direction
                nearest = scene.singular.nearest_locus(pose.translation)
                text = unobservable_motion_text(weakest, pose, scene.singular, nearest)
            self._motion_at_target = text
        return self._motion_at_target

    def assess_pose(self, T_world_camera: Pose) -> Assessment:
        """Return what a camera that sees all lines of the scene would be told at a pose; nothing else is changed by it.

        Its level is without hysteresis, debounce and prediction; relative thresholds take part if a target is known.
        If it is, and so is the loop, its reason says what each law would do from there; its risk is the plain law's.
        """
        return assess_pose(
            T_world_camera,
            self._scene,
            self._indicators,
            self._target,
            self._T_world_target,
            self._parameters,
            self._risk.seen_ends,
        )

    def silence(self, now: int) -> Assessment | None:
        """Return what to say when no features come (now in ns): STALE, DISABLED, or None if they are recent enough."""
        if not self.enabled:
            return self._availability.disabled(now)
        if self._availability.jumps_back(now):
            self._restart()
        assessment = self._availability.silence(now)
        if assessment is not None:
            self._availability.end_blindness()
        return assessment

    def unusable(self, reason: str, stamp: int) -> Assessment:
        """Return the UNOBSERVABLE assessment of features that cannot be used."""
        if not self.enabled:
            return self._availability.disabled(stamp)
        return self._availability.unusable(reason, stamp)

    def _forget(self) -> None:
        """Begin anew: what was before says nothing about what comes next."""
        self._alarm_state.forget()
        self._slope = Slope(self._parameters.rate_window)
        self._prediction.interrupt()

    def _restart(self) -> None:
        """Drop everything stamped by a clock that has since jumped back."""
        self._position.forget()
        self._prediction.restart()
        self._risk.restart()

    def _motion(
        self, distances: DistanceArrays | None, pose: Pose | None, twist: Array | None
    ) -> tuple[Trend, Approach | None]:
        if twist is None or pose is None or distances is None:
            return Trend.UNKNOWN, None
        horizon = max(self._parameters.horizon, _LOOK_AHEAD)
        return self._scene.approaches.ahead(distances, pose, twist, horizon)


def _target_pose(parameters: MonitorParameters) -> Pose | None:
    return parameters.target_pose() if parameters.target_known else None


def _target(parameters: MonitorParameters) -> tuple[object, ...]:
    return parameters.target_known, parameters.target_position, parameters.target_orientation, parameters.columns


def _monitored_target(parameters: MonitorParameters) -> MonitoredTarget | None:
    if not parameters.target_known:
        return None
    seen = parameters.lines().transformed(parameters.target_pose().inverse(), "camera at the target")
    return MonitoredTarget(LineObservation.of_lines(seen), "target pose", parameters.columns)
