# SPDX-License-Identifier: Apache-2.0
"""Monitor and controller over a recording: what they said, or would have said with other parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from plsing_ros.analysis.recording import RecordedMessage, RecordingError, stamp_of
from plsing_ros.arrays import Array
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import PlsingError
from plsing_ros.features.feature_message import observation_from_message
from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters import ControllerParameters, MonitorParameters
from plsing_ros.simulation.run_record import Alert

_SECOND = 1_000_000_000
# Farther apart than this, the recorder's clock is another one than that of the stamps.
_OTHER_CLOCK = 60.0


@dataclass(frozen=True, eq=False)
class ReplayedRun:
    """What monitor and controller made of a recording, a row for each feature message they used.

    Attributes:
        time: Since the first features, shape (k,) [s].
        level: Of the monitor.
        inverse_condition_number: Raw, shape (k,); nan where it is not known.
        nearest_distance: To the nearest locus, shape (k,) [m]; nan where it is not known.
        recorded_speed: |v| of the cmd_twist recorded for the features, shape (k,) [m/s]; nan without one.
        replayed_speed: |v| of the twist that the controller commands now, shape (k,) [m/s]; nan without a controller.
        alerts: Changes of level now.
        recorded_alerts: Changes of level in the recording.
        refused: Messages that were not used: how many, by reason.
    """

    time: Array
    level: tuple[Level, ...]
    inverse_condition_number: Array
    nearest_distance: Array
    recorded_speed: Array
    replayed_speed: Array
    alerts: tuple[Alert, ...]
    recorded_alerts: tuple[Alert, ...]
    refused: dict[str, int]

    @property
    def duration(self) -> float:
        """Length of the recording [s]."""
        return float(self.time[-1])

    def time_at(self, level: Level) -> float:
        """Return for how long a level was in force [s]."""
        steps = np.diff(self.time)
        return float(sum(step for step, each in zip(steps, self.level, strict=False) if each is level))

    def __str__(self) -> str:
        rows = [f"{len(self.time)} feature messages in {self.duration:.4g} s, {len(self.alerts)} changes of level"]
        rows += [f"  {each.time:8.2f} s  {each.text}" for each in self.alerts]
        if self.recorded_alerts:
            rows.append(f"in the recording there were {len(self.recorded_alerts)}:")
            rows += [f"  {each.time:8.2f} s  {each.text}" for each in self.recorded_alerts]
        levels = ", ".join(f"{each.name} {self.time_at(each):.3g} s" for each in Level if self.time_at(each) > 0.0)
        rows.append(f"time at each level: {levels or 'none'}")
        rows += [f"not used, {count} times: {reason}" for reason, count in self.refused.items()]
        return "\n".join(rows)


def replay(
    messages: Iterable[RecordedMessage],
    monitor: MonitorParameters,
    controller: ControllerParameters | None = None,
    features: str = "line_features",
) -> ReplayedRun:
    """Let monitor and controller answer the messages of a recording, as fast as they can.

    Time is that of the recorder; where its clock is not that of the stamps (a simulation), time is that of the stamps.

    Args:
        messages: In order of time, as of read_recording.
        monitor: Parameters of the monitor.
        controller: Parameters of the controller; None: only the monitor runs.
        features: Topic of the features that they read, a key of recording.TYPES.

    Raises:
        RecordingError: If there are no features that they can use.
        PlsingError: If the parameters do not make a monitor or a controller.
    """
    run = _Replay(monitor, controller, features)
    for message in messages:
        run.take(message)
    return run.result()


class _Replay:
    def __init__(self, monitor: MonitorParameters, controller: ControllerParameters | None, features: str) -> None:
        self._parameters, self._features = monitor, features
        self._monitor = SingularityMonitor.from_parameters(monitor)
        self._controller = None if controller is None else ServoController.from_parameters(controller)
        self._shown_target = controller is not None and controller.target_source == "topic"
        self._rows: list[tuple[int, Assessment, float]] = []
        self._recorded: dict[int, float] = {}
        self._recorded_alerts: list[tuple[int, Any]] = []
        self._refused: dict[str, int] = {}
        self._other_clock: bool | None = None

    def take(self, recorded: RecordedMessage) -> None:
        message = recorded.message
        try:
            if recorded.topic == self._features:
                self._take_features(message, recorded.time)
            elif recorded.topic == "camera_pose":
                self._monitor.receive_pose(self._pose(message), stamp_of(message))
            elif recorded.topic == "cmd_twist":
                twist = _twist(message)
                self._recorded[stamp_of(message)] = float(np.linalg.norm(twist[:3]))
                self._monitor.receive_twist(twist, stamp_of(message))
            elif recorded.topic == "desired_line_features":
                observation = observation_from_message(message, self._parameters.camera_frame)
                self._monitor.set_target(observation)
                if self._controller is not None and self._shown_target:
                    self._controller.set_target(observation)
            elif recorded.topic == "singularity_alerts":
                self._recorded_alerts.append((stamp_of(message), message))
        except PlsingError as error:
            reason = f"{recorded.topic}: {error}"
            self._refused[reason] = self._refused.get(reason, 0) + 1

    def _take_features(self, message: Any, time: int) -> None:
        stamp = stamp_of(message)
        if self._other_clock is None:
            self._other_clock = abs(time - stamp) > _OTHER_CLOCK * _SECOND
        now = stamp if self._other_clock else time
        observation = observation_from_message(message, self._parameters.camera_frame)
        assessment = self._monitor.answer(observation, stamp, now)
        if assessment is None:
            return
        speed = math.nan
        if self._controller is not None:
            try:
                command = self._controller.answer(observation, stamp, now)
            except PlsingError as error:
                command = self._controller.halt(str(error))
            speed = float(np.linalg.norm(command.twist[:3]))
        self._rows.append((stamp, assessment, speed))

    def _pose(self, message: Any) -> Pose:
        pose = message.pose.pose
        position, orientation = pose.position, pose.orientation
        return Pose.from_quaternion(
            [position.x, position.y, position.z], [orientation.x, orientation.y, orientation.z, orientation.w]
        )

    def result(self) -> ReplayedRun:
        if not self._rows:
            why = "; ".join(self._refused) or f"none on topic {self._features}"
            raise RecordingError(f"the recording has no features that can be used: {why}")
        start = self._rows[0][0]
        levels = tuple(assessment.level for _, assessment, _ in self._rows)
        alerts = [
            Alert((stamp - start) / _SECOND, assessment.level, f"{assessment.level.name}: {assessment.reason}")
            for i, (stamp, assessment, _) in enumerate(self._rows)
            if i == 0 or assessment.level is not levels[i - 1]
        ]
        before = [
            Alert((stamp - start) / _SECOND, Level(message.level), message.text)
            for stamp, message in self._recorded_alerts
            if stamp >= start
        ]
        return ReplayedRun(
            time=np.array([(stamp - start) / _SECOND for stamp, _, _ in self._rows]),
            level=levels,
            inverse_condition_number=np.array([_condition(assessment) for _, assessment, _ in self._rows]),
            nearest_distance=np.array(
                [math.nan if each.nearest is None else each.nearest.distance for _, each, _ in self._rows]
            ),
            recorded_speed=np.array([self._recorded.get(stamp, math.nan) for stamp, _, _ in self._rows]),
            replayed_speed=np.array([speed for _, _, speed in self._rows]),
            alerts=tuple(alerts),
            recorded_alerts=tuple(before),
            refused=self._refused,
        )


def scene_of(messages: Iterable[RecordedMessage]) -> dict[str, Any]:
    """Return the scene that the monitor published in a recording, as parameters by ROS name; empty if it did not."""
    for recorded in messages:
        if recorded.topic == "singular_loci":
            message = recorded.message
            return {
                "lines.points": np.asarray(message.line_points).tolist(),
                "lines.directions": np.asarray(message.line_directions).tolist(),
                "lines.ids": np.asarray(message.line_ids).tolist(),
                "scene_frame": str(message.header.frame_id),
            }
    return {}


def _condition(assessment: Assessment) -> float:
    return math.nan if assessment.conditioning is None else assessment.conditioning.inverse_condition_number


def _twist(message: Any) -> Array:
    linear, angular = message.twist.linear, message.twist.angular
    return np.array([linear.x, linear.y, linear.z, angular.x, angular.y, angular.z])
