# SPDX-License-Identifier: Apache-2.0
"""How likely a run is to come to harm, by roll-outs of the closed loop from where the camera may be."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.geometry import Pose
from plsing_ros.monitoring.evidence import Evidence, Sizes
from plsing_ros.monitoring.law_check import LawCheck, law_twist
from plsing_ros.monitoring.map_residuals import MapResiduals
from plsing_ros.monitoring.rollout_setup import FIRST_STEPS, FRAME_PERIOD, MAX_STEPS, roll_out_around, rollout_task
from plsing_ros.monitoring.run_clock import RunClock
from plsing_ros.monitoring.segment_ends import SegmentEnds
from plsing_ros.monitoring.shaking import expected_shaking
from plsing_ros.parameters import ControllerParameters, MonitorParameters
from plsing_ros.planning.rollout import DEMAND_SHARE, Harm, Outcomes, RolloutLaw, RunState
from plsing_ros.singularities import SingularSet

_SECOND = 1_000_000_000
# A command for features older than this is no longer carried out [ns].
_REST = _SECOND
# An answer counts until the next ones are overdue by this factor of their period.
_OVERDUE = 10.0
# A path ends this near the target it leads to [m], [rad].
_SAME_TARGET = 0.05
# Answers of about this time count together [s].
_MEMORY = 1.0

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
        probability: Of harm within the horizon, by this answer's samples and those of about the last second.
        demand: Largest commanded speed over the robot's limit, or 1.5 times the first one if that is more, as a quarter
            of these samples reaches it.
        shaking: How far noise drives the camera about the target, root mean square [m]; None: not known yet.
        is_other: Whether the commanded twists are not those of the law.
        lacks_path: Whether the law waits for its path: what is rolled out is the straight way, which it may avoid.
    """

    stamp: int
    outcomes: Outcomes
    law: RolloutLaw
    T_world_camera: Pose
    probability: float
    demand: float
    shaking: float | None = None
    is_other: bool = False
    lacks_path: bool = False

    @cached_property
    def time_to_harm(self) -> float | None:
        """Median of the samples that come to harm, from the stamp on [s]; None if none does."""
        harmed = self.outcomes.kind != Harm.NONE
        return float(np.median(self.outcomes.harm_time[harmed])) if harmed.any() else None

    @cached_property
    def harm(self) -> Harm:
        """The most frequent kind of harm, NONE if no sample comes to harm."""
        return self.outcomes.harm

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


class RiskPredictor:
    """Rolls out the loop again and again, in the place of the caller or in an executor, and keeps the latest answer."""

    def __init__(self, executor: Executor | None = None) -> None:
        """Begin; without an executor answers are made where they are asked for, else when begin_rollout is called."""
        self._executor = executor
        self._clock = RunClock()
        self._seed = 0
        self._stated: tuple[str, float] | None = None
        self._path: tuple[Pose, ...] = ()
        self.restart()

    def restart(self) -> None:
        """Begin with another task: another target, scene or clock."""
        self._clock.restart()
        self._commands: list[tuple[int, Array]] = []
        self._latest: Risk | None = None
        self._due: Callable[[], _Answer | None] | None = None
        self._pending: Future[_Answer | None] | None = None
        self._asked: int | None = None
        self._run = 0
        self._stamps: list[int] = []
        self._evidence, self._speeds = Evidence(), Sizes()
        self._law_check = LawCheck()
        self._residuals: MapResiduals | None = None
        self._segments: SegmentEnds | None = None
        self._shaking: tuple[object, float] | None = None

    @property
    def is_awaited(self) -> bool:
        """Whether an answer is being made."""
        return self._pending is not None or self._due is not None

    @property
    def other_law(self) -> str:
        """The law whose twists those that are commanded are not, or "" as long as they are."""
        latest = self._latest
        return latest.law.law if latest is not None and latest.is_other else ""

    @property
    def seen_ends(self) -> Array | None:
        """Where the segments end by what was seen of them, in the scene frame, shape (n, 2, 3) [m], if anything was."""
        return None if self._segments is None else self._segments.ends()

    def receive_twist(self, twist: Array, stamp: int, min_speed: float) -> None:
        """Take the commanded twist (6,) for the features of a stamp [ns]; below min_speed [m/s] the camera rests."""
        self._commands = [*self._commands[-1:], (stamp, twist)]
        if math.hypot(*twist.tolist()[:3]) >= min_speed or math.hypot(*twist.tolist()[3:]) >= min_speed:
            self._clock.note_motion(stamp, math.hypot(*twist.tolist()[:3]))
            self._law_check.receive_twist(twist, stamp)

    def receive_controller(self, law: str, gain: float) -> None:
        """Take the law and lambda [1/s] that the controller says are in force."""
        if law and gain > 0.0:
            self._stated = (law, gain)

    def receive_path(self, poses: Sequence[Pose]) -> None:
        """Take the path, T_world_camera from start to target, that the controller follows; none: it has no path."""
        # What is said along another one, or without one, is of no use any more.
        self._path, self._asked = tuple(poses), None

    def latest(
        self,
        stamp: int,
        pose: Pose | None,
        covariance: Array | None,
        observation: LineObservation,
        singular: SingularSet,
        T_world_target: Pose | None,
        parameters: MonitorParameters,
    ) -> Risk | None:
        """Return what is known of the run at features of a stamp [ns]: the latest answer, or None.

        None, too, while the commanded twists are not those of the law.

        Args:
            stamp: Of the features.
            pose: T_world_camera, if it is known.
            covariance: Of that pose in the world's axes, (position, rotation), shape (6, 6), or None.
            observation: The features.
            singular: The scene.
            T_world_target: Where the camera is to go, if it is known.
            parameters: In force.
        """
        off = parameters.controller == "unknown" or parameters.horizon == 0.0
        # Where another pose explains the image as well, nothing is known of the run.
        ambiguous = observation.verdict is LinesVerdict.AMBIGUOUS
        if pose is None or T_world_target is None or off or ambiguous:
            return None
        self._stamps = [*self._stamps[-9:], stamp]
        self._collect()
        self._law_check.receive_frame(stamp, pose, observation)
        if parameters.map_noise > 0.0 or parameters.focal_error > 0.0:
            if self._residuals is None:
                self._residuals = MapResiduals(singular.lines)
            self._residuals.add(observation)
        period = round(parameters.prediction_period * _SECOND)
        due = self._asked is None or not 0 <= stamp - self._asked < period
        deviation = 0.0 if covariance is None else math.sqrt(sum(covariance.ravel().tolist()[:15:7]))
        elapsed = self._clock.update(stamp, pose, T_world_target, parameters.degrees_of_freedom, deviation)
        if due and not self.is_awaited:
            if self._run != self._clock.run:
                self._run, self._evidence, self._speeds = self._clock.run, Evidence(), Sizes()
            self._asked = stamp
            if observation.ends is not None:
                self._segments = self._segments or SegmentEnds(singular.lines)
            self._submit(
                self._question(stamp, pose, covariance, observation, singular, T_world_target, elapsed, parameters)
            )
            self._collect()
        latest = self._latest
        if latest is None or latest.is_other or not 0 <= stamp - latest.stamp <= _OVERDUE * period:
            return None
        return latest

    def _question(
        self,
        stamp: int,
        pose: Pose,
        covariance: Array | None,
        observation: LineObservation,
        singular: SingularSet,
        target: Pose,
        elapsed: float,
        parameters: MonitorParameters,
    ) -> Callable[[], _Answer | None]:
        # Only what the next features change is taken down here: the thread of the roll-outs does the rest.
        clock, self._seed = self._clock, self._seed + 1
        still = np.zeros(6)
        command = self._commands[-1][1] if self._commands and stamp - self._commands[-1][0] < _REST else still
        start_distance, first_speeds, arrived_for = clock.start_distance, clock.first_speeds, clock.arrived_for
        is_first, stated, stamps = self._latest is None, self._stated, self._stamps
        known_path, known_shaking = self._path, self._shaking
        segments, map_residuals, check = self._segments, self._residuals, self._law_check
        samples, seed, run = parameters.samples, self._seed, clock.run

        def answer() -> _Answer | None:
            try:
                if segments is not None:
                    segments.add(pose, observation)
                law = _law_in_force(parameters, stated)
                state = RunState(law.deadline, start_distance, elapsed, *first_speeds, command, command, arrived_for)
                steps = FIRST_STEPS if is_first else MAX_STEPS
                ends = None if segments is None else segments.ends()
                task = rollout_task(singular, target, law, parameters, _frame_period(stamps), observation, steps, ends)
                # A path that leads elsewhere is that of another target.
                leads_there = bool(known_path) and known_path[-1].is_close(target, _SAME_TARGET)
                path = known_path if leads_there and law.law == "detour" else ()
                lacks_path = law.law == "detour" and not path and not np.any(command)
                # As long as the loop is the same the target is held as well as it was; the first answer does not wait
                # for that.
                loop = (law, target, parameters, singular)
                shakes = known_shaking[1] if known_shaking is not None and known_shaking[0] == loop else None
                is_known = not (parameters.latency or parameters.integral_gain or any(parameters.secondary_twist))
                begins = is_known and first_speeds[0] < 0.0
                residuals = None if map_residuals is None else map_residuals.rows()
                seen_task = dataclasses.replace(task, residuals=residuals, T_world_camera=pose, path=path)
                # The first command is what demand is measured by: it is known as soon as its features are.
                first = law_twist(task, pose, observation) if begins else None
                if first is not None and observation.verdict is LinesVerdict.POOR:
                    first = ControllerParameters.slow_scale * first
                outcomes = roll_out_around(
                    seen_task, pose, covariance, samples, dataclasses.replace(state, answer=first), seed
                )
                if shakes is None and not is_first:
                    shakes = expected_shaking(task, samples, seed, MAX_STEPS)
                is_other = is_known and check.is_other(task)
            except PlsingError:
                return None
            risk = Risk(stamp, outcomes, law, pose, outcomes.risk, outcomes.demanded, shakes, is_other, lacks_path)
            return _Answer(run, loop, risk)

        return answer

    def law(self, parameters: MonitorParameters) -> RolloutLaw:
        """Return the law in force: as the controller states it, with the parameters given here."""
        return _law_in_force(parameters, self._stated)

    def begin_rollout(self) -> None:
        """Hand over the roll-out that is due, if any, to the executor."""
        answer, self._due = self._due, None
        if answer is not None and self._executor is not None:
            # An executor that is shut down takes nothing any more: the node is about to end.
            with contextlib.suppress(RuntimeError):
                self._pending = self._executor.submit(answer)

    def _submit(self, answer: Callable[[], _Answer | None]) -> None:
        if self._executor is None:
            self._take(answer())
        else:
            self._due = answer

    def _collect(self) -> None:
        if self._pending is not None and self._pending.done():
            self._take(self._pending.result())
            self._pending = None

    def _take(self, answer: _Answer | None) -> None:
        if answer is None or answer.run != self._clock.run:
            # Of a run that is over.
            return
        risk, clock = answer.risk, self._clock
        since = _MEMORY if self._latest is None else (risk.stamp - self._latest.stamp) / _SECOND
        kept = math.exp(-max(since, 0.0) / _MEMORY)
        harmed = np.count_nonzero(risk.outcomes.kind)
        if self._latest is not None and self._latest.lacks_path and not risk.lacks_path:
            self._evidence, self._speeds = Evidence(), Sizes()
        if risk.shaking is not None:
            self._shaking = answer.loop, risk.shaking
        if clock.first_speeds[0] < 0.0:
            first = risk.outcomes.first_linear_speed, risk.outcomes.first_angular_speed
            clock.first_speeds = (float(np.median(first[0])), float(np.median(first[1])))
        probability = self._evidence.add(harmed, len(risk.outcomes.kind), kept)
        demand = self._speeds.add(risk.outcomes.demand, kept, DEMAND_SHARE)
        self._latest = dataclasses.replace(risk, probability=probability, demand=demand)


@dataclass(frozen=True, eq=False)
class _Answer:
    """What a roll-out found, for the run that it was asked for and the loop that was rolled out."""

    run: int
    loop: object
    risk: Risk


def _law_in_force(parameters: MonitorParameters, stated: tuple[str, float] | None) -> RolloutLaw:
    """Return the law of some parameters, with name and lambda [1/s] as the controller states them, if it does."""
    law = RolloutLaw.of_parameters(parameters)
    if stated is None:
        return law
    if stated[0] != law.law:
        law = RolloutLaw.of_parameters(dataclasses.replace(parameters, law=stated[0]))
    return dataclasses.replace(law, gain=stated[1], gain_slope=0.0)


def _frame_period(stamps: Sequence[int]) -> float:
    """Return the time between two of the latest frames [s]."""
    steps = np.diff(stamps)
    return float(np.clip(np.median(steps) / _SECOND, 1e-3, 1.0)) if len(steps) else FRAME_PERIOD
