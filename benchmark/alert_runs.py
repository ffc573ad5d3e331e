# SPDX-License-Identifier: Apache-2.0
"""Servo runs under the errors of real cameras, robots and maps, with the monitor watching; and what could be known."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from benchmark.servo_conditions import (
    CONDITIONS,
    FOCAL_LENGTH,
    HALF_VIEW,
    ROBOT_LIMITS,
    Camera,
    Condition,
    Frame,
    ServoTask,
    draw_task,
    view_of,
)
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.rollout import Harm, LoopModel, RolloutLaw, RolloutTask, RunState
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters import ControllerParameters, MonitorParameters, PoseEstimatorParameters
from plsing_ros.pose.pose_tracker import PoseTracker

LAWS = ("pinv", "pinv", "dls", "adaptive_dls", "guarded", "detour", "position", "fused")
_SECOND = 1_000_000_000
_NEAREST, _SHORTEST = 0.1, 20.0 / FOCAL_LENGTH
_ARRIVED, _ARRIVED_ANGLE, _ARRIVED_TIME = 0.05, math.radians(2.0), 1.0
_SOFT_START = 1.0  # [s]
_TRUE_ROLLOUTS = 6
# The law's own limits, and none.
_LIMITS = {True: ROBOT_LIMITS, False: (0.0, 0.0)}


@dataclass(frozen=True, eq=False)
class Setting:
    """One run to be made.

    Attributes:
        condition: What is wrong.
        task: Scene, start and target.
        kind: "any", "crossing", "at a singularity" (from time 0 on) or "pure rotation".
        law: Of the controller.
        rate: Of the frames [Hz].
        limited: Whether the controller has its limits on.
        soft: Whether its speed rises over the first second.
        chain: Whether 3-D lines and pose come from pose_estimator.
        seed: Of all noise.
    """

    condition: Condition
    task: ServoTask
    kind: str
    law: str
    rate: float
    limited: bool
    soft: bool
    chain: bool
    seed: int


@dataclass(frozen=True, eq=False)
class Record:
    """What came of a run.

    Attributes:
        setting: Of it, without its arrays.
        harm: What kind.
        harm_time: From the start [s]; the end of the run without harm.
        demand_time: When a demand was commanded first [s], or None.
        alerts: Times at which the level was WARN or CRITICAL [s], and the first one of a demand or risk alert.
        share: Of the run's time with an alert.
        answers: (time, risk) at the first answer and once a second.
        scores: Of each detector: (time, score) where it rose to a new maximum.
        changes: Of the level.
        frames: In all.
    """

    kind: str
    law: str
    gain: float
    limited: bool
    soft: bool
    chain: bool
    harm: Harm
    harm_time: float
    demand_time: float | None
    first_alert: float | None
    share: float
    answers: list[tuple[float, float]]
    scores: dict[str, list[tuple[float, float]]]
    changes: int
    frames: int


def draw_setting(condition: str, seed: int, number: int) -> Setting:
    """Return run `number` of a seed."""
    generator = np.random.default_rng([seed, number])
    found = CONDITIONS[condition]
    if condition == "lab":
        found = replace(found, limited=False)
    kind = ("any", "crossing", "any", "crossing", "crossing", "pure rotation", "any", "at a singularity")[number % 8]
    task = draw_task(generator, found, crossing=kind in ("crossing", "at a singularity"))
    if kind == "pure rotation":
        turn = Rotation.from_rotvec(generator.normal(scale=0.2, size=3)).as_matrix()
        start = Pose(task.target.rotation @ turn, task.target.translation)
        if np.count_nonzero(view_of(task.ends, start)[1]) >= 4:
            task = replace(task, start=start)
    if kind == "at a singularity":
        task = replace(task, start=_on_transversal(task))
    law = LAWS[int(generator.integers(len(LAWS)))]
    return Setting(
        found,
        task,
        kind,
        law,
        float(np.exp(generator.uniform(math.log(10.0), math.log(100.0)))),
        bool(generator.random() < 0.5),
        bool(generator.random() < 0.25),
        bool(generator.random() < 0.25),
        int(generator.integers(2**31)),
    )


def run(setting: Setting) -> Record:
    """Run the loop to harm or arrival, or to the deadline, and let the monitor watch."""
    return _Run(setting).record()


class _Run:
    def __init__(self, setting: Setting) -> None:
        self._setting, task, condition = setting, setting.task, setting.condition
        self._rng = np.random.default_rng(setting.seed)
        self._camera = Camera(task, condition, self._rng)
        self._controller = ServoController.from_parameters(_controller_parameters(setting))
        self._monitor = SingularityMonitor.from_parameters(_monitor_parameters(setting))
        self._tracker = PoseTracker(_estimator_parameters(setting)) if setting.chain else None
        self._period = 1.0 / setting.rate
        self._known = task.target
        self._pose = task.start
        self._scores: dict[str, list[tuple[float, float]]] = {}

    def record(self) -> Record:
        setting, period = self._setting, self._period
        task, condition, limits = setting.task, setting.condition, ROBOT_LIMITS
        commands, carried_out = [np.zeros(6)], 0
        motion, asked, twist = np.zeros(6), np.zeros(6), np.zeros(6)
        law = RolloutLaw.of_parameters(_controller_parameters(setting))
        start_distance = _distance(task.start, task.target)[0]
        away = max(1.5 * start_distance, start_distance + 0.05)
        harm, first, demand_time, first_alert, arrived_since = Harm.NONE, None, None, None, None
        alerting, changes, level, answers, answered = 0, 0, None, [], -math.inf
        self._note("true roll-outs", 0.0, _true_risk(setting))
        frame = 0
        while True:
            time = frame * period
            distance, angle = _distance(self._pose, task.target)
            seen = np.count_nonzero(view_of(task.ends, self._pose)[1])
            if distance > away:
                harm = Harm.AWAY
            elif seen < 3:
                harm = Harm.FEW_LINES
            elif time >= law.deadline:
                harm = Harm.LATE
            if harm is not Harm.NONE:
                break
            arrived = distance <= _ARRIVED and angle <= _ARRIVED_ANGLE
            arrived_since = None if not arrived else time if arrived_since is None else arrived_since
            if arrived_since is not None and time - arrived_since >= _ARRIVED_TIME:
                break
            stamp = _SECOND + round(time * _SECOND)
            if self._rng.random() >= condition.dropped:
                assessment, asked, twist = self._cycle(stamp, time)
                if assessment is not None:
                    changes += level is not None and assessment.level is not level
                    level = assessment.level
                    if assessment.risk is not None:
                        self._note("risk", time, assessment.risk.probability)
                        self._note("demand", time, assessment.risk.demand)
                        if time - answered >= 1.0:
                            answered = time
                            answers.append((time, assessment.risk.probability))
                alerting += level in (Level.WARN, Level.CRITICAL)
                if level in (Level.WARN, Level.CRITICAL) and first_alert is None:
                    first_alert = time
            speeds = float(np.linalg.norm(asked[:3])), float(np.linalg.norm(asked[3:]))
            if first is None and max(speeds) > 0.0:
                first = speeds
            if first is not None and demand_time is None:
                over = [s > max(limit, 1.5 * f) for s, limit, f in zip(speeds, limits, first, strict=True)]
                demand_time = time if any(over) else None
            commands.append(twist)
            late = condition.latency + (self._rng.random() < condition.jitter)
            carried_out = max(carried_out, len(commands) - 1 - late)
            motion = self._move(commands[carried_out], motion)
            frame += 1
        return Record(
            setting.kind,
            setting.law,
            task.gain,
            setting.limited,
            setting.soft,
            setting.chain,
            harm,
            time,
            demand_time,
            first_alert,
            alerting / max(frame, 1),
            answers,
            self._scores,
            changes,
            frame,
        )

    def _cycle(self, stamp: int, time: float) -> tuple[Assessment | None, np.ndarray, np.ndarray]:
        """Return the assessment, and what the law asks for and what is commanded in one frame."""
        frame = self._frame(stamp)
        if frame is None:
            return self._monitor.unusable("no pose", stamp), np.zeros(6), np.zeros(6)
        try:
            R = frame.T_world_camera.rotation
            covariance = np.kron(np.eye(2), R) @ frame.covariance @ np.kron(np.eye(2), R).T
            self._monitor.receive_pose(frame.T_world_camera, stamp, covariance)
            assessment = self._monitor.answer(frame.observation, stamp, stamp)
        except PlsingError as error:
            assessment = self._monitor.unusable(str(error), stamp)
        try:
            asked = self._controller.answer(frame.observation, stamp, stamp).twist
        except PlsingError as error:
            asked = self._controller.halt(str(error)).twist
        twist = asked * (min(time / _SOFT_START, 1.0) if self._setting.soft else 1.0)
        self._monitor.receive_twist(twist, stamp)
        if assessment is not None and assessment.conditioning is not None:
            self._note("1 / cond", time, -assessment.conditioning.inverse_condition_number)
            target = assessment.target_inverse_condition_number
            if target:
                self._note("relative 1 / cond", time, -assessment.conditioning.inverse_condition_number / target)
            self._note("commanded speed", time, float(np.linalg.norm(twist[:3])))
        self._note("visibility margin (CBF)", time, self._visibility(motion=twist))
        return assessment, asked, twist

    def _frame(self, stamp: int) -> Frame | None:
        lines, covariances, seen = self._camera.image(self._pose)
        pose, covariance = self._camera.pose(self._pose)
        if self._tracker is None:
            return self._camera.completed(lines, covariances, seen, pose, covariance)
        image = LineObservation(self._setting.task.map.ids, lines * seen[:, np.newaxis], seen, None)
        tracked = self._tracker.track(image, stamp, stamp)
        if tracked.completed is None or tracked.estimate.T_world_camera is None:
            return None
        given = dataclasses.replace(tracked.completed, verdict=LinesVerdict.GIVEN, verdict_reason="")
        R = np.kron(np.eye(2), tracked.estimate.T_world_camera.rotation)
        covariance = R.T @ tracked.estimate.covariance @ R
        return Frame(given, covariances[seen], tracked.estimate.T_world_camera, covariance)

    def _visibility(self, motion: np.ndarray) -> float:
        """Return how much the barrier condition h' + h / 1 s >= 0 is violated; h is the third largest margin."""
        later = self._pose.integrate(motion, self._period)
        now, then = (_third_margin(self._setting.task.ends, pose) for pose in (self._pose, later))
        return -((then - now) / self._period + now)

    def _note(self, name: str, time: float, score: float) -> None:
        noted = self._scores.setdefault(name, [])
        if math.isfinite(score) and (not noted or score > noted[-1][1]):
            noted.append((time, score))

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


def _jitter(condition: Condition) -> float:
    """Return the standard deviation [frames] of which that share is later by a frame or more."""
    return 0.5 / float(norm.ppf(1.0 - 0.5 * condition.jitter)) if condition.jitter else 0.0


def _third_margin(ends: np.ndarray, pose: Pose) -> float:
    """Return the margin of the third best line: how far its nearer visible end is inside of the image border."""
    points, seen = view_of(ends, pose)
    inside = np.sort(np.where(seen, HALF_VIEW - np.abs(points).max(axis=2).min(axis=1), -1.0))
    return float(inside[-3])


def _distance(pose: Pose, target: Pose) -> tuple[float, float]:
    cosine = 0.5 * (float(np.vdot(pose.rotation, target.rotation)) - 1.0)
    return float(np.linalg.norm(pose.translation - target.translation)), math.acos(min(max(cosine, -1.0), 1.0))


def _on_transversal(task: ServoTask) -> Pose:
    """Return the start moved onto the line that all observed lines meet, where it is nearest."""
    # All lines meet the axis: its Plücker vector is the null vector of the reciprocal product with them.
    lines = task.map
    null = np.linalg.svd(np.hstack([lines.moment, lines.direction]))[2][-1]
    direction, moment = null[:3], null[3:]
    size = np.linalg.norm(direction)
    direction, point = direction / size, np.cross(direction, moment) / size**2
    offset = task.start.translation - point
    return Pose(task.start.rotation, point + direction * (direction @ offset))


def _scene_parameters(setting: Setting) -> dict[str, object]:
    lines, target = setting.task.map, setting.task.target
    return {
        "lines_points": tuple(lines.pivot.ravel()),
        "lines_directions": tuple(lines.direction.ravel()),
        "target_position": tuple(target.translation),
        "target_orientation": tuple(target.quaternion_xyzw),
    }


def _law_parameters(setting: Setting) -> dict[str, object]:
    linear, angular = _LIMITS[setting.limited]
    return {
        "law": setting.law,
        "gain": setting.task.gain,
        "max_linear_speed": linear,
        "max_angular_speed": angular,
    }


def _controller_parameters(setting: Setting) -> ControllerParameters:
    return ControllerParameters(**_scene_parameters(setting), **_law_parameters(setting), min_target_condition=0.0)


def _estimator_parameters(setting: Setting) -> PoseEstimatorParameters:
    scene = _scene_parameters(setting)
    return PoseEstimatorParameters(lines_points=scene["lines_points"], lines_directions=scene["lines_directions"])


def _monitor_parameters(setting: Setting) -> MonitorParameters:
    condition = setting.condition
    linear, angular = ROBOT_LIMITS
    return MonitorParameters(
        **_scene_parameters(setting),
        **_law_parameters(setting),
        target_known=True,
        frames_late=condition.latency,
        jitter=_jitter(condition),
        dropped_frames=condition.dropped,
        robot_lag=condition.lag,
        robot_linear_speed=linear,
        robot_angular_speed=angular,
        robot_clamps=condition.limited,
        image_noise=condition.pixels / FOCAL_LENGTH,
        half_view=(HALF_VIEW, HALF_VIEW),
        nearest=_NEAREST,
        shortest_image=_SHORTEST,
        focal_error=condition.focal_length - 1.0,
        map_noise=condition.map_shift,
        pose_position_noise=condition.position,
        pose_rotation_noise=condition.rotation,
        line_ends=tuple(setting.task.map_ends.ravel()),
    )


def _true_risk(setting: Setting) -> float:
    """Return the share of six roll-outs in the true conditions, from the true start, that come to harm."""
    task, condition = setting.task, setting.condition
    law = RolloutLaw.of_parameters(_controller_parameters(setting))
    linear, angular = ROBOT_LIMITS if condition.limited else (math.inf, math.inf)
    loop = LoopModel(
        period=1.0 / setting.rate,
        latency=condition.latency,
        jitter=_jitter(condition),
        lag=condition.lag,
        robot_linear_speed=linear,
        robot_angular_speed=angular,
        image_noise=condition.pixels / FOCAL_LENGTH,
        position_noise=condition.position,
        rotation_noise=condition.rotation,
        map_noise=condition.map_shift,
        focal_error=condition.focal_length - 1.0,
        dropped_frames=condition.dropped,
        half_view=(HALF_VIEW, HALF_VIEW),
        near=_NEAREST,
        min_length=_SHORTEST,
        horizon=law.deadline,
    )
    rollout = RolloutTask(task.map, task.target, law, loop, task.map_ends)
    state = RunState(law.deadline, _distance(task.start, task.target)[0])
    return rollout.roll_out([task.start] * _TRUE_ROLLOUTS, state, setting.seed).risk
