# SPDX-License-Identifier: Apache-2.0
"""Servo runs under the errors of real cameras, robots and maps, with the monitor watching; and what could be known."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from benchmark.alert_settings import (
    Setting,
    controller_parameters,
    draw_setting,
    estimator_parameters,
    monitor_parameters,
    with_other_errors,
)
from benchmark.servo_conditions import HALF_VIEW, ROBOT_LIMITS, DisturbedCamera, view_of
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.risk import Risk
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.planning.detour import Plan
from plsing_ros.planning.rollout import Harm, RolloutLaw
from plsing_ros.pose import Verdict
from plsing_ros.pose.pose_tracker import PoseTracker

_SECOND = 1_000_000_000
_ARRIVED, _ARRIVED_ANGLE, _ARRIVED_TIME = 0.05, math.radians(2.0), 1.0
_SOFT_START = 1.0  # [s]
_TRUE_RUNS = 6
# Between two looks at the margin of visibility [s].
_VISIBILITY_PERIOD = 0.05
# A speed that a limit has scaled is that limit but for rounding.
_ROUNDING = 1.0 + 1e-9
# As the node publishes a path.
_PATH_POSES = 100
_ALERTS = (Level.WARN, Level.CRITICAL)


class _Sight(NamedTuple):
    """What controller and monitor hear of a frame.

    Attributes:
        observation: Image lines, with 3-D lines where a pose is known.
        T_world_camera: The pose on camera_pose, or None if none comes.
        covariance: Of that pose, in the scene's axes, shape (6, 6).
    """

    observation: LineObservation
    T_world_camera: Pose | None
    covariance: np.ndarray | None


@dataclass
class Record:
    """What came of a run; plain numbers, so that it can be kept as a line of JSON.

    Attributes:
        condition, seed, number: Which run it is.
        kind, law, gain, rate, limited, soft, chain: Of its Setting.
        harm: What kind, a value of Harm.
        harm_time: From the start [s]; the end of the run without harm.
        demand_time: When a demand was commanded first [s], or None.
        first_command: When a motion was commanded first [s]; 0 if none was.
        first_alert: When the level was WARN or CRITICAL first [s], or None.
        alert_share: Share of the run's frames with an alert.
        alerts: What called for the first alert, and why.
        answers: (time, share of this answer's samples that come to harm, probability said, demand said) of each
            roll-out.
        scores: Of each simpler detector: (time, score) where it rose to a new maximum.
        changes: Of the level.
        frames: In all.
        true_share: Share of other runs of the same task that come to harm, or None.
    """

    condition: str
    seed: int
    number: int
    kind: str
    law: str
    gain: float
    rate: float
    limited: bool
    soft: bool
    chain: bool
    harm: int = 0
    harm_time: float = 0.0
    demand_time: float | None = None
    first_command: float = 0.0
    first_alert: float | None = None
    alert_share: float = 0.0
    alerts: str = ""
    answers: list[tuple[float, float, float, float]] = field(default_factory=list)
    scores: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    changes: int = 0
    frames: int = 0
    true_share: float | None = None

    def line(self) -> str:
        """Return it as a line of JSON, with four digits."""
        return json.dumps(_rounded(dataclasses.asdict(self)))

    @classmethod
    def from_line(cls, line: str) -> Record:
        """Return the record of a line."""
        return cls(**json.loads(line))


def record_of(condition: str, seed: int, true_every: int, number: int) -> Record:
    """Make run `number` of a seed, with the monitor watching.

    In harsh conditions, of every true_every-th run (0: none) six more are made without it, with other errors of camera,
    pose, map and focal length: what can be known by whoever knows the conditions, and the map as it is given.
    """
    setting = draw_setting(condition, seed, number)
    record = watched_run(setting, condition, seed, number)
    if condition == "harsh" and true_every and number % true_every == 0:
        others = [_AlertRun(with_other_errors(setting, i), setting.seed + 1 + i).unwatched() for i in range(_TRUE_RUNS)]
        record.true_share = sum(each is not Harm.NONE for each in others) / _TRUE_RUNS
    return record


def watched_run(setting: Setting, condition: str, seed: int, number: int) -> Record:
    """Make one run with the monitor watching."""
    return _AlertRun(
        setting,
        setting.seed,
        Record(
            condition,
            seed,
            number,
            setting.kind,
            setting.law,
            setting.task.gain,
            setting.rate,
            setting.limited,
            setting.soft,
            setting.chain,
        ),
    ).watched()


class _AlertRun:
    """One task from its start to arrival, harm or the deadline."""

    def __init__(self, setting: Setting, seed: int, record: Record | None = None) -> None:
        self._setting, self._record = setting, record
        self._rng = np.random.default_rng(seed)
        self._camera = DisturbedCamera(setting.task, setting.condition, self._rng)
        self._controller = ServoController.from_parameters(controller_parameters(setting))
        self._monitor = None if record is None else SingularityMonitor.from_parameters(monitor_parameters(setting))
        self._tracker = PoseTracker(estimator_parameters(setting)) if setting.chain else None
        self._period = 1.0 / setting.rate
        self._plan: Plan | None = None
        self._pose = setting.task.start
        self._looked = -math.inf
        self._level = int(Level.OK)
        self._risk: Risk | None = None

    def watched(self) -> Record:
        """Run, and return what the monitor said."""
        record = self._record
        assert record is not None
        harm, time, frames = self._go()
        record.harm, record.harm_time, record.frames = int(harm), time, frames
        record.alert_share /= max(frames, 1)
        return record

    def unwatched(self) -> Harm:
        """Run, and return what came of it."""
        return self._go()[0]

    def _go(self) -> tuple[Harm, float, int]:
        setting, period, task = self._setting, self._period, self._setting.task
        condition = setting.condition
        commands, carried_out = [np.zeros(6)], 0
        motion, asked, twist = np.zeros(6), np.zeros(6), np.zeros(6)
        deadline = RolloutLaw.of_parameters(controller_parameters(setting)).deadline
        start_distance = _distance(task.start, task.target)[0]
        away = max(1.5 * start_distance, start_distance + 0.05)
        first, arrived_since, frame = None, None, 0
        while True:
            time = frame * period
            distance, angle = _distance(self._pose, task.target)
            if distance > away:
                return Harm.AWAY, time, frame
            if np.count_nonzero(view_of(task.ends, self._pose)[1]) < 3:
                return Harm.FEW_LINES, time, frame
            if time >= deadline:
                return Harm.LATE, time, frame
            arrived = distance <= _ARRIVED and angle <= _ARRIVED_ANGLE
            arrived_since = None if not arrived else time if arrived_since is None else arrived_since
            if arrived_since is not None and time - arrived_since >= _ARRIVED_TIME:
                return Harm.NONE, time, frame
            if self._rng.random() >= condition.dropped:
                asked, twist = self._cycle(time)
            speeds = float(np.linalg.norm(asked[:3])), float(np.linalg.norm(asked[3:]))
            if first is None and max(speeds) > 0.0:
                first = speeds
                if self._record is not None:
                    self._record.first_command = time
            if first is not None and self._record is not None and self._record.demand_time is None:
                limits = [max(limit, 1.5 * f) for limit, f in zip(ROBOT_LIMITS, first, strict=True)]
                over = [speed > _ROUNDING * limit for speed, limit in zip(speeds, limits, strict=True)]
                self._record.demand_time = time if any(over) else None
            commands.append(twist)
            late = condition.latency + (self._rng.random() < condition.jitter)
            carried_out = max(carried_out, len(commands) - 1 - late)
            motion = self._move(commands[carried_out], motion)
            frame += 1

    def _cycle(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what the law asks for and what is commanded in one frame; the monitor is asked before."""
        stamp = _SECOND + round(time * _SECOND)
        sight = self._sight(stamp)
        if self._monitor is not None:
            self._note(self._assessment(sight, stamp), time)
        try:
            command = self._controller.answer(sight.observation, stamp, stamp)
        except PlsingError as error:
            command = self._controller.halt(str(error))
        if self._monitor is not None and self._controller.plan is not self._plan:
            self._plan = self._controller.plan
            path = None if self._plan is None else self._plan.path
            self._monitor.receive_path(() if path is None else path.sampled(_PATH_POSES))
        asked = command.twist
        twist = asked * (min(time / _SOFT_START, 1.0) if self._setting.soft else 1.0)
        if self._tracker is not None:
            self._tracker.receive_twist(twist, stamp)
        if self._monitor is not None and self._record is not None:
            self._monitor.receive_twist(twist, stamp)
            self._score("commanded speed", time, float(np.linalg.norm(twist[:3])))
            if time - self._looked >= _VISIBILITY_PERIOD:
                self._looked = time
                self._score("visibility margin (CBF)", time, self._visibility(twist))
        return asked, twist

    def _assessment(self, sight: _Sight, stamp: int) -> Assessment | None:
        monitor = self._monitor
        assert monitor is not None
        try:
            if sight.T_world_camera is not None:
                monitor.receive_pose(sight.T_world_camera, stamp, sight.covariance)
            return monitor.answer(sight.observation, stamp, stamp)
        except PlsingError as error:
            return monitor.unusable(str(error), stamp)

    def _note(self, assessment: Assessment | None, time: float) -> None:
        record = self._record
        assert record is not None
        if assessment is None:
            # What was said last still holds.
            record.alert_share += self._level in _ALERTS
            return
        level = int(assessment.level)
        record.changes += bool(record.frames) and level != self._level
        record.frames += 1
        self._level = level
        if assessment.level in _ALERTS:
            record.alert_share += 1.0
            if record.first_alert is None:
                record.first_alert, record.alerts = time, assessment.kind
        risk = assessment.risk
        if risk is not None and risk is not self._risk:
            self._risk = risk
            record.answers.append((time, risk.outcomes.risk, risk.probability, risk.demand))
        if assessment.conditioning is not None:
            here, target = assessment.conditioning.inverse_condition_number, assessment.target_inverse_condition_number
            self._score("1 / cond", time, -here)
            if target:
                self._score("relative 1 / cond", time, -here / target)

    def _score(self, name: str, time: float, score: float) -> None:
        assert self._record is not None
        noted = self._record.scores.setdefault(name, [])
        if math.isfinite(score) and (not noted or score > noted[-1][1]):
            noted.append((time, score))

    def _sight(self, stamp: int) -> _Sight:
        lines, covariances, seen = self._camera.image(self._pose)
        if self._setting.missing > 0.0:
            seen = seen & (self._rng.random(len(seen)) >= self._setting.missing)
        if self._tracker is None:
            frame = self._camera.completed(lines, covariances, seen, *self._camera.pose(self._pose))
            R = np.kron(np.eye(2), frame.T_world_camera.rotation)
            return _Sight(frame.observation, frame.T_world_camera, R @ frame.covariance @ R.T)
        image = LineObservation(self._setting.task.map.ids, lines * seen[:, np.newaxis], seen, covariances=covariances)
        tracked = self._tracker.track(image, stamp, stamp)
        estimate = tracked.estimate
        # As pose_estimator publishes them.
        is_published = estimate.verdict is not Verdict.AMBIGUOUS
        pose = estimate.T_world_camera if is_published else None
        return _Sight(tracked.completed or image, pose, None if pose is None else estimate.covariance)

    def _visibility(self, motion: np.ndarray) -> float:
        """Return how much the barrier condition h' + h / 1 s >= 0 is violated; h is the third largest margin."""
        later = self._pose.integrate(motion, self._period)
        now, then = (_third_margin(self._setting.task.ends, pose) for pose in (self._pose, later))
        return -((then - now) / self._period + now)

    def _move(self, asked: np.ndarray, motion: np.ndarray) -> np.ndarray:
        condition, period = self._setting.condition, self._period
        if condition.limited:
            speeds = np.linalg.norm(asked.reshape(2, 3), axis=1)
            asked = asked * min(1.0, *(np.array(ROBOT_LIMITS) / np.maximum(speeds, 1e-12)))
        mean = asked
        if condition.lag:
            left = math.exp(-period / condition.lag)
            mean = asked + (condition.lag * (1.0 - left) / period) * (motion - asked)
            motion = asked + left * (motion - asked)
        speed = float(np.abs(mean).max())
        self._pose = self._pose.integrate(mean * min(1.0, 1e6 / max(speed, 1e-12)), period)
        return motion


def _third_margin(ends: np.ndarray, pose: Pose) -> float:
    """Return the margin of the third best line: how far its nearer visible end is inside of the image border."""
    points, seen = view_of(ends, pose)
    inside = np.sort(np.where(seen, HALF_VIEW - np.abs(points).max(axis=2).min(axis=1), -1.0))
    return float(inside[-3])


def _distance(pose: Pose, target: Pose) -> tuple[float, float]:
    cosine = 0.5 * (float(np.vdot(pose.rotation, target.rotation)) - 1.0)
    return float(np.linalg.norm(pose.translation - target.translation)), math.acos(min(max(cosine, -1.0), 1.0))


def _rounded(value: object) -> object:
    if isinstance(value, float):
        return float(f"{value:.4g}")
    if isinstance(value, dict):
        return {name: _rounded(each) for name, each in value.items()}
    return [_rounded(each) for each in value] if isinstance(value, list | tuple) else value
