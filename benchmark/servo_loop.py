# SPDX-License-Identifier: Apache-2.0
"""One servo task run by several laws side by side in the conditions of benchmark.servo_conditions: what came of it.

All laws see their own camera with the same noise in the same frame, so that runs are pairs.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from benchmark.rivals import RIVALS, situation_of
from benchmark.servo_conditions import (
    FOCAL_LENGTH,
    FRAME_TIME,
    ROBOT_LIMITS,
    Condition,
    DisturbedCamera,
    Frame,
    SegmentTask,
)
from plsing_ros.arrays import cross
from plsing_ros.control.latency import LookAhead
from plsing_ros.control.saturation import saturate
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.geometry.rotations import exponential
from plsing_ros.parameters import ControllerParameters, PoseEstimatorParameters
from plsing_ros.pose.pose_tracker import PoseTracker

ARRIVED = (0.05, np.radians(2.0), 1.0)  # [m], [rad], for [s]
_START = 10**12  # [ns]
_SETTLING = 3.0  # in units of 1 / lambda
# A camera that was told to stand still for so many frames is not waited for [frames].
_GIVEN_UP = 120
# Every such step's time is taken [frames].
_TIMED = 16
# Shorter ways are taken as so long in ratios: turns on the spot [m].
_SHORTEST_WAY = 0.1


@dataclass(frozen=True)
class Contender:
    """A law of the package with options, or a rival."""

    law: str
    options: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class RunOutcome:
    """What came of a run.

    Attributes:
        arrived: Within 5 cm and 2 degrees of the target for 1 s, in time.
        seconds: Until then, or the time that was allowed.
        away: Whether it was ever farther than 1.5 times and 5 cm more than the start's distance.
        lost: Whether fewer than three lines were seen in a frame.
        path: Length over the straight way.
        error: Distance from the target a while after arrival, or at the end, root mean square over a second [m].
        start: Distance of the start from the target [m].
        farthest: Largest distance from the target over the start's.
        speed: Largest commanded |v| and |omega| over the limits.
        refused: Frames that were refused as contradictory.
        frames: All of them.
        step: Median processor time of a control step [s].
    """

    arrived: bool
    seconds: float
    away: bool
    lost: bool
    path: float
    error: float
    start: float
    farthest: float
    speed: float
    refused: int
    frames: int
    step: float


class Control(Protocol):
    """A controller in the loop.

    Attributes:
        refused: Frames that it did not move by, although enough lines were seen.
    """

    refused: int

    def __call__(self, frame: Frame, stamp: int) -> np.ndarray:
        """Return the twist of the camera for a frame, shape (6,)."""


def run(
    task: SegmentTask, condition: Condition, contenders: Mapping[str, Contender], seed: int
) -> dict[str, RunOutcome]:
    """Run laws from start to target.

    Args:
        task: The task.
        condition: What is wrong.
        contenders: The laws by name.
        seed: Of the errors: frame k has the same ones for every law, and in every call.
    """
    camera = DisturbedCamera(task, condition, np.random.default_rng([seed, 1]))
    target = _target(task, condition, camera)
    runs = {
        name: _LoopRun(task, condition, _control(task, condition, each, target)) for name, each in contenders.items()
    }
    rng = np.random.default_rng([seed, 2])
    while active := [each for each in runs.values() if each.goes_on]:
        dropped, late = bool(rng.random() < condition.dropped), bool(rng.random() < condition.jitter)
        R, t = np.array([each.pose.rotation for each in active]), np.array([each.pose.translation for each in active])
        images = zip(*camera.images(R, t), strict=True)
        error, covariance = camera.pose_error(), camera.pose_covariance
        for each, (lines, covariances, seen) in zip(active, images, strict=True):
            frame = camera.completed(lines, covariances, seen, each.pose @ error, covariance)
            each.advance(frame, dropped, late)
    return {name: each.outcome() for name, each in runs.items()}


def _target(task: SegmentTask, condition: Condition, camera: DisturbedCamera) -> Frame:
    """Return what is seen at the target, or would be by the map."""
    if condition.shown and not condition.chain:
        return camera.frame(task.target)
    if condition.shown:
        # Shown to the estimator as it will be used, standing still.
        chain = _chain(task, condition)
        for k in range(-30, 0):
            frame = chain.completed(camera.frame(task.target), _START + round(k * FRAME_TIME * 1e9))
        return frame
    in_camera = task.map.transformed(task.target.inverse(), "camera")
    lines = in_camera.moment / np.hypot(in_camera.moment[:, 0], in_camera.moment[:, 1])[:, np.newaxis]
    n = len(in_camera)
    covariances = np.tile((1e-8, 0.0, 1e-8), (n, 1))
    return camera.completed(lines, covariances, np.ones(n, dtype=bool), task.target, 1e-8 * np.eye(6))


def _control(task: SegmentTask, condition: Condition, contender: Contender, target: Frame) -> Control:
    if contender.law in RIVALS:
        control: Control = _Rival(task, condition, contender.law, target)
    else:
        control = _Package(task, condition, contender, target)
    return _Chained(_chain(task, condition), control) if condition.chain else control


def _latency(condition: Condition) -> float:
    return condition.latency * FRAME_TIME + condition.lag


class _Rival:
    """A law of benchmark.rivals, which looks ahead as the package's laws do."""

    refused = 0

    def __init__(self, task: SegmentTask, condition: Condition, law: str, target: Frame) -> None:
        self._law, self._gain, self._target = RIVALS[law], task.gain, target
        self._look_ahead, self._latency = LookAhead(), _latency(condition)

    def __call__(self, frame: Frame, stamp: int) -> np.ndarray:
        now = situation_of(frame, self._target)
        if now is None:
            self._look_ahead.clear()
            return np.zeros(6)
        lines, image = self._look_ahead.ahead(now.lines, now.image, stamp, self._latency)
        moved = now.T_target_camera @ self._look_ahead.motion(stamp, self._latency)
        now = replace(now, lines=lines, image=image, T_target_camera=moved)
        twist = saturate(self._law(now, self._gain), *ROBOT_LIMITS)[0]
        self._look_ahead.sent(twist, stamp)
        return twist


class _Package:
    """The package's controller."""

    def __init__(self, task: SegmentTask, condition: Condition, contender: Contender, target: Frame) -> None:
        lines = task.map
        self.refused = 0
        self._servo = ServoController.from_parameters(
            ControllerParameters.from_values(
                {
                    "lines.points": lines.point.ravel().tolist(),
                    "lines.directions": lines.direction.ravel().tolist(),
                    "law": contender.law,
                    "gain": task.gain,
                    "target.source": "topic",
                    "target.min_inverse_condition_number": 0.0,
                    "max_linear_speed": ROBOT_LIMITS[0],
                    "max_angular_speed": ROBOT_LIMITS[1],
                    "latency": _latency(condition),
                    "features_timeout": 1.0,
                    # Rivals go on by poor lines as by others.
                    "poor_lines": "ignore",
                    **contender.options,
                }
            )
        )
        self._servo.set_target(target.observation)

    def __call__(self, frame: Frame, stamp: int) -> np.ndarray:
        try:
            self._servo.receive_pose(frame.T_world_camera, stamp, frame.covariance)
            command = self._servo.answer(frame.observation, stamp, stamp)
        except PlsingError as error:
            command = self._servo.halt(str(error))
        self.refused += not command.mode.moves and "usable" not in command.reason
        return command.twist


class _Chain:
    """The pose estimator with its filter before a controller."""

    def __init__(self, tracker: PoseTracker, task: SegmentTask) -> None:
        self._tracker = tracker
        self._empty = LineObservation(task.map.ids, np.zeros((len(task.map), 3)), np.zeros(len(task.map), dtype=bool))

    def completed(self, frame: Frame, stamp: int) -> Frame:
        """Return the frame with 3-D lines and pose by its image; without lines where there is no pose."""
        image = replace(frame.observation, lines_camera=None)
        tracked = self._tracker.track(image, stamp, stamp)
        pose = tracked.estimate.T_world_camera
        if tracked.completed is None or pose is None:
            return Frame(self._empty, frame.T_world_camera, frame.covariance)
        return Frame(tracked.completed, pose, tracked.estimate.covariance)

    def moved(self, twist: np.ndarray, stamp: int) -> None:
        """Take note of a twist that was sent."""
        self._tracker.receive_twist(twist, stamp)


def _chain(task: SegmentTask, condition: Condition) -> _Chain:
    span = task.map_ends[:, 1] - task.map_ends[:, 0]
    values = {
        "lines.points": task.map_ends.mean(axis=1).ravel().tolist(),
        "lines.directions": span.ravel().tolist(),
        "twist_latency": _latency(condition),
    }
    if condition.map_shift > 0.0:
        length = np.linalg.norm(span, axis=1)
        values["lines.position_std"] = [condition.map_shift / np.sqrt(2.0)] * len(span)
        values["lines.direction_std"] = np.minimum(np.sqrt(2.0) * condition.map_shift / length, 1.0).tolist()
    if condition.pixels > 0.0:
        values["noise.image"] = condition.pixels / FOCAL_LENGTH
    return _Chain(PoseTracker(PoseEstimatorParameters.from_values(values)), task)


class _Chained:
    """A controller behind the pose estimator."""

    def __init__(self, chain: _Chain, control: Control) -> None:
        self._chain, self._control = chain, control

    @property
    def refused(self) -> int:  # type: ignore[override]
        """Of the controller."""
        return self._control.refused

    def __call__(self, frame: Frame, stamp: int) -> np.ndarray:
        completed = self._chain.completed(frame, stamp)
        twist = self._control(completed, stamp)
        self._chain.moved(twist, stamp)
        return twist


class _LoopRun:
    """A camera on its way.

    Attributes:
        pose: T_world_camera.
        goes_on: Whether it is neither there nor out of time.
    """

    def __init__(self, task: SegmentTask, condition: Condition, control: Control) -> None:
        self.pose, self.goes_on = task.start, True
        self._task, self._condition, self._control = task, condition, control
        self._actual = self._commanded = np.zeros(6)
        # The first twist of an image acts after the latency.
        self._under_way: deque[tuple[int, np.ndarray]] = deque()
        self._start = self._distance()
        self._near = self._length = self._fastest = 0.0
        self._farthest = self._start
        self._frame = self._still = 0
        self._away = self._lost = self._arrived = False
        self._last: deque[float] = deque([self._start], maxlen=30)
        self._times: list[float] = []
        self._decay = 0.0 if condition.lag == 0.0 else float(np.exp(-FRAME_TIME / condition.lag))
        self._seconds = self._end = 10.0 / task.gain + 4.0

    def advance(self, frame: Frame, dropped: bool, late: bool) -> None:
        """Answer a frame and move on to the next."""
        condition, k = self._condition, self._frame
        self._lost = self._lost or len(frame.observation.usable_ids) < 3
        if not dropped:
            # The clock of the processor is slow to read.
            timed = k % _TIMED == 0
            before = time.thread_time() if timed else 0.0
            twist = self._control(frame, _START + round(k * FRAME_TIME * 1e9))
            if timed:
                self._times.append(time.thread_time() - before)
            speeds = np.linalg.norm(twist.reshape(2, 3), axis=1) / ROBOT_LIMITS
            self._fastest = max(self._fastest, float(speeds.max()))
            self._under_way.append((k + condition.latency + late, twist))
            self._still = 0 if twist.any() else self._still + 1
        while self._under_way and self._under_way[0][0] <= k:
            self._commanded = self._under_way.popleft()[1]
        wanted = saturate(self._commanded, *ROBOT_LIMITS)[0] if condition.limited else self._commanded
        self._actual = wanted + self._decay * (self._actual - wanted)
        self._move()
        self._frame += 1
        self._judge()

    def _move(self) -> None:
        # The camera moves as the hand that it is fixed to.
        hand, v, omega = self._task.T_hand_camera, self._actual[:3], self._actual[3:]
        v, omega = hand.rotation.T @ (v + cross(omega, hand.translation)), hand.rotation.T @ omega
        self._length += float(np.linalg.norm(v)) * FRAME_TIME
        turned, mean = exponential(omega * FRAME_TIME)
        R = self.pose.rotation
        try:
            self.pose = Pose(R @ turned, self.pose.translation + R @ (mean @ v) * FRAME_TIME)
        except PlsingError:
            self._away, self.goes_on = True, False

    def _judge(self) -> None:
        distance = self._distance()
        self._farthest = max(self._farthest, distance)
        self._away = self._away or distance > max(1.5 * self._start, self._start + 0.05)
        self._last.append(distance)
        near = distance < ARRIVED[0] and self._turn() < ARRIVED[1]
        self._near = self._near + FRAME_TIME if near else 0.0
        if self._near >= ARRIVED[2] and not self._arrived:
            self._arrived, self._seconds = True, self._frame * FRAME_TIME
            # On, until what is left of the way is small beside the errors.
            self._end = self._seconds + _SETTLING / self._task.gain
        if self._frame * FRAME_TIME >= self._end or self._still > _GIVEN_UP:
            self.goes_on = False

    def outcome(self) -> RunOutcome:
        """Return what came of it."""
        way = max(self._start, _SHORTEST_WAY)
        return RunOutcome(
            self._arrived,
            self._seconds,
            self._away,
            self._lost,
            self._length / way,
            float(np.sqrt(np.mean(np.square(self._last)))),
            self._start,
            self._farthest / way,
            self._fastest,
            self._control.refused,
            self._frame,
            float(np.median(self._times)) if self._times else 0.0,
        )

    def _distance(self) -> float:
        return float(np.linalg.norm(self.pose.translation - self._task.target.translation))

    def _turn(self) -> float:
        chord = float(np.linalg.norm(self._task.target.rotation - self.pose.rotation))
        return 2.0 * float(np.arcsin(min(chord / np.sqrt(8.0), 1.0)))
