# SPDX-License-Identifier: Apache-2.0
"""One servo run of a controller in the conditions of benchmark.servo_conditions, and what came of it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.rivals import RIVALS, situation_of
from benchmark.servo_conditions import FRAME_TIME, ROBOT_LIMITS, Camera, Condition, Frame, ServoTask
from plsing_ros.control.latency import LookAhead
from plsing_ros.control.saturation import saturated
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.control.tool import tool_twist
from plsing_ros.errors import PlsingError
from plsing_ros.geometry import Pose
from plsing_ros.parameters import ControllerParameters

ARRIVED = (0.05, np.radians(2.0), 1.0)  # [m], [rad], for [s]
_START = 10**12  # [ns]
_SETTLING = 3.0  # in units of 1 / lambda


@dataclass(frozen=True)
class Outcome:
    """What came of a run.

    Attributes:
        arrived: Within 5 cm and 2 degrees of the target for 1 s, in time.
        seconds: Until then, or the time that was allowed.
        away: Whether it was ever farther than 1.5 times and 5 cm more than the start's distance.
        lost: Whether fewer than three lines were seen in a frame.
        path: Length over the straight way.
        error: Distance from the target a while after arrival, or at the end, root mean square over a second [m].
        farthest: Largest distance from the target over the start's.
        speed: Largest commanded |v| and |omega| over the limits.
        refused: Frames that were refused as contradictory.
        frames: All of them.
        step: Median time of a control step [s].
    """

    arrived: bool
    seconds: float
    away: bool
    lost: bool
    path: float
    error: float
    farthest: float
    speed: float
    refused: int
    frames: int
    step: float


Control = Callable[[Frame, int], np.ndarray]


def run(task: ServoTask, condition: Condition, law: str, options: dict[str, object], seed: int) -> Outcome:
    """Run one law from start to target.

    Args:
        task: The task.
        condition: What is wrong; draws the same errors for the same seed whatever the law, as long as frames are as
            many.
        law: A value of the parameter law, or the name of a rival.
        options: Further parameters of the controller.
        seed: Of the errors.
    """
    rng = np.random.default_rng(seed)
    camera = Camera(task, condition, rng)
    target = camera.frame(task.target) if condition.shown else _exact_target(camera, task)
    package = law not in RIVALS
    control = _package(task, condition, law, options, target) if package else _rival(task, condition, law, target)
    return _loop(task, condition, control, camera, rng)


def _exact_target(camera: Camera, task: ServoTask) -> Frame:
    in_camera = task.map.transformed(task.target.inverse(), "camera")
    lines = in_camera.moment / np.hypot(in_camera.moment[:, 0], in_camera.moment[:, 1])[:, np.newaxis]
    n = len(in_camera)
    return camera.completed(lines, np.full((n, 3), 1e-8), np.ones(n, dtype=bool), task.target, 1e-8 * np.eye(6))


def _rival(task: ServoTask, condition: Condition, law: str, target: Frame) -> Control:
    look_ahead, latency = LookAhead(), _latency(condition)

    def control(frame: Frame, stamp: int) -> np.ndarray:
        now = situation_of(frame, target)
        if now is None:
            look_ahead.clear()
            return np.zeros(6)
        # Rivals look ahead as the package's laws do.
        lines, image = look_ahead.ahead(now.lines, now.image, stamp, latency)
        moved = now.T_target_camera @ look_ahead.motion(stamp, latency)
        now = replace(now, lines=lines, image=image, T_target_camera=moved)
        twist = saturated(RIVALS[law](now, task.gain), *ROBOT_LIMITS)[0]
        look_ahead.sent(twist, stamp)
        return twist

    return control


def _latency(condition: Condition) -> float:
    return condition.latency * FRAME_TIME + condition.lag


class Refusals:
    """Counts the frames that a controller refused."""

    count = 0


def _package(task: ServoTask, condition: Condition, law: str, options: dict[str, object], target: Frame) -> Control:
    lines = task.map
    servo = ServoController.from_parameters(
        ControllerParameters.from_values(
            {
                "lines.points": lines.point.ravel().tolist(),
                "lines.directions": lines.direction.ravel().tolist(),
                "law": law,
                "gain": task.gain,
                "target.source": "topic",
                "target.min_inverse_condition_number": 0.0,
                "latency": _latency(condition),
                "features_timeout": 1.0,
                **options,
            }
        )
    )
    servo.set_target(target.observation)

    def control(frame: Frame, stamp: int) -> np.ndarray:
        try:
            command = servo.answer(frame.observation, stamp, stamp)
        except PlsingError as error:
            command = servo.halt(str(error))
        if not command.mode.moves and "usable" not in command.reason:
            Refusals.count += 1
        return command.twist

    return control


def _loop(task: ServoTask, condition: Condition, control: Control, camera: Camera, rng: np.random.Generator) -> Outcome:
    pose, actual = task.start, np.zeros(6)
    start, _ = _distances(task, pose)
    most = 10.0 / task.gain + 4.0
    # The first twist of an image acts after the latency.
    under_way: deque[tuple[int, np.ndarray]] = deque()
    commanded = np.zeros(6)
    near, length, farthest, fastest, last, times = 0.0, 0.0, start, 0.0, [], []
    away = lost = arrived = False
    Refusals.count = frames = k = 0
    decay = 0.0 if condition.lag == 0.0 else float(np.exp(-FRAME_TIME / condition.lag))
    seconds, end = most, most
    while k * FRAME_TIME < end:
        dropped, late = rng.random() < condition.dropped, rng.random() < condition.jitter
        frame = camera.frame(pose)
        frames += 1
        lost = lost or len(frame.observation.usable_ids) < 3
        if not dropped:
            before = time.perf_counter()
            twist = control(frame, _START + round(k * FRAME_TIME * 1e9))
            times.append(time.perf_counter() - before)
            fastest = max(
                fastest, np.linalg.norm(twist[:3]) / ROBOT_LIMITS[0], np.linalg.norm(twist[3:]) / ROBOT_LIMITS[1]
            )
            under_way.append((k + condition.latency + late, twist))
        while under_way and under_way[0][0] <= k:
            commanded = under_way.popleft()[1]
        wanted = saturated(commanded, *ROBOT_LIMITS)[0] if condition.limited else commanded
        actual = wanted + decay * (actual - wanted)
        try:
            # The camera moves as the hand that it is fixed to.
            pose = pose.integrate(tool_twist(task.T_hand_camera.inverse(), actual), FRAME_TIME)
        except PlsingError:
            away = True
            break
        k += 1
        distance, turn = _distances(task, pose)
        length += float(np.linalg.norm(actual[:3])) * FRAME_TIME
        farthest = max(farthest, distance)
        away = away or distance > max(1.5 * start, start + 0.05)
        last = [*last[-29:], distance]
        near = near + FRAME_TIME if distance < ARRIVED[0] and turn < ARRIVED[1] else 0.0
        if near >= ARRIVED[2] and not arrived:
            arrived, seconds = True, k * FRAME_TIME
            # On, until what is left of the way is small beside the errors.
            end = seconds + _SETTLING / task.gain
    return Outcome(
        arrived,
        seconds,
        away,
        lost,
        length / start,
        float(np.sqrt(np.mean(np.square(last)))) if last else start,
        farthest / start,
        float(fastest),
        Refusals.count,
        frames,
        float(np.median(times)) if times else 0.0,
    )


def _distances(task: ServoTask, pose: Pose) -> tuple[float, float]:
    turn = Rotation.from_matrix(task.target.rotation.T @ pose.rotation).magnitude()
    return float(np.linalg.norm(pose.translation - task.target.translation)), float(turn)
