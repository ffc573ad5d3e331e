# SPDX-License-Identifier: Apache-2.0
"""What the monitor's callbacks take of each frame over DDS, beside bare callbacks with the same messages.

The node runs as a process of its own, as it does for a user; this process sends pose, features and twist of a frame at
30 Hz. The bare node receives the same messages, and publishes one ready-made status of the same content: what rclpy and
a cold start of a callback take.

    python3 -m benchmark.monitor_callback
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from benchmark.alert_settings import Setting, monitor_parameters
from benchmark.monitor_settings import RATE, settings
from benchmark.rclpy_baseline import BareNode
from benchmark.servo_conditions import DisturbedCamera, Frame
from plsing_msgs.msg import LineFeatureArray, SingularityStatus
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import features_message, fill_stamp, fill_twist, status_message
from plsing_ros.nodes.main import node_parser, run_nodes
from plsing_ros.nodes.pose_conversions import camera_pose_message
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode
from plsing_ros.testing.harness import Harness

_SECOND = 1_000_000_000
_LINES = (4, 6, 12)
_CYCLES, _FIRST = 900, 30
_FRAMES = 50
_PATIENCE = 60.0  # [s]
_TOPICS = ("camera_pose", "line_features", "cmd_twist")
_ROOT = Path(__file__).parents[1]


class CallbackTimes:
    """Wall time of all callbacks of each frame, and processor time of the thread with all that rclpy does."""

    def __init__(self, cycles: int) -> None:
        """Begin; after so many cycles the process is asked to end."""
        self._cycles = cycles
        self._wall: list[float] = []
        self._used: list[float] = []
        self._spent = 0.0
        self._before = time.thread_time()

    def timed(self, topic: str, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback of a topic that is timed; the pose is the first of a frame."""

        def call(message: Any) -> None:
            start = time.perf_counter()
            if topic == _TOPICS[0]:
                self._begin()
            callback(message)
            self._spent += time.perf_counter() - start

        return call if topic in _TOPICS else callback

    def _begin(self) -> None:
        now = time.thread_time()
        self._wall.append(self._spent)
        self._used.append(now - self._before)
        self._spent, self._before = 0.0, now
        if len(self._wall) == self._cycles + _FIRST:
            os.kill(os.getpid(), signal.SIGTERM)

    def text(self) -> str:
        """Return medians and 99 % of both [ms]."""
        numbers = [1e3 * np.quantile(each[_FIRST:], [0.5, 0.99]) for each in (self._wall, self._used)]
        (median, late), (used, most) = numbers
        return (
            f"callbacks {median:.3f} ms, 99 % {late:.3f} ms; processor time with all of rclpy {used:.3f}, {most:.3f} ms"
        )


class TimedMonitor(SingularityMonitorNode):
    """The monitor with times of its callbacks."""

    def __init__(self, times: CallbackTimes, **options: Any) -> None:
        self._times = times
        super().__init__(**options)

    def subscribe(self, message_type: type, topic: str, callback: Callable[[Any], None], profile: Any) -> None:
        """Subscribe with a callback that is timed."""
        super().subscribe(message_type, topic, self._times.timed(topic, callback), profile)


class FixedStatusMonitor(BareNode):
    """Listens to the same topics, and publishes one message for each features."""

    def __init__(self, times: CallbackTimes, status: SingularityStatus, **options: Any) -> None:
        super().__init__("singularity_monitor", **options)
        publisher = self.create_publisher(SingularityStatus, "singularity_status", qos.STATUS)
        for kind, topic, answer in (
            (PoseWithCovarianceStamped, _TOPICS[0], lambda _: None),
            (LineFeatureArray, _TOPICS[1], lambda _: publisher.publish(status)),
            (TwistStamped, _TOPICS[2], lambda _: None),
        ):
            self.create_subscription(kind, topic, times.timed(topic, answer), qos.SENSOR_DATA)


def main(quick: bool = False) -> None:
    """Measure and print; quick: a fifth of the cycles."""
    for n in _LINES:
        print(callback_times(n, _CYCLES // (5 if quick else 1)), flush=True)


def callback_times(n: int, cycles: int) -> str:
    """Return the times of both nodes with features of n lines."""
    setting = next(settings(n))
    return "\n".join(f"{n} lines, {name:8} {_measured(name, setting, n, cycles)}" for name in ("monitor", "bare"))


def receive(name: str, n: int, cycles: int) -> None:
    """Run one of the nodes in this process, and print its times at the end."""
    setting, times = next(settings(n)), CallbackTimes(cycles)
    parameters = monitor_parameters(setting)

    def create(**options: Any) -> Any:
        if name == "bare":
            return FixedStatusMonitor(times, _status(setting), **options)
        given = [Parameter(each, value=value) for each, value in parameters.values().items() if value != ()]
        return TimedMonitor(times, parameter_overrides=given, **options)

    run_nodes(lambda _: [create], node_parser("", ""), ["--ros-args", "--log-level", "FATAL"])
    print(times.text())


def _status(setting: Setting) -> SingularityStatus:
    """Return what the monitor says of the first frame once it has rolled out."""
    parameters = monitor_parameters(setting)
    monitor, frame = SingularityMonitor.from_parameters(parameters), _frames(setting)[0]
    monitor.receive_pose(frame.T_world_camera, _SECOND, frame.covariance)
    assessment = monitor.answer(frame.observation, _SECOND, _SECOND)
    assert assessment is not None and assessment.risk is not None
    return status_message(assessment, monitor.singular_set, parameters.camera_frame)


def _frames(setting: Setting) -> list[Frame]:
    camera = DisturbedCamera(setting.task, setting.condition, np.random.default_rng(1))
    return [camera.frame(setting.task.start) for _ in range(_FRAMES)]


def _measured(name: str, setting: Setting, n: int, cycles: int) -> str:
    parameters = monitor_parameters(setting)
    with Harness(log_level="ERROR") as ros:
        # The node publishes its status only where somebody listens.
        ros.collect(SingularityStatus, "singularity_status", qos.STATUS)
        process = subprocess.Popen(
            [sys.executable, "-c", f"from benchmark.monitor_callback import receive; receive({name!r}, {n}, {cycles})"],
            env=ros.environment(),
            cwd=_ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            kinds = (PoseWithCovarianceStamped, LineFeatureArray, TwistStamped)
            publishers = [
                ros.node.create_publisher(kind, topic, qos.STATUS) for kind, topic in zip(kinds, _TOPICS, strict=True)
            ]
            ros.spin_until(lambda: all(each.get_subscription_count() for each in publishers), "the node", _PATIENCE)
            sent = []
            for frame in _frames(setting):
                head = Header(frame_id=parameters.camera_frame)
                R = np.kron(np.eye(2), frame.T_world_camera.rotation)
                where = camera_pose_message(
                    frame.T_world_camera, Header(frame_id=parameters.scene_frame), R @ frame.covariance @ R.T
                )
                command = TwistStamped(header=head)
                fill_twist(command.twist, np.full(6, 1e-2))
                sent.append((where, features_message(frame.observation, head), command))
            due, number = time.perf_counter(), 0
            while process.poll() is None:
                messages = sent[number % _FRAMES]
                number, due = number + 1, due + 1.0 / RATE
                time.sleep(max(due - time.perf_counter(), 0.0))
                stamp = ros.node.get_clock().now().nanoseconds
                for publisher, message in zip(publishers, messages, strict=True):
                    fill_stamp(message.header.stamp, stamp)
                    publisher.publish(message)
            output, _ = process.communicate()
        finally:
            process.terminate()
            process.wait()
    return output.strip()


if __name__ == "__main__":
    main()
