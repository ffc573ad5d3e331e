# SPDX-License-Identifier: Apache-2.0
"""The closed loop run ahead of the camera, natively: what comes of a task, for several noise samples at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.levels import MessageWord
from plsing_ros.singularities import SingularSet

if TYPE_CHECKING:
    from plsing_ros.parameters.law import LawParameters

# A line whose ends are not known is taken as this long on either side of its point [m].
HALF_LENGTH = 50.0
# Deadline of a task: so many time constants of the law, and so much for the robot [s]; the least on a path [s].
_TIME_CONSTANTS, _ALLOWANCE, _PATH_DEADLINE = 10.0, 4.0, 60.0
_MAX_HORIZON = 60.0  # [s]
# A demand counts as large as this share of the samples makes it.
DEMAND_SHARE = 0.25
# Which L a law inverts with interaction = auto.
_AUTO = {"guarded": "mean", "detour": "target"}


class Harm(MessageWord):
    """What comes of a run, at its first instant."""

    NONE = 0  # arrived, or on its way
    AWAY = 1  # farther from the target than both 1.5 times the start's distance and 5 cm more than that
    FEW_LINES = 2  # fewer than three lines in view
    LATE = 3  # not within 5 cm and 2 degrees for 1 s before the deadline


@dataclass(frozen=True)
class RolloutLaw:
    """The law in force; names and meanings of the parameters of the controller (config/controller.yaml)."""

    law: str = "pinv"
    interaction: str = "current"
    gain: float = 0.1
    gain_slope: float = 0.0
    gain_at_infinity: float = 0.05
    degrees_of_freedom: tuple[int, ...] = (1, 1, 1, 1, 1, 1)
    pinv_threshold: float = 1e-12
    damping: float = 0.3
    onset: float = 0.5
    max_damping: float = 0.5
    guard_margin: float = 0.15
    guard_floor: float = 0.2
    guard_unobservable_share: float = 1.0
    max_linear_speed: float = math.inf
    max_angular_speed: float = math.inf

    @classmethod
    def of_parameters(cls, parameters: LawParameters) -> RolloutLaw:
        """Return the law of a controller with these parameters, without integral and secondary twist."""
        interaction = parameters.interaction
        if interaction == "auto":
            interaction = _AUTO.get(parameters.law, "current")
        linear, angular = parameters.speed_limits
        return cls(
            parameters.law,
            interaction,
            parameters.gain,
            parameters.gain_slope,
            parameters.gain_at_infinity,
            parameters.degrees_of_freedom,
            parameters.pinv_threshold,
            parameters.damping,
            parameters.onset,
            parameters.max_damping,
            parameters.guard_margin,
            parameters.guard_floor,
            parameters.guard_unobservable_share,
            linear,
            angular,
        )

    @property
    def deadline(self) -> float:
        """When a task must be done [s]: 10 / gain + 4, and at least a minute for a law that follows a path."""
        deadline = _TIME_CONSTANTS / self.gain + _ALLOWANCE
        return max(deadline, _PATH_DEADLINE) if self.law == "detour" else deadline

    @property
    def horizon(self) -> float:
        """How far ahead a roll-out goes [s]: to the deadline, at most a minute."""
        return min(self.deadline, _MAX_HORIZON)


def guard_loci(found: SingularSet) -> Array | None:
    """Return the transversals and isolated points of a scene as RolloutTask.loci wants them, or None.

    None where surfaces are singular: a roll-out of guarded then slows down by the condition alone.
    """
    if found.surfaces:
        return None
    point, direction = found.lines_and_points
    kept = len(point) - len(found.lines)
    return np.hstack([point[:kept], direction[:kept]])


@dataclass(frozen=True)
class LoopModel:
    """Everything between the law and the camera's motion.

    Attributes:
        period: Between two frames, which are the steps of the first second [s].
        later_period: Between two steps after that [s]; what is less than the period stands for it.
        latency: Frames after which a command is carried out.
        jitter: Standard deviation of what comes on top of it, frames.
        lag: Time constant of the robot [s].
        robot_linear_speed: The robot scales a twist down to this [m/s].
        robot_angular_speed: Likewise [rad/s].
        demand_linear_speed: Commanded speeds above this, and above 1.5 times the first one, are a demand [m/s].
        demand_angular_speed: Likewise [rad/s].
        image_noise: Standard deviation of a segment's ends across it, on z = 1 (pixels over focal length).
        position_noise: Standard deviation of the pose that 3-D lines are made with, each axis [m].
        rotation_noise: Likewise [rad].
        map_noise: Standard deviation of each coordinate of the ends of the scene's lines, drawn once a sample [m].
        focal_error: Relative standard deviation of the focal length, drawn once a sample.
        dropped_frames: Share of frames without a detection.
        dropped_lines: Share of lines that are missed in a frame.
        half_view: Tangents of half the field of view, x and y; 0: not limited.
        near: Nearest depth that is seen [m].
        min_length: Shortest part of a segment that is detected, on z = 1.
        path_linear_speed: Along a path, law = detour [m/s].
        path_angular_speed: Likewise [rad/s].
        horizon: How far ahead to go [s].
        stops: Whether a run ends when it has arrived; else it goes on to the horizon, and is never late.
        pose_error_lasts: Whether what a start is off from T_world_camera stays, in the camera's frame: the error of an
            estimated pose; else it is an error of that frame alone.
    """

    period: float = 1.0 / 30.0
    later_period: float = 0.0
    latency: int = 0
    jitter: float = 0.0
    lag: float = 0.0
    robot_linear_speed: float = math.inf
    robot_angular_speed: float = math.inf
    demand_linear_speed: float = 0.25
    demand_angular_speed: float = 1.0
    image_noise: float = 0.0
    position_noise: float = 0.0
    rotation_noise: float = 0.0
    map_noise: float = 0.0
    focal_error: float = 0.0
    dropped_frames: float = 0.0
    dropped_lines: float = 0.0
    half_view: tuple[float, float] = (0.0, 0.0)
    near: float = 0.02
    min_length: float = 0.0
    path_linear_speed: float = 0.1
    path_angular_speed: float = 0.2
    horizon: float = 60.0
    stops: bool = True
    pose_error_lasts: bool = False

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name != "half_view" and not value >= 0.0:
                raise GeometryError(f"{each.name} of a loop is {value}; it must not be negative")
        if not self.period > 0.0 or len(self.half_view) != 2 or not min(self.half_view) >= 0.0:
            raise GeometryError(f"period {self.period} s or half_view {self.half_view} of a loop is out of range")


@dataclass(frozen=True, eq=False)
class RunState:
    """How far the run is that is rolled out.

    Attributes:
        deadline: When it must have arrived, from its start [s].
        elapsed: Since its start [s].
        start_distance: From the target at its start [m].
        first_linear_speed: Of its first command [m/s]; negative: the roll-out's own first one.
        first_angular_speed: Likewise [rad/s].
        motion: The robot's twist now (v, omega), shape (6,) [m/s, rad/s].
        command: The latest commanded twist, not yet carried out, shape (6,).
        arrived_for: How long the camera has been within 5 cm and 2 degrees of the target [s].
        answer: The twist that is commanded for what is seen now, shape (6,), not yet made; None: each sample's own.
    """

    deadline: float
    start_distance: float
    elapsed: float = 0.0
    first_linear_speed: float = -1.0
    first_angular_speed: float = -1.0
    motion: Array = field(default_factory=lambda: np.zeros(6))
    command: Array = field(default_factory=lambda: np.zeros(6))
    arrived_for: float = 0.0
    answer: Array | None = None


def reached_size(sizes: Array, weights: Array, share: float) -> float:
    """Return the largest size that at least this share of samples, by their weights, reaches.

    Args:
        sizes: Of k samples, shape (k,), k >= 1.
        weights: Of each, above 0, shape (k,).
        share: Above 0, at most 1.
    """
    # Methods, because numpy's functions take longer than the work on a few samples.
    order = (-sizes).argsort()
    reached = weights[order].cumsum()
    # Rounding must not ask for one sample more.
    return float(sizes[order[reached.searchsorted((share - 1e-9) * reached[-1])]])


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What came of k samples, each array of shape (k,).

    Attributes:
        kind: Of harm, values of Harm.
        harm_time: When, from now [s]; 0 without harm.
        demand: Largest commanded speed over max(limit, 1.5 times the first one).
        demand_time: When it exceeded 1, from now [s]; -1: never.
        speed: Largest commanded speed over demand_linear_speed or demand_angular_speed.
        distance: From the target at the end [m].
        angle: Likewise [rad].
        first_linear_speed: Of the run's first command [m/s]; negative: none was made.
        first_angular_speed: Likewise [rad/s].
        mean_square_distance: From the target, over the second half of the horizon [m^2]; 0 if it ended before.
        steps: How many steps were made, all samples together; samples that nothing tells apart are made once.
    """

    kind: Array
    harm_time: Array
    demand: Array
    demand_time: Array
    speed: Array
    distance: Array
    angle: Array
    first_linear_speed: Array
    first_angular_speed: Array
    mean_square_distance: Array
    steps: int

    @property
    def risk(self) -> float:
        """Share of the samples that come to harm."""
        return float(np.count_nonzero(self.kind)) / len(self.kind)

    @property
    def demanded(self) -> float:
        """The demand that a quarter of the samples reaches."""
        return reached_size(self.demand, np.ones(len(self.demand)), DEMAND_SHARE)

    @cached_property
    def time_to_harm(self) -> float | None:
        """Median of the samples that come to harm, from now [s]; None if none does."""
        harmed = self.kind != Harm.NONE
        return float(np.median(self.harm_time[harmed])) if harmed.any() else None

    @cached_property
    def harm(self) -> Harm:
        """The most frequent kind of harm, NONE if no sample comes to harm."""
        kinds = self.kind[self.kind != Harm.NONE]
        return Harm(int(np.bincount(kinds).argmax())) if len(kinds) else Harm.NONE

    def replaced(self, rows: Sequence[int], by: Outcomes) -> Outcomes:
        """Return these with others in the place of some samples, by their numbers."""
        values: dict[str, Any] = {}
        for each in fields(self):
            if each.name != "steps":
                values[each.name] = np.array(getattr(self, each.name))
                values[each.name][list(rows)] = getattr(by, each.name)
        return Outcomes(**values, steps=self.steps + by.steps)


@dataclass(frozen=True, eq=False)
class RolloutTask:
    """A scene, a target and a loop.

    Attributes:
        lines: In the scene frame.
        ends: Of their segments in the scene frame, shape (n, 2, 3) [m]; None: far away.
        T_world_target: Where the camera goes.
        law: In force.
        loop: It runs in.
        loci: A point and a direction of each singular locus that guarded keeps away from, direction zero for an
            isolated point, shape (m, 6); None: not known, the condition alone counts.
        covariances: Of (phi, rho) of each image line as (phi phi, phi rho, rho rho), shape (n, 3); None: from
            image_noise and the ends.
        residuals: What was seen of (phi, rho) of each image line minus what the map says at the poses that were
            believed, as its mean and the covariance of the mean: (phi, rho, phi phi, phi rho, rho rho), NaN for a line
            that was not seen, shape (n, 5); None: nothing is known. Samples' maps are drawn accordingly.
        T_world_camera: Where the camera is believed to be; None: at the first start.
        path: T_world_camera along the path that law = detour follows, to the target; empty: straight to it.
    """

    lines: LineSet
    T_world_target: Pose
    law: RolloutLaw
    loop: LoopModel
    ends: Array | None = None
    loci: Array | None = None
    covariances: Array | None = None
    residuals: Array | None = None
    T_world_camera: Pose | None = None
    path: tuple[Pose, ...] = ()

    def roll_out(self, starts: list[Pose], state: RunState, seed: int) -> Outcomes:
        """Run the closed loop once from each start, with noise of its own, without the interpreter's lock.

        Args:
            starts: T_world_camera now: samples of where the camera may be.
            state: How far the run is.
            seed: Of all noise.

        Raises:
            GeometryError: If the numbers do not make a task.

        Source: new, docs/monitor.md. The law is the controller's to 1e-9 where there is no noise, with an
        approximation of detour (along its path, or else the straight line, with the speeds of a path).
        """
        try:
            found = _core.roll_out(
                *self._scene(),
                self.T_world_target,
                np.zeros(0) if self.covariances is None else np.asarray(self.covariances, dtype=float),
                self.residuals,
                self.T_world_camera,
                self.loci,
                self.path,
                self.law,
                self.loop,
                state,
                np.array([each.rotation for each in starts]),
                np.array([each.translation for each in starts]),
                seed,
            )
        except ValueError as error:
            raise GeometryError(f"roll-out: {error}") from None
        return Outcomes(**found)

    def twist(self, T_world_camera: Pose, image_lines: Array | None = None) -> Array:
        """Return the twist (6,) that the law commands at a pose.

        Args:
            T_world_camera: Where the camera is.
            image_lines: Of the scene's lines, shape (n, 3), zeros where a line is not seen; None: no noise.
        """
        image = np.zeros((0, 3)) if image_lines is None else image_lines
        twist: Array = _core.compute_rollout_twist(
            *self._scene(), self.T_world_target, self.loci, self.law, self.loop, T_world_camera, image
        )
        return twist

    def _scene(self) -> tuple[Array, Array, Array]:
        lines, ends = self.lines, self.ends
        if ends is None:
            reach = HALF_LENGTH * lines.direction
            ends = np.stack([lines.point - reach, lines.point + reach], axis=1)
        return lines.direction, lines.moment, np.reshape(ends, (-1, 3))


def poses_around(pose: Pose, covariance: Array | None, count: int, seed: int, share: float = 1.0) -> list[Pose]:
    """Return samples of where a camera may be.

    Args:
        pose: T_world_camera.
        covariance: In the world's axes, (position [m], rotation [rad]), shape (6, 6); None: exact.
        count: How many.
        seed: Of the samples.
        share: Of how far they are from the pose by the covariance.
    """
    if covariance is None or not np.any(covariance):
        return [pose] * count
    normal = np.random.default_rng(seed).multivariate_normal(np.zeros(6), covariance, size=count, method="eigh")
    drawn = share * normal
    turns = Rotation.from_rotvec(drawn[:, 3:]).as_matrix()
    return [
        Pose(turn @ pose.rotation, pose.translation + shift) for turn, shift in zip(turns, drawn[:, :3], strict=True)
    ]
