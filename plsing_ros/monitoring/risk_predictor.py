# SPDX-License-Identifier: Apache-2.0
"""What is known of a run at each of its features, by roll-outs that are asked for again and again."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from concurrent.futures import Executor, Future

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.features.certain_lines import CertainLines
from plsing_ros.geometry import Pose
from plsing_ros.monitoring.law_check import LawCheck
from plsing_ros.monitoring.map_residuals import MapResiduals
from plsing_ros.monitoring.pose_drift import may_stray
from plsing_ros.monitoring.risk import Risk
from plsing_ros.monitoring.rollout_question import RolloutAnswer, RolloutQuestion, law_in_force
from plsing_ros.monitoring.run_clock import RunClock
from plsing_ros.monitoring.run_memory import RunMemory
from plsing_ros.monitoring.segment_ends import SegmentEnds
from plsing_ros.parameters import MonitorParameters
from plsing_ros.parameters.law import STRAIGHT_LAWS
from plsing_ros.planning.rollout import RolloutLaw, RunState
from plsing_ros.singularities import SingularSet

_SECOND = 1_000_000_000
# A command for features older than this is no longer carried out [ns].
_REST = _SECOND
# An answer counts until the next ones are overdue by this factor of their period.
_OVERDUE = 10.0


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
        self._answer: RolloutAnswer | None = None
        self._due: RolloutQuestion | None = None
        self._pending: Future[RolloutAnswer | None] | None = None
        self._asked: int | None = None
        self._run, self._memory, self._deviation = 0, RunMemory(), 0.0
        self._stamps: list[int] = []
        self._law_check, self._certain = LawCheck(), CertainLines()
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
        answer = self._answer
        return answer.law.law if answer is not None and answer.is_other else ""

    @property
    def seen_ends(self) -> Array | None:
        """Where the segments end by what was seen of them, in the scene frame, shape (n, 2, 3) [m], if anything was."""
        return None if self._segments is None else self._segments.ends()

    def may_stray(self, observation: LineObservation, parameters: MonitorParameters) -> bool:
        """Return whether the latest features are of a POOR pose that a path is followed by, and that may mislead it."""
        law, gain = self._stated or (parameters.law, parameters.gain)
        if law != "detour" or observation.verdict is not LinesVerdict.POOR:
            return False
        return may_stray(self._deviation, gain, min(self._clock.start_distance, self._clock.distance))

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
        used = observation
        law = parameters.law if self._stated is None else self._stated[0]
        if law not in STRAIGHT_LAWS:
            used = self._certain.of_observation(observation, parameters.columns)
        self._law_check.receive_frame(stamp, pose, used)
        if parameters.map_noise > 0.0 or parameters.focal_error > 0.0:
            if self._residuals is None:
                self._residuals = MapResiduals(singular.lines)
            self._residuals.add(observation)
        period = round(parameters.prediction_period * _SECOND)
        due = self._asked is None or not 0 <= stamp - self._asked < period
        deviation = 0.0 if covariance is None else math.sqrt(sum(covariance.ravel().tolist()[:15:7]))
        elapsed = self._clock.update(stamp, pose, T_world_target, parameters.degrees_of_freedom, deviation)
        self._deviation = deviation
        if due and not self.is_awaited:
            if self._run != self._clock.run:
                self._run, self._memory = self._clock.run, RunMemory()
            self._asked = stamp
            if observation.ends is not None:
                self._segments = self._segments or SegmentEnds(singular.lines)
            self._submit(
                self._question(
                    stamp, pose, covariance, observation, used, singular, T_world_target, elapsed, parameters
                )
            )
            self._collect()
        latest = self._latest
        if latest is None or self.other_law or not 0 <= stamp - latest.stamp <= _OVERDUE * period:
            return None
        return latest

    def _question(
        self,
        stamp: int,
        pose: Pose,
        covariance: Array | None,
        observation: LineObservation,
        used: LineObservation,
        singular: SingularSet,
        target: Pose,
        elapsed: float,
        parameters: MonitorParameters,
    ) -> RolloutQuestion:
        clock, self._seed = self._clock, self._seed + 1
        still = np.zeros(6)
        command = self._commands[-1][1] if self._commands and stamp - self._commands[-1][0] < _REST else still
        state = RunState(
            math.inf, clock.start_distance, elapsed, *clock.first_speeds, command, command, clock.arrived_for
        )
        return RolloutQuestion(
            stamp,
            pose,
            covariance,
            observation,
            used,
            singular,
            target,
            clock.run,
            state,
            self._answer is None,
            self._stated,
            self._stamps,
            self._path,
            self._shaking,
            self._segments,
            self._residuals,
            self._law_check,
            parameters,
            self._seed,
            self._memory,
        )

    def law(self, parameters: MonitorParameters) -> RolloutLaw:
        """Return the law in force: as the controller states it, with the parameters given here."""
        return law_in_force(parameters, self._stated)

    def begin_rollout(self) -> None:
        """Hand over the roll-out that is due, if any, to the executor."""
        question, self._due = self._due, None
        if question is not None and self._executor is not None:
            # An executor that is shut down takes nothing any more: the node is about to end.
            with contextlib.suppress(RuntimeError):
                self._pending = self._executor.submit(question.answer)

    def _submit(self, question: RolloutQuestion) -> None:
        if self._executor is None:
            self._take(question.answer())
        else:
            self._due = question

    def _collect(self) -> None:
        if self._pending is not None and self._pending.done():
            self._take(self._pending.result())
            self._pending = None

    def _take(self, answer: RolloutAnswer | None) -> None:
        clock = self._clock
        if answer is None or answer.run != clock.run:
            # Of a run that is over.
            return
        risk = answer.risk
        if risk.shaking is not None:
            self._shaking = answer.loop, risk.shaking
        if clock.first_speeds[0] < 0.0:
            first = risk.outcomes.first_linear_speed, risk.outcomes.first_angular_speed
            clock.first_speeds = (float(np.median(first[0])), float(np.median(first[1])))
        self._answer, self._latest = answer, risk
