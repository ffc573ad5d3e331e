# SPDX-License-Identifier: Apache-2.0
"""The controller's cycle without ROS: an observation in, a command out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.command import Command, Mode
from plsing_ros.control.gate import StatusGate
from plsing_ros.control.gate_exit import leave
from plsing_ros.control.latency import FeatureAge
from plsing_ros.control.pose_laws import PoseErrors
from plsing_ros.control.servo_cycle import ServoCycle, known_pose
from plsing_ros.control.target_pose import target_pose, target_problems, target_seen_from, task_of
from plsing_ros.control.usable_lines import common_lines, pose_errors, usable_covariances
from plsing_ros.errors import ObservationError, PlsingError
from plsing_ros.features import LineObservation, LinesVerdict, checked_observation
from plsing_ros.features.consistency import ConsistencyCheck, left_out_text
from plsing_ros.features.target import MINIMUM_LINES, Target
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.levels import Level
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.law import POSE_LAWS
from plsing_ros.parameters.options import parameters_from_options, pose_options
from plsing_ros.planning.detour import Plan
from plsing_ros.planning.path_tracker import detour_options
from plsing_ros.planning.planner import Answer, Planner, PlanNow
from plsing_ros.planning.target_check import check_target
from plsing_ros.pose.line_lifting import LineLifter
from plsing_ros.pose.received_poses import ReceivedPoses
from plsing_ros.singularities.scene_loci import SceneLoci
from plsing_ros.stamp_filter import StampFilter, stamp_from_seconds

__all__ = ["MINIMUM_LINES", "Command", "Mode", "ServoController"]

# A variance that is not known any more: beyond every speed, and finite.
_ANY = 1e100
_DISABLED = "switched off: by ~/enable, or by the parameter enabled at the start"


class ServoController:
    """Turns observations into commands; commands zero and says why whenever it cannot trust its input.

    Args:
        lines: The scene, in the world frame; needed for a target pose.
        target: T_world_camera of the target, or what the camera sees there; None: set_target says it later.
        options: Every parameter of the controller by its name (docs/reference), nested where it has dots:
            law="guarded", gain=0.5, detour={"margin": 0.2}.

    Raises:
        ParameterError: If an option is unknown or not allowed.
        ObservationError: If the target shows fewer than three usable lines.

    Attributes:
        gate: Takes the monitor's statuses; asked where the parameter gate says so.
        warning: What is doubtful about target and parameters, in words, or "".
    """

    def __init__(
        self, lines: LineSet | None = None, target: Pose | LineObservation | None = None, **options: Any
    ) -> None:
        given = dict(options)
        if isinstance(target, Pose):
            given["target"] = pose_options(target) | given.get("target", {})
        else:
            given["target"] = {"source": "topic", **given.get("target", {})}
        self._start(parameters_from_options(ControllerParameters, given, lines))
        if isinstance(target, LineObservation):
            self.set_target(target)

    @classmethod
    def from_parameters(cls, parameters: ControllerParameters, planner: Planner | None = None) -> ServoController:
        """Return a controller with the parameters of a node, whose paths are planned by a planner or else at once."""
        controller = cls.__new__(cls)
        controller._start(parameters, planner)
        return controller

    def _start(self, parameters: ControllerParameters, planner: Planner | None = None) -> None:
        self._planner = planner or PlanNow()
        self.warning = ""
        self._checked: LineObservation | None = None
        self._enabled = parameters.enabled
        self._target: Target | None = None
        self._cycle: ServoCycle | None = None
        self._refused = ""
        self._loci: SceneLoci | None = None
        self._check = ConsistencyCheck(None)
        self._seen: LineSet | None = None
        self._poses = ReceivedPoses()
        self._errors: PoseErrors | None = None
        self._age = FeatureAge()
        self._lifter = LineLifter(None)
        self._stamp_filter = StampFilter(
            "features", parameters.features_timeout, parameters.future_tolerance, "features_timeout"
        )
        self.gate = StatusGate(Level[parameters.gate_level], parameters.gate_timeout, parameters.future_tolerance)
        self._parameters: ControllerParameters | None = None
        self.parameters = parameters

    @property
    def parameters(self) -> ControllerParameters:
        """The parameters in force; setting them takes effect at the next step."""
        assert self._parameters is not None
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: ControllerParameters) -> None:
        self.prepare(parameters)()

    def prepare(self, parameters: ControllerParameters) -> Callable[[], None]:
        """Return what puts changed parameters in force; a PlsingError if they are refused, with nothing changed."""
        before = self._parameters
        target, loci = self._target, self._loci
        new_task = before is None or task_of(parameters) != task_of(before)
        if new_task:
            if parameters.target_source == "pose":
                target = target_seen_from(parameters)
            loci = SceneLoci(parameters.lines()) if parameters.lines_points else None
        check = self._check
        if loci is not self._loci or parameters.tolerances != check.tolerances:
            check = ConsistencyCheck(None if loci is None else loci.lines, parameters.tolerances)
        replan = before is not None and detour_options(parameters) != detour_options(before)

        def put_in_force() -> None:
            self._stamp_filter.timeout = parameters.features_timeout
            self._stamp_filter.future_tolerance = parameters.future_tolerance
            self.gate.worst = Level[parameters.gate_level]
            self.gate.set_times(parameters.gate_timeout, parameters.future_tolerance)
            self._parameters, self._check = parameters, check
            if new_task:
                self._lifter = LineLifter(None if loci is None else loci.lines)
            if target is not self._target or loci is not self._loci or replan:
                self._target, self._loci = target, loci
                self._restart()
            elif self._cycle is not None:
                self._cycle.parameters = parameters
            self._check_target()

        return put_in_force

    @property
    def enabled(self) -> bool:
        """When False, every answer is DISABLED; a run begins anew when it becomes True."""
        return self._enabled

    @enabled.setter
    def enabled(self, enabled: bool) -> None:
        if enabled and not self._enabled:
            self._restart()
        self._enabled = enabled

    @property
    def plan(self) -> Plan | None:
        """The path that is followed, or was refused; None without one."""
        return None if self._cycle is None else self._cycle.plan

    @property
    def law(self) -> str:
        """The law in force: the parameter's, but `fused` where detour goes straight by the pose."""
        return self.parameters.law if self._cycle is None else self._cycle.law

    @property
    def unchecked(self) -> str:
        """What could not be checked about the latest features, in words, or ""."""
        return "" if self._checked is None else self._check.unchecked(self._checked)

    @property
    def target(self) -> Target | None:
        """Where it leads, or None if not known yet."""
        return self._target

    def set_target(self, target: LineObservation) -> None:
        """Use these image lines as s* from now on.

        Raises:
            ObservationError: If fewer than three of them are usable, or they contradict themselves or the scene.
        """
        problem = self._check.contradiction(target)
        if problem is not None:
            raise ObservationError(problem)
        self._target = Target(target, "desired features")
        if self._cycle is None:
            self._restart()
        else:
            self._cycle.retarget(self._target, target_pose(self._target, self._loci, self.parameters))
        self._check_target()

    def compute_loci(self) -> None:
        """Compute the scene's singular set now, and not when a cycle needs it."""
        if self._loci is not None:
            _ = self._loci.singular_set

    def check_target(self, target: Pose, start: Pose | None) -> Answer:
        """Ask what detour would do about a target: the answer, a TargetCheck, takes the planner as long as a plan.

        Args:
            target: T_world_camera there.
            start: T_world_camera where the path begins; None for where the camera is now.

        Raises:
            ObservationError: If the scene, or where the camera is, is not known.
        """
        if self._loci is None:
            raise ObservationError("no scene is given, so the loci are not known")
        if start is None and self._seen is not None:
            start = self._loci.camera_pose(self._seen)
        if start is None:
            raise ObservationError(
                "where the camera is now is not known: no usable features yet, or they do not fit the scene"
            )
        options = detour_options(self.parameters)
        known = known_pose(self.parameters, self._errors)
        return self._planner.ask(check_target, self._loci.singular_set, start, target, options, known)

    def step(self, observation: LineObservation, time: float, pose: Pose | None = None) -> Command:
        """Return the command for an observation that is made now; whatever is wrong with it is the command's reason.

        Args:
            observation: What the camera sees. Image lines alone are lifted to 3-D lines: by the pose, else by the pose
                that they show themselves.
            time: Of the observation [s], from any origin.
            pose: T_world_camera at that time, if it is known: 3-D lines that contradict it halt.
        """
        try:
            stamp = stamp_from_seconds(time)
            if pose is not None:
                self.receive_pose(pose, stamp)
            return self.answer(self._lifter.lift(checked_observation(observation), pose), stamp, stamp)
        except PlsingError as error:
            return self.halt(str(error))

    def answer(self, observation: LineObservation, stamp: int, now: int) -> Command:
        """Return the command for an observation with the stamp of its message.

        Lines are matched by id; those without a target, unknown to the scene or out of sight are left out. Features
        that contradict themselves or the scene halt.

        Args:
            observation: What the camera sees, with 3-D lines.
            stamp: Of the observation [ns].
            now: Of the node clock [ns].

        Raises:
            ObservationError: If the observation cannot be used; call halt with the reason.
        """
        parameters = self.parameters
        reaction = _reaction(observation.verdict, parameters)
        command = self._not_to_move(observation, reaction, stamp, now)
        cycle = self._cycle
        if command is not None or cycle is None:
            self._pause()
            return command or Command(Mode.WAITING, "no target: no desired features received yet")
        told = self._poses.at(stamp, 0.0)
        self._checked = observation
        problem = self._check.contradiction(observation, None if told is None else told.T_world_camera)
        if problem is not None:
            return self.halt(problem)
        closed = None if parameters.gate == "none" else self.gate.closed(now, needs_risk=parameters.gate == "risk")
        if closed is not None and not self.gate.may_be_left(now):
            self._pause()
            return Command(Mode.HALTED, closed)
        lines, image = common_lines(observation, cycle.target)
        self._seen = lines
        trust = parameters.slow_scale if reaction == "slow" else 1.0
        scene = self._loci.lines if self._loci is not None and parameters.law in POSE_LAWS else None
        self._errors = pose_errors(observation, lines, scene, told, self._poses.latest)
        command = cycle.command(lines, image, trust, stamp, usable_covariances(observation, lines.ids), self._errors)
        if closed is not None:
            self._pause()
            command = leave(command, lines, closed)
        if cycle.note:
            command = _with_note(command, cycle.note)
        unknown = self._check.unknown_ids(observation)
        if unknown:
            command = _with_note(command, left_out_text(unknown))
        hint = self._age.hint(stamp, now, parameters.gain, parameters.latency)
        return _with_note(command, hint) if hint else command

    def twist_covariance(self) -> Array:
        """Return the covariance of the latest twist of the camera, shape (6, 6); zeros where nothing is commanded.

        By the errors of the image lines and of the pose in that frame. It is computed when asked for.
        """
        if self._cycle is None:
            return np.zeros((6, 6))
        with np.errstate(all="ignore"):
            covariance = self._cycle.twist_covariance()
        return np.clip(np.nan_to_num(covariance, nan=_ANY), -_ANY, _ANY)

    def receive_pose(self, T_world_camera: Pose, stamp: int, covariance: Array | None = None) -> None:
        """Take the camera's pose at a stamp [ns]: features of that stamp must agree with it.

        Args:
            T_world_camera: Where it is.
            stamp: [ns].
            covariance: In the scene's axes, (position [m], rotation [rad]), shape (6, 6); None: not known.
        """
        self._poses.receive(T_world_camera, stamp, covariance)

    def forget_poses(self) -> None:
        """Trust no pose received so far: the latest one was refused."""
        self._poses.forget()

    def is_stray(self, stamp: int, now: int) -> bool:
        """Return whether a message is late, out of order or from the future among good ones: it changes nothing.

        Args:
            stamp: Of the message [ns].
            now: Of the node clock [ns].
        """
        return self._stamp_filter.is_stray(stamp, now)

    def _not_to_move(self, observation: LineObservation, reaction: str, stamp: int, now: int) -> Command | None:
        if not self._enabled:
            return Command(Mode.DISABLED, _DISABLED)
        problem = self._stamp_filter.refusal(stamp, now)
        if problem is None and self._refused:
            return Command(Mode.REFUSED, self._refused)
        if problem is None and reaction == "halt":
            problem = f"3-D lines are {observation.verdict.name}: {observation.verdict_reason}"
        return None if problem is None else Command(Mode.HALTED, problem)

    def halt(self, reason: str) -> Command:
        """Return a command of zero twist with the reason, for features that cannot be used or for a shutdown."""
        self._stamp_filter.note_problem(reason)
        self._pause()
        return Command(Mode.HALTED if self._enabled else Mode.DISABLED, reason)

    def silence(self, now: int) -> Command | None:
        """Return the command for input that has stopped, or None while it is recent enough (now in ns)."""
        if not self._enabled:
            return Command(Mode.DISABLED, _DISABLED)
        reason = self._stamp_filter.silence(now)
        if reason is None:
            return None
        self._pause()
        # Refused features are no silence: as waiting it would be told anew after each of them.
        waits = self._stamp_filter.last_stamp is None and self._stamp_filter.last_problem is None
        return Command(Mode.WAITING if waits else Mode.HALTED, reason)

    def _pause(self) -> None:
        if self._cycle is not None:
            self._cycle.pause()

    def _restart(self) -> None:
        """Begin a run anew: integral, stall and path are those of the one before."""
        self._cycle = None
        if self._target is not None:
            pose = target_pose(self._target, self._loci, self.parameters)
            self._cycle = ServoCycle(self.parameters, self._target, self._loci, pose, self._planner)

    def _check_target(self) -> None:
        """Find out whether the target is refused, or doubtful."""
        self._refused, self.warning = "", ""
        if self._target is not None:
            self._refused, self.warning = target_problems(self._target, self._loci, self.parameters)


def _reaction(verdict: LinesVerdict, parameters: ControllerParameters) -> str:
    """Return what the parameters say about lines of a verdict: halt, slow or ignore."""
    # Comparing numbers of an enumeration takes several times as long.
    if verdict is LinesVerdict.GIVEN or verdict is LinesVerdict.OK:
        return "ignore"
    return parameters.poor_lines if verdict is LinesVerdict.POOR else parameters.ambiguous_lines


def _with_note(command: Command, note: str) -> Command:
    return command._replace(reason=f"{command.reason}; {note}" if command.reason else note)
