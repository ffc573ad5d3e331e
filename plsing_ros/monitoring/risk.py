# SPDX-License-Identifier: Apache-2.0
"""How likely a run is to come to harm, by roll-outs of the closed loop from where the camera may be."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from plsing_ros.arrays import Array
from plsing_ros.errors import PlsingError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.monitoring.rollout import Harm, LoopModel, Outcomes, RolloutLaw, RolloutTask, RunState, guard_loci
from plsing_ros.parameters import MonitorParameters
from plsing_ros.singularities import SingularSet

_SECOND = 1_000_000_000
# Within these of the target a run is over, and the next one begins [m], [rad].
_ARRIVED, _ARRIVED_ANGLE = 0.05, math.radians(2.0)
# A camera that was not told to move for this long rests: what comes next is another run [ns].
_REST = _SECOND
# Between two frames as long as it is not known [s].
_FRAME_PERIOD = 1.0 / 30.0
# The laws that a pose asked for is rolled out with.
LAWS = ("pinv", "dls", "adaptive_dls", "guarded", "detour", "position")
# Steps of one answer, all samples together; with more, the roll-out has longer steps.
_MAX_STEPS = 30_000
# The share of samples that may demand more than `demand` says.
_DEMANDING = 0.25
# An answer counts until the next ones are overdue by this factor of their period.
_OVERDUE = 10.0

_HARM_TEXT = {
    Harm.AWAY: "the camera leaves the neighbourhood of its path",
    Harm.FEW_LINES: "fewer than three lines stay in view",
    Harm.LATE: "the target is not reached in time",
}


@dataclass(frozen=True, eq=False)
class Risk:
    """What roll-outs say about the run.

    Attributes:
        stamp: Of the features it starts from [ns].
        outcomes: Of all samples.
        law: Which was rolled out.
        T_world_camera: Where it starts.
        before: Share of the answer before that came to harm, or None if this is the first one.
    """

    stamp: int
    outcomes: Outcomes
    law: RolloutLaw
    T_world_camera: Pose
    before: float | None = None

    @property
    def probability(self) -> float:
        """Of harm within the horizon: the share of the samples of this answer and of the one before."""
        share = self.outcomes.risk
        return share if self.before is None else 0.5 * (share + self.before)

    @cached_property
    def demand(self) -> float:
        """Largest expected commanded speed over the robot's limit, or 1.5 times the first one if that is more."""
        return float(np.quantile(self.outcomes.demand, 1.0 - _DEMANDING))

    @cached_property
    def time_to_harm(self) -> float | None:
        """Median of the samples that come to harm, from the stamp on [s]; None if none does."""
        harmed = self.outcomes.kind != Harm.NONE
        return float(np.median(self.outcomes.harm_time[harmed])) if harmed.any() else None

    @cached_property
    def harm(self) -> Harm:
        """The most frequent kind of harm, NONE if no sample comes to harm."""
        kinds = self.outcomes.kind[self.outcomes.kind != Harm.NONE]
        return Harm(int(np.bincount(kinds).argmax())) if len(kinds) else Harm.NONE

    @property
    def harm_text(self) -> str:
        """What kind of harm is expected, in words; "" if none."""
        time = self.time_to_harm
        return "" if time is None else f"in {time:.1f} s {_HARM_TEXT[self.harm]}"

    @property
    def demand_text(self) -> str:
        """How much speed is demanded, in words."""
        times = self.outcomes.demand_time[self.outcomes.demand_time >= 0.0]
        when = f" in {float(np.median(times)):.1f} s" if len(times) else ""
        return f"speed expected{when}, {self.demand:.3g} times the limit,"


class RunClock:
    """Since when the run goes on, and from how far: both begin anew at rest and at the target."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Begin with another task."""
        self.start: int | None = None
        self.start_distance = 0.0
        self.first_speeds = (-1.0, -1.0)
        self._moved: int | None = None

    def note_motion(self, stamp: int) -> None:
        """Take note that the camera was told to move for the features of a stamp [ns]."""
        self._moved = stamp

    def update(self, stamp: int, here: Pose, target: Pose) -> float:
        """Return the time since the run's start [s]; the camera is here now."""
        distance = float(np.linalg.norm(here.translation - target.translation))
        rests = self._moved is None or stamp - self._moved > _REST
        if self.start is None or rests or is_arrived(here, target, distance) or stamp < self.start:
            self.start, self.start_distance, self.first_speeds = stamp, distance, (-1.0, -1.0)
        return (stamp - self.start) / _SECOND


def is_arrived(here: Pose, target: Pose, distance: float) -> bool:
    """Return whether a camera is within 5 cm and 2 degrees of the target."""
    cosine = 0.5 * (float(np.vdot(here.rotation, target.rotation)) - 1.0)
    return distance <= _ARRIVED and cosine >= math.cos(_ARRIVED_ANGLE)


class RiskPredictor:
    """Rolls out the loop again and again, in the place of the caller or in an executor, and keeps the latest answer."""

    def __init__(self, executor: Executor | None = None) -> None:
        """Begin; without an executor answers are made where they are asked for."""
        self._executor = executor
        self._clock = RunClock()
        self._seed = 0
        self._stated: tuple[str, float] | None = None
        self.restart()

    def restart(self) -> None:
        """Begin with another task: another target, scene or clock."""
        self._clock.restart()
        self._commands: list[tuple[int, Array]] = []
        self._latest: Risk | None = None
        self._pending: Future[Risk | None] | None = None
        self._asked: int | None = None
        self._stamps: list[int] = []

    @property
    def is_awaited(self) -> bool:
        """Whether an answer is being made."""
        return self._pending is not None

    def receive_twist(self, twist: Array, stamp: int, min_speed: float) -> None:
        """Take the commanded twist (6,) for the features of a stamp [ns]; below min_speed [m/s] the camera rests."""
        self._commands = [*self._commands[-1:], (stamp, twist)]
        if math.hypot(*twist.tolist()[:3]) >= min_speed or math.hypot(*twist.tolist()[3:]) >= min_speed:
            self._clock.note_motion(stamp)

    def receive_controller(self, law: str, gain: float) -> None:
        """Take the law and lambda [1/s] that the controller says are in force."""
        if law and gain > 0.0:
            self._stated = (law, gain)

    def latest(
        self,
        stamp: int,
        pose: Pose | None,
        covariance: Array | None,
        singular: SingularSet,
        T_world_target: Pose | None,
        parameters: MonitorParameters,
    ) -> Risk | None:
        """Return what is known of the run at features of a stamp [ns]: the latest answer, or None.

        Args:
            stamp: Of the features.
            pose: T_world_camera, if it is known.
            covariance: Of that pose in the world's axes, (position, rotation), shape (6, 6), or None.
            singular: The scene.
            T_world_target: Where the camera is to go, if it is known.
            parameters: In force.
        """
        off = parameters.controller == "unknown" or parameters.horizon == 0.0
        if pose is None or T_world_target is None or off:
            return None
        self._stamps = [*self._stamps[-9:], stamp]
        self._collect()
        period = round(parameters.prediction_period * _SECOND)
        due = self._asked is None or not 0 <= stamp - self._asked < period
        elapsed = self._clock.update(stamp, pose, T_world_target)
        if due and self._pending is None:
            self._asked = stamp
            self._submit(self._question(stamp, pose, covariance, singular, T_world_target, elapsed, parameters))
            self._collect()
        latest = self._latest
        if latest is None or not 0 <= stamp - latest.stamp <= _OVERDUE * period:
            return None
        return latest

    def _question(
        self,
        stamp: int,
        pose: Pose,
        covariance: Array | None,
        singular: SingularSet,
        target: Pose,
        elapsed: float,
        parameters: MonitorParameters,
    ) -> Callable[[], Risk | None]:
        law = self.law(parameters)
        clock, self._seed = self._clock, self._seed + 1
        still = np.zeros(6)
        command = self._commands[-1][1] if self._commands and stamp - self._commands[-1][0] < _REST else still
        state = RunState(law.deadline, clock.start_distance, elapsed, *clock.first_speeds, command, command)
        task = rollout_task(singular, target, law, parameters, self._frame_period())
        samples, seed = parameters.samples, self._seed

        def answer() -> Risk | None:
            starts = poses_around(pose, covariance, samples, seed)
            try:
                return Risk(stamp, task.roll_out(starts, state, seed), law, pose)
            except PlsingError:
                return None

        if clock.first_speeds[0] < 0.0:
            first = task.twist(pose)
            clock.first_speeds = (float(np.linalg.norm(first[:3])), float(np.linalg.norm(first[3:])))
        return answer

    def law(self, parameters: MonitorParameters) -> RolloutLaw:
        """Return the law in force: as the controller states it, with the parameters given here."""
        law = RolloutLaw.of_parameters(parameters)
        if self._stated is None:
            return law
        if self._stated[0] != law.law:
            law = RolloutLaw.of_parameters(dataclasses.replace(parameters, law=self._stated[0]))
        return dataclasses.replace(law, gain=self._stated[1], gain_slope=0.0)

    def _frame_period(self) -> float:
        steps = np.diff(self._stamps)
        return float(np.clip(np.median(steps) / _SECOND, 1e-3, 1.0)) if len(steps) else _FRAME_PERIOD

    def _submit(self, answer: Callable[[], Risk | None]) -> None:
        if self._executor is None:
            self._take(answer())
        else:
            # An executor that is shut down takes nothing any more: the node is about to end.
            with contextlib.suppress(RuntimeError):
                self._pending = self._executor.submit(answer)

    def _collect(self) -> None:
        if self._pending is not None and self._pending.done():
            self._take(self._pending.result())
            self._pending = None

    def _take(self, risk: Risk | None) -> None:
        if risk is None:
            return
        if self._latest is not None:
            risk = dataclasses.replace(risk, before=self._latest.outcomes.risk)
        self._latest = risk


def risks_of_laws(pose: Pose, singular: SingularSet, target: Pose, parameters: MonitorParameters) -> dict[str, Risk]:
    """Return what each law would do from a pose to the target, with the gain and the options of the parameters.

    Raises:
        GeometryError: If the numbers do not make a task.
    """
    found = {}
    distance = float(np.linalg.norm(pose.translation - target.translation))
    for name in LAWS:
        law = RolloutLaw.of_parameters(dataclasses.replace(parameters, law=name))
        task = rollout_task(singular, target, law, parameters, _FRAME_PERIOD)
        starts = [pose] * parameters.samples
        found[name] = Risk(0, task.roll_out(starts, RunState(law.deadline, distance), 0), law, pose)
    return found


def laws_text(risks: dict[str, Risk]) -> str:
    """Return what each law would do, in words."""
    parts = []
    for name, risk in risks.items():
        harm = f"{risk.probability:.0%}" + (f" ({risk.harm_text})" if risk.probability else "")
        parts.append(f"{name}: harm {harm}, demand {risk.demand:.2g}")
    return "; ".join(parts)


def rollout_task(
    singular: SingularSet, target: Pose, law: RolloutLaw, parameters: MonitorParameters, period: float
) -> RolloutTask:
    """Return the loop of a monitor's parameters with frames of a period [s]."""
    lines: LineSet = singular.lines
    horizon = law.horizon
    # Never more steps than an answer may cost; latency stays what it is in seconds.
    step = max(period, horizon * parameters.samples / _MAX_STEPS)
    linear, angular = parameters.robot_linear_speed or math.inf, parameters.robot_angular_speed or math.inf
    loop = LoopModel(
        period=step,
        # What the law looks ahead by itself does not delay it.
        latency=max(round((parameters.frames_late * period - parameters.latency) / step), 0),
        jitter=parameters.jitter * period / step,
        lag=parameters.robot_lag,
        robot_linear_speed=linear if parameters.robot_clamps else math.inf,
        robot_angular_speed=angular if parameters.robot_clamps else math.inf,
        demand_linear_speed=linear,
        demand_angular_speed=angular,
        image_noise=parameters.image_noise,
        position_noise=parameters.pose_position_noise,
        rotation_noise=parameters.pose_rotation_noise,
        map_noise=parameters.map_noise,
        focal_error=parameters.focal_error,
        dropped_frames=parameters.dropped_frames,
        half_view=(parameters.half_view[0], parameters.half_view[1]),
        near=parameters.nearest,
        min_length=parameters.shortest_image,
        path_linear_speed=parameters.detour_linear_speed,
        path_angular_speed=parameters.detour_angular_speed,
        horizon=horizon,
    )
    ends = np.reshape(parameters.line_ends, (-1, 2, 3)) if parameters.line_ends else None
    return RolloutTask(lines, target, law, loop, ends, guard_loci(singular))


def poses_around(pose: Pose, covariance: Array | None, count: int, seed: int) -> list[Pose]:
    """Return samples of where a camera may be.

    Args:
        pose: T_world_camera.
        covariance: In the world's axes, (position [m], rotation [rad]), shape (6, 6); None: exact.
        count: How many.
        seed: Of the samples.
    """
    if covariance is None or not np.any(covariance):
        return [pose] * count
    drawn = np.random.default_rng(seed).multivariate_normal(np.zeros(6), covariance, size=count, method="eigh")
    turns = Rotation.from_rotvec(drawn[:, 3:]).as_matrix()
    return [
        Pose(turn @ pose.rotation, pose.translation + shift) for turn, shift in zip(turns, drawn[:, :3], strict=True)
    ]
