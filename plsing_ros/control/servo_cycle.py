# SPDX-License-Identifier: Apache-2.0
"""One cycle of the control law for one target: guard, speed limits and stall included."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.command import Command, Mode
from plsing_ros.control.compute_twist import LawTwist, compute_twist, law_interaction
from plsing_ros.control.gain import law_gain
from plsing_ros.control.guard import guarded_scale
from plsing_ros.control.integral import ErrorIntegral
from plsing_ros.control.latency import LookAhead
from plsing_ros.control.plain_law import compute_plain_twist
from plsing_ros.control.pose_laws import PoseErrors, PoseLaws
from plsing_ros.control.saturation import saturate
from plsing_ros.control.stall import StallWatch
from plsing_ros.control.tool import tool_twist
from plsing_ros.control.twist_covariance import image_twist_covariance
from plsing_ros.errors import ObservationError
from plsing_ros.features import (
    feature_error,
    interaction_conditioning,
    interaction_matrix,
    project_lines,
    smallest_over_largest,
)
from plsing_ros.features.certain_lines import CertainLines
from plsing_ros.features.target import MINIMUM_LINES, Target, TargetView
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.law import POSE_LAWS, STRAIGHT_LAWS
from plsing_ros.planning.detour import Plan
from plsing_ros.planning.path_follower import Reference
from plsing_ros.planning.path_tracker import PathTracker
from plsing_ros.planning.planner import Planner
from plsing_ros.planning.straight_way import KnownPose
from plsing_ros.singularities.scene_loci import SceneLoci

# Why the camera stands still while a path is being planned.
PLANNING = "a path is being planned"
_SECOND = 1_000_000_000
# Of frames, for what the loop averages [s].
_LONGEST_PERIOD = 0.2
_LEAST_AVERAGED = 1e-4


class ServoCycle:
    """The law in force, with what it remembers from cycle to cycle.

    Attributes:
        note: What is to be said about the lines of the latest cycle, or "".
    """

    def __init__(
        self,
        parameters: ControllerParameters,
        target: Target,
        loci: SceneLoci | None,
        T_world_target: Pose | None,
        planner: Planner | None = None,
    ) -> None:
        """Begin a run.

        Args:
            parameters: May be replaced while running.
            target: Where to go.
            loci: Of the scene, or None if it is not known.
            T_world_target: Camera pose at the target, or None if it is not known.
            planner: Who plans paths.
        """
        self.parameters = parameters
        self._planner = planner
        self._loci = loci
        self._integral = ErrorIntegral()
        self._stall = StallWatch()
        self._look_ahead = LookAhead()
        self._certain = CertainLines()
        self.note = ""
        self._path: PathTracker | None = None
        self.retarget(target, T_world_target)
        # Of the latest cycle: what was left of the law's speed, and its stamp [ns].
        self._factor = 0.0
        self._stamp = 0
        # What the covariance of its twist is made from when it is asked for, and the share of it that was commanded.
        self._spread: Callable[[], Array] | None = None
        self._errors: tuple[Array | None, PoseErrors | None] = (None, None)
        self._speed = 0.0

    def retarget(self, target: Target, T_world_target: Pose | None) -> None:
        """Go on with another target; the integral stays, so that a target that moves can be followed."""
        self.target = target
        self._pose_laws: PoseLaws | None = None
        if self._loci is None or T_world_target is None or target.lines is None:
            self._path = None
        elif self._path is None or not self._path.leads_to(T_world_target):
            self._path = PathTracker(self._loci, T_world_target, target.lines, self._planner)

    @property
    def plan(self) -> Plan | None:
        """The path that is followed, or was refused; None without one."""
        return None if self._path is None else self._path.plan

    @property
    def law(self) -> str:
        """The law in force: detour goes straight by the pose as fused does."""
        by_pose = self.parameters.law == "detour" and self._path is not None and self._path.goes_by_pose
        return "fused" if by_pose else self.parameters.law

    def twist_covariance(self) -> Array:
        """Return the covariance of the latest twist by the errors of its frame, shape (6, 6); zeros at rest."""
        return np.zeros((6, 6)) if self._spread is None else self._speed**2 * self._spread()

    def pause(self) -> None:
        """Take note that the camera was told to stand still in this cycle."""
        self._spread = None
        self._factor = 0.0
        self._stall.clear()
        self._look_ahead.clear()
        if self._pose_laws is not None:
            self._pose_laws.pause()

    def command(
        self,
        lines: LineSet,
        image: Array,
        trust: float,
        stamp: int,
        covariances: Array | None = None,
        pose: PoseErrors | None = None,
    ) -> Command:
        """Return the command for lines that are in the target.

        Args:
            lines: In the camera's optical frame, three or more.
            image: Their image lines, shape (3n,).
            trust: Share of the speed that the trust in the lines allows, in [0, 1].
            stamp: Of the observation [ns].
            covariances: Of angle and offset of each image line, shape (n, 3), if they are known.
            pose: Errors of the pose that the 3-D lines stand for, if they are known.

        Raises:
            ObservationError: If the law needs something that the observation or the target lacks.
        """
        parameters = self.parameters
        self._errors, self.note = (covariances, pose), ""
        if parameters.latency > 0.0:
            lines, image = self._look_ahead.ahead(lines, image, stamp, parameters.latency)
        if parameters.law not in POSE_LAWS:
            lines, image = self._without_uncertain(lines, image)
        if parameters.is_plain:
            view = self.target.view(lines.ids, parameters.columns)
            plain = compute_plain_twist(parameters, lines, image, view.image)
            if plain is not None:
                self._spread = partial(_image_spread, parameters, lines, image, view, self._errors)
                return self._within_limits(lines, *plain, None, trust, stamp)
        with _may_overflow():
            if parameters.law == "detour":
                return self._along_the_path(lines, image, covariances, pose, trust, stamp)
            if parameters.law in STRAIGHT_LAWS:
                return self._by_pose(lines, image, covariances, pose, trust, stamp)
            return self._servo(lines, image, None, None, trust, stamp)

    def _along_the_path(
        self,
        lines: LineSet,
        image: Array,
        covariances: Array | None,
        pose: PoseErrors | None,
        trust: float,
        stamp: int,
    ) -> Command:
        if self._path is None:
            raise ObservationError("the law detour needs the scene and a target with 3-D lines that fit it")
        known = known_pose(self.parameters, pose)
        found = self._path.reference(self.parameters, lines, image, stamp, self._factor, known)
        if self._path.goes_by_pose:
            return self._by_pose(lines, image, covariances, pose, trust, stamp)
        if found is None:
            self._factor, self._spread = 0.0, None
            if self._path.is_planning:
                return Command(Mode.HALTED, PLANNING)
            return Command(Mode.REFUSED, "" if self.plan is None else self.plan.reason)
        reference, here = found
        rows = [row for row, i in enumerate(lines.ids) if i in reference.target]
        if len(rows) < MINIMUM_LINES:
            raise ObservationError(f"only {len(rows)} line(s) have an image both here and on the path")
        there = image.reshape(-1, 3)[rows].ravel()
        self._errors = (None if covariances is None else covariances[rows]), pose
        lines, image = self._without_uncertain(lines.select(rows), there)
        return self._servo(lines, image, reference, reference.displacement(here), trust, stamp)

    def _by_pose(
        self,
        lines: LineSet,
        image: Array,
        covariances: Array | None,
        pose: PoseErrors | None,
        trust: float,
        stamp: int,
    ) -> Command:
        parameters = self.parameters
        if self._pose_laws is None:
            self._pose_laws = PoseLaws(self.target)
        error, error_norm = feature_error(image, self.target.view(lines.ids, parameters.columns).image)
        gain = law_gain(parameters, error)
        laws, errors = self._pose_laws, pose or PoseErrors(parameters.pose_covariance, True)
        displacement = (
            laws.by_pose(lines, errors.covariance)
            if parameters.law == "position"
            else laws.by_pose_and_image(
                lines,
                image,
                errors,
                parameters.image_covariance if covariances is None else covariances,
                parameters.fused_map_std,
                self._averaged(gain, stamp),
            )
        )
        twist = parameters.selected(-gain * displacement.twist)
        used = np.array(parameters.degrees_of_freedom, dtype=float)
        self._spread = lambda: displacement.covariance() * np.outer(used, used)
        values = interaction_conditioning(lines).singular_values
        asked = LawTwist(twist, gain, values, 0.0, 1.0, math.hypot(*twist.tolist()))
        return self._within_limits(lines, asked, error_norm, None, trust, stamp)

    def _without_uncertain(self, lines: LineSet, image: Array) -> tuple[LineSet, Array]:
        """Return the lines that a law goes by which does not weigh them, and their image lines."""
        covariances, pose = self._errors
        rows = self._certain.rows(lines, covariances, self.parameters.columns)
        if rows is None or covariances is None:
            return lines, image
        self._errors, self.note = (covariances[rows], pose), self._certain.text
        return lines.select(rows), image.reshape(-1, 3)[rows].ravel()

    def _averaged(self, gain: float, stamp: int) -> float:
        """Return what a loop of this gain leaves of the variance of independent errors of its frames, in (0, 1]."""
        seconds = (stamp - self._stamp) / _SECOND
        self._stamp = stamp
        # A first-order low-pass of time constant 1 / gain.
        return min(max(0.5 * gain * min(seconds, _LONGEST_PERIOD), _LEAST_AVERAGED), 1.0)

    def _servo(
        self,
        lines: LineSet,
        image: Array,
        reference: Reference | None,
        displacement: Array | None,
        trust: float,
        stamp: int,
    ) -> Command:
        parameters = self.parameters
        target = self.target if reference is None else reference.target
        view = target.view(lines.ids, parameters.columns)
        error, error_norm = feature_error(image, view.image)
        integral = self._integrated(error, lines.ids, stamp)
        # Where L is taken: at noisy image lines the mean of L and L* would see errors that no motion makes.
        here = image if law_interaction(parameters, view) != "mean" else project_lines(lines)
        asked = compute_twist(parameters, interaction_matrix(lines), here, error, integral, view, displacement)
        self._spread = partial(_image_spread, parameters, lines, here, view, self._errors)
        return self._within_limits(lines, asked, error_norm, reference, trust, stamp)

    def _within_limits(
        self, lines: LineSet, asked: LawTwist, error_norm: float, reference: Reference | None, trust: float, stamp: int
    ) -> Command:
        parameters = self.parameters
        twist, speed = asked.twist, asked.speed
        if reference is not None:
            twist = twist + parameters.selected(reference.feedforward)
            speed = math.hypot(*twist.tolist())
        if not (math.isfinite(speed) and math.isfinite(error_norm)):
            return self._halted(
                f"the control law gave a twist that is not finite: {twist.tolist()}, from an error of {error_norm:.3g}"
            )
        scale = trust if parameters.law != "guarded" else trust * self._guarded(lines, asked)
        if scale != 1.0:
            twist = twist * scale
        limited = 1.0
        linear, angular = parameters.speed_limits
        # As a whole no longer than the lower limit: within both.
        if scale * speed > linear or scale * speed > angular:
            twist, limited = saturate(twist, linear, angular)
        output = twist if not parameters.tool_frame else self._tool_twist(twist)
        if output is None:
            return self._halted(f"the camera twist {twist.tolist()} is not finite in {parameters.tool_frame}")
        self._factor = scale * limited
        self._speed = self._factor * asked.gain
        self._look_ahead.sent(twist, stamp)
        values = asked.values.tolist()
        mode, reason = Mode.SERVOING, ""
        if reference is None or reference.progress >= 1.0:
            mode, reason = self._progress(lines, error_norm, asked.gain, values, speed * self._factor, stamp)
        return Command(
            mode,
            reason,
            twist,
            output,
            error_norm,
            asked.gain,
            smallest_over_largest(values),
            asked.values if len(values) == 6 else np.array(values + [0.0] * (6 - len(values))),
            asked.damping,
            scale,
            limited < 1.0,
            0.0 if reference is None else reference.progress,
        )

    def _tool_twist(self, twist: Array) -> Array | None:
        """Return the twist of the tool, or None if it is not finite."""
        with _may_overflow():
            output = tool_twist(self.parameters.T_tool_camera, twist)
        return output if math.isfinite(sum(output.tolist())) else None

    def _halted(self, reason: str) -> Command:
        self._factor, self._spread = 0.0, None
        return Command(Mode.HALTED, reason)

    def _integrated(self, error: Array, ids: tuple[int, ...], stamp: int) -> Array | None:
        parameters = self.parameters
        if parameters.integral_gain == 0.0:
            return None
        held_back = self._factor < 1.0
        return self._integral.update(error, ids, stamp, parameters.integral_gain, parameters.integral_limit, held_back)

    def _guarded(self, lines: LineSet, asked: LawTwist) -> float:
        parameters = self.parameters
        if asked.health >= 1.0:
            return 1.0
        offsets, velocity = None, asked.twist[:3]
        pose = None if self._loci is None else self._loci.camera_pose(lines)
        if self._loci is not None and pose is not None:
            offsets, velocity = self._loci.offsets(pose.translation), pose.rotation @ velocity
        return guarded_scale(offsets, velocity, asked.health, parameters.guard_margin, parameters.guard_floor)

    def _progress(
        self, lines: LineSet, error_norm: float, gain: float, values: list[float], speed: float, stamp: int
    ) -> tuple[Mode, str]:
        parameters = self.parameters
        if error_norm <= parameters.converged_error:
            return Mode.CONVERGED, f"error norm {error_norm:.3g} is below {parameters.converged_error:g}"
        # The image changes by at most the largest singular value times the twist.
        ratio = values[0] * speed / (gain * error_norm)
        duration = self._stall.stalled_for(ratio, error_norm, parameters.stall_ratio, parameters.stall_error, stamp)
        if duration is None or duration < parameters.stall_time:
            return Mode.SERVOING, ""
        pose = None if self._loci is None else self._loci.camera_pose(lines)
        near = "" if self._loci is None or pose is None else self._loci.nearest_text(pose.translation)
        return Mode.STALLED, (
            f"for {duration:.3g} s the twist changes the image by no more than {ratio:.2g} of what the gain asks for, "
            f"with an error norm of {error_norm:.3g}: a local minimum, or a target that no camera pose reaches; "
            f"inverse condition number {smallest_over_largest(values):.3g}{near}"
        )


def known_pose(parameters: ControllerParameters, errors: PoseErrors | None) -> KnownPose | None:
    """Return how well the pose is known beside the image, so that detour may go straight by it, or None."""
    if errors is None or errors.of_image:
        return None
    return KnownPose.of_parameters(parameters, errors.covariance, not errors.independent)


def _may_overflow() -> np.errstate:
    # What overflows ends as a twist that is not finite, which is looked for.
    return np.errstate(over="ignore", invalid="ignore")


def _image_spread(
    parameters: ControllerParameters,
    lines: LineSet,
    image: Array,
    view: TargetView,
    errors: tuple[Array | None, PoseErrors | None],
) -> Array:
    """Return the covariance of a law's twist per gain squared, from errors of image lines and pose."""
    covariances, pose = errors
    own = parameters.image_covariance if covariances is None else covariances
    of_pose = parameters.pose_covariance if pose is None else pose.covariance
    return image_twist_covariance(parameters, lines, image, view, own, of_pose)
