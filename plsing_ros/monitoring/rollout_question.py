# SPDX-License-Identifier: Apache-2.0
"""A question to roll-outs of the closed loop, from where the camera may be, and their answer."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.geometry import Pose
from plsing_ros.monitoring.law_check import LawCheck, compute_law_twist
from plsing_ros.monitoring.map_residuals import MapResiduals
from plsing_ros.monitoring.risk import Risk
from plsing_ros.monitoring.rollout_setup import FIRST_STEPS, FRAME_PERIOD, MAX_STEPS, roll_out_around, rollout_task
from plsing_ros.monitoring.run_memory import RunMemory
from plsing_ros.monitoring.segment_ends import SegmentEnds
from plsing_ros.monitoring.shaking import expected_shaking
from plsing_ros.parameters import ControllerParameters, MonitorParameters
from plsing_ros.planning.rollout import RolloutLaw, RunState
from plsing_ros.singularities import SingularSet

_SECOND = 1_000_000_000
# A path ends this near the target it leads to [m], [rad].
_SAME_TARGET = 0.05


@dataclass(frozen=True, eq=False)
class RolloutAnswer:
    """What roll-outs found.

    Attributes:
        run: Number of the run that they were asked for.
        loop: That was rolled out, to be compared.
        law: Which was.
        risk: What they say, together with those before.
        is_other: Whether the commanded twists are not those of the law.
    """

    run: int
    loop: object
    law: RolloutLaw
    risk: Risk
    is_other: bool


@dataclass(frozen=True, eq=False)
class RolloutQuestion:
    """What is asked at some features: only what the next ones change is taken down, the rest is left to the answer.

    Attributes:
        stamp: Of the features [ns].
        pose: T_world_camera.
        covariance: Of that pose in the world's axes, (position, rotation), shape (6, 6), or None.
        observation: The features.
        used: Those of them that the law goes by.
        singular: The scene.
        target: T_world_camera where the camera is to go.
        run: Number of the run.
        state: How far the run is; its deadline is that of the law.
        is_first: Whether the controller may be waiting for the answer.
        stated: Law and lambda [1/s] as the controller states them, or None.
        stamps: Of the latest frames [ns].
        path: T_world_camera along the path that is followed; empty: none is known.
        shaking: A loop and how far noise drives the camera at its target [m], as far as it is known.
        segments: Ends of the segments that were seen, or None.
        residuals: Of the map, or None.
        check: Compares the commanded twists with the law's.
        parameters: In force.
        seed: Of all noise.
        memory: Of the run's answers, to which this one is added.
    """

    stamp: int
    pose: Pose
    covariance: Array | None
    observation: LineObservation
    used: LineObservation
    singular: SingularSet
    target: Pose
    run: int
    state: RunState
    is_first: bool
    stated: tuple[str, float] | None
    stamps: Sequence[int]
    path: tuple[Pose, ...]
    shaking: tuple[object, float] | None
    segments: SegmentEnds | None
    residuals: MapResiduals | None
    check: LawCheck
    parameters: MonitorParameters
    seed: int
    memory: RunMemory

    def answer(self) -> RolloutAnswer | None:
        """Roll out the loop; None where the numbers do not make a task."""
        try:
            return self._answer()
        except PlsingError:
            return None

    def _answer(self) -> RolloutAnswer:
        parameters, pose, observation, target = self.parameters, self.pose, self.observation, self.target
        if self.segments is not None:
            self.segments.add(pose, observation)
        law = law_in_force(parameters, self.stated)
        state = dataclasses.replace(self.state, deadline=law.deadline)
        steps = FIRST_STEPS if self.is_first else MAX_STEPS
        ends = None if self.segments is None else self.segments.ends()
        period = _frame_period(self.stamps)
        task = rollout_task(self.singular, target, law, parameters, period, self.used, steps, ends)
        # A path that leads elsewhere is that of another target.
        leads_there = bool(self.path) and self.path[-1].is_close(target, _SAME_TARGET)
        path = self.path if leads_there and law.law == "detour" else ()
        lacks_path = law.law == "detour" and not path and not np.any(state.command)
        # As long as the loop is the same the target is held as well as it was; the first answer does not wait for that.
        loop = (law, target, parameters, self.singular)
        shaking = self.shaking[1] if self.shaking is not None and self.shaking[0] == loop else None
        is_known = not (parameters.latency or parameters.integral_gain or any(parameters.secondary_twist))
        begins = is_known and state.first_linear_speed < 0.0
        residuals = None if self.residuals is None else self.residuals.rows()
        seen_task = dataclasses.replace(task, residuals=residuals, T_world_camera=pose, path=path)
        # The first command is what demand is measured by: it is known as soon as its features are.
        first = compute_law_twist(task, pose, self.used) if begins else None
        if first is not None and observation.verdict is LinesVerdict.POOR:
            first = ControllerParameters.slow_scale * first
        state = dataclasses.replace(state, answer=first)
        outcomes = roll_out_around(seen_task, pose, self.covariance, parameters.samples, state, self.seed)
        if shaking is None and not self.is_first:
            shaking = expected_shaking(task, parameters.samples, self.seed, MAX_STEPS)
        is_other = is_known and self.check.is_other(task)
        # Counted here, in the thread of the roll-outs, and not in a cycle.
        risk = self.memory.risk(self.stamp, outcomes, shaking, lacks_path)
        return RolloutAnswer(self.run, loop, law, risk, is_other)


def law_in_force(parameters: MonitorParameters, stated: tuple[str, float] | None) -> RolloutLaw:
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
