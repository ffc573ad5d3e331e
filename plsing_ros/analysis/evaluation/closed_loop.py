# SPDX-License-Identifier: Apache-2.0
"""One run of the whole loop without ROS: camera, pose estimator, controller, robot, with the monitor watching."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from plsing_ros.analysis.evaluation.setup import HARD, YOURS, Setup
from plsing_ros.arrays import Array
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import PlsingError
from plsing_ros.geometry import Pose
from plsing_ros.geometry.rotations import rotation_vector
from plsing_ros.levels import Level
from plsing_ros.monitoring.run_clock import distance_between
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.planning.rollout import Harm, RolloutLaw
from plsing_ros.pose import Verdict
from plsing_ros.pose.pose_tracker import PoseTracker
from plsing_ros.simulation.simulated_robot import SimulatedRobot

_SECOND = 1_000_000_000
# Within this of the target [m], [rad] for so long [s] a camera has arrived; it is left there for so many 1 / gain.
_ARRIVED, _ARRIVED_ANGLE, _ARRIVED_TIME = 0.05, math.radians(2.0), 1.0
_SETTLING = 3.0
# The end of a run over which its last error is averaged [s].
_LAST = 1.0
_MIN_LINES = 3
_ALERTS = (Level.WARN, Level.CRITICAL)
# A pose that is off by more than this many standard deviations is wrong.
_WRONG = 5.0
# Rows of a run that are kept for figures.
_KEPT = 40


@dataclass
class RunResult:
    """What came of a run; times from its start [s], plain numbers, so that JSON keeps it.

    Attributes:
        law, kind, number: Which run it is.
        harm: A value of Harm.
        time: Of the harm, or of the arrival.
        late: What the controller said most often while it did not move, if anything.
        demand: Largest commanded speed over the robot's limit, or over 1.5 times the first one if that is more.
        demand_time: When that was above 1 first, or None.
        first_alert: When the level was WARN or CRITICAL first, or None.
        alert: Why.
        alert_share: Share of the time with such a level.
        risk: The first answer of the roll-outs, or None.
        error: Distance from the target over the last second, root mean square [m].
        path: Length over the straight line.
        frames: All of them.
        poses: Of those, with a pose.
        wrong: Of those, off by more than 5 standard deviations, and not called AMBIGUOUS.
        nees: Mean normalised squared error of the poses: 6 if they are as exact as they say.
        trace: Rows (time, x, y, z, error of the pose [m], its standard deviation [m]), at most some tens.
    """

    law: str
    kind: str
    number: int
    harm: int = 0
    time: float = 0.0
    late: str = ""
    demand: float = 0.0
    demand_time: float | None = None
    first_alert: float | None = None
    alert: str = ""
    alert_share: float = 0.0
    risk: float | None = None
    error: float = 0.0
    path: float = 0.0
    frames: int = 0
    poses: int = 0
    wrong: int = 0
    nees: float = 0.0
    trace: list[list[float]] = field(default_factory=list)


@dataclass(frozen=True)
class RunTask:
    """A run to be made.

    Attributes:
        setup: The task.
        law: Of the controller.
        kind: YOURS or HARD.
        number: Of the run; runs of the same number begin alike and have the same noise, whatever the law.
        watched: Whether the monitor is there.
    """

    setup: Setup
    law: str
    kind: str
    number: int
    watched: bool


def simulate_run(task: RunTask) -> dict[str, Any]:
    """Make a run, to harm or a while after arrival; return a RunResult as a dictionary."""
    try:
        loop = _Loop(task)
    except PlsingError as error:
        # A law that refuses the task does not move.
        return vars(RunResult(task.law, task.kind, task.number, int(Harm.LATE), late=f"refused: {error}"))
    return vars(loop.run())


class _Loop:
    def __init__(self, task: RunTask) -> None:
        setup = self._setup = task.setup.with_law(task.law)
        stream = (int(task.kind == HARD), task.number)
        self._noise = setup.generator(*stream, 1)
        self._dropped = setup.generator(*stream, 2)
        drawn = setup.generator(*stream, 0)
        self._camera = setup.camera(setup.true_lines(drawn))
        self._start = task.setup.start_of(task.kind, drawn)
        monitor = setup.monitor
        linear, angular = monitor.robot_linear_speed or math.inf, monitor.robot_angular_speed or math.inf
        self._limits = np.array([linear, angular])
        self._robot = SimulatedRobot(
            self._start,
            setup.period,
            monitor.frames_late,
            monitor.jitter,
            monitor.robot_lag,
            (linear, angular) if monitor.robot_clamps else (math.inf, math.inf),
            setup.generator(*stream, 3),
        )
        self._controller = ServoController.from_parameters(setup.controller)
        self._tracker = PoseTracker(setup.estimator)
        self._monitor = SingularityMonitor.from_parameters(monitor) if task.watched else None
        self._result = RunResult(task.law, task.kind, task.number)
        self._used = setup.controller.degrees_of_freedom
        self._halts: Counter[str] = Counter()
        self._squares: list[float] = []
        self._first: Array | None = None
        self._held: Array = np.zeros(6)
        self._alerting = 0

    def run(self) -> RunResult:
        setup, result, period = self._setup, self._result, self._setup.period
        target, deadline = setup.target, RolloutLaw.of_parameters(setup.controller).deadline
        start = distance_between(self._start, target, self._used)[0]
        away = max(1.5 * start, start + 0.05)
        arrived_since, end, distances, length = None, math.inf, [], 0.0
        frame = 0
        while True:
            here, time = self._robot.T_world_camera, frame * period
            distance, angle = distance_between(here, target, self._used)
            distances.append(distance)
            if time >= end:
                break
            result.harm, result.time = self._harm(distance, away, time, deadline, end), time
            if result.harm:
                break
            there = distance <= _ARRIVED and angle <= _ARRIVED_ANGLE
            arrived_since = None if not there else time if arrived_since is None else arrived_since
            if arrived_since is not None and time - arrived_since >= _ARRIVED_TIME and end == math.inf:
                result.time = time
                end = time + _SETTLING / setup.controller.gain
            twist = self._cycle(time) if self._dropped.random() >= setup.monitor.dropped_frames else None
            self._note_speed(twist, time)
            # A frame that is dropped leaves the twist before it in force.
            self._held = self._held if twist is None else twist
            self._robot.step(self._held)
            length += float(np.linalg.norm(self._robot.T_world_camera.translation - here.translation))
            frame += 1
        if end < math.inf:
            result.time = end - _SETTLING / setup.controller.gain
        result.frames = frame
        result.path = length / max(start, 1e-9)
        result.error = float(np.sqrt(np.mean(np.square(distances[-max(round(_LAST / period), 1) :]))))
        result.late = self._halts.most_common(1)[0][0] if self._halts else ""
        result.nees = float(np.mean(self._squares)) if self._squares else 0.0
        result.alert_share = self._alerting / max(frame, 1)
        rows = np.linspace(0, len(result.trace) - 1, min(_KEPT, len(result.trace))).round().astype(int)
        result.trace = [result.trace[row] for row in rows]
        return result

    def _harm(self, distance: float, away: float, time: float, deadline: float, end: float) -> int:
        if distance > away:
            return int(Harm.AWAY)
        if np.count_nonzero(self._camera.visible(self._robot.T_world_camera)) < _MIN_LINES:
            return int(Harm.FEW_LINES)
        return int(Harm.LATE) if time >= deadline and end == math.inf else int(Harm.NONE)

    def _note_speed(self, twist: Array | None, time: float) -> None:
        if twist is None:
            return
        speeds = np.linalg.norm(twist.reshape(2, 3), axis=1)
        if self._first is None and speeds.any():
            self._first = speeds
        if self._first is not None:
            demand = float((speeds / np.maximum(self._limits, 1.5 * self._first)).max())
            self._result.demand = max(self._result.demand, demand)
            if demand > 1.0 and self._result.demand_time is None:
                self._result.demand_time = time

    def _cycle(self, time: float) -> Array:
        """Return what is commanded for a frame, and let the monitor answer it."""
        here, stamp = self._robot.T_world_camera, _SECOND + round(time * _SECOND)
        tracked = self._tracker.track(self._camera.observe(here, self._noise), stamp, stamp)
        pose = tracked.estimate.T_world_camera
        trusted = pose is not None and tracked.estimate.verdict is not Verdict.AMBIGUOUS
        if pose is not None and trusted:
            self._note_pose(here, pose, tracked.estimate.covariance)
        error = float("nan") if pose is None else float(np.linalg.norm(pose.translation - here.translation))
        self._result.trace.append([time, *here.translation.tolist(), error, tracked.estimate.position_deviation])
        reason = tracked.estimate.reason or "no pose"
        assessment = None
        if self._monitor is not None:
            try:
                if tracked.completed is None:
                    assessment = self._monitor.unusable(reason, stamp)
                else:
                    if pose is not None and trusted:
                        self._monitor.receive_pose(pose, stamp, tracked.estimate.covariance)
                    assessment = self._monitor.answer(tracked.completed, stamp, stamp)
            except PlsingError as problem:
                assessment = self._monitor.unusable(str(problem), stamp)
        try:
            if pose is not None and trusted:
                self._controller.receive_pose(pose, stamp, tracked.estimate.covariance)
            command = (
                self._controller.halt(reason)
                if tracked.completed is None
                else self._controller.answer(tracked.completed, stamp, stamp)
            )
        except PlsingError as problem:
            command = self._controller.halt(str(problem))
        if not command.mode.moves:
            self._halts[f"{command.mode.name}: {command.reason}"] += 1
        self._tracker.receive_twist(command.twist, stamp)
        if self._monitor is not None:
            self._monitor.receive_twist(command.twist, stamp)
        if assessment is not None:
            self._note_assessment(assessment, time)
        return command.twist

    def _note_assessment(self, assessment: Any, time: float) -> None:
        result = self._result
        if assessment.risk is not None and result.risk is None:
            result.risk = assessment.risk.probability
        if assessment.level in _ALERTS:
            self._alerting += 1
            if result.first_alert is None:
                result.first_alert, result.alert = time, assessment.reason

    def _note_pose(self, true: Pose, pose: Pose, covariance: Array) -> None:
        error = np.concatenate([true.translation - pose.translation, rotation_vector(true.rotation @ pose.rotation.T)])
        squares = [
            float(error[part] @ np.linalg.solve(covariance[part, part], error[part]))
            for part in (slice(0, 3), slice(3, 6), slice(0, 6))
        ]
        self._squares.append(squares[2])
        self._result.poses += 1
        self._result.wrong += max(squares[:2]) > _WRONG**2


def run_tasks_of(setup: Setup, laws: tuple[str, ...], runs: int) -> dict[str, RunTask]:
    """Return all runs by name: each law as often, from the same starts, and the setup's own law from hard starts, too.

    The monitor watches the runs of the setup's own law.
    """
    own = setup.controller.law
    kinds = [(law, YOURS) for law in (own, *(each for each in laws if each != own))] + [(own, HARD)]
    return {
        f"{kind} {law} {number}": RunTask(setup, law, kind, number, law == own)
        for law, kind in kinds
        for number in range(runs)
    }
