"""Simulator, controller and monitor in one process, in lockstep over the real topics, with everything recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from rclpy.qos import QoSProfile

from plsing_msgs.msg import ControllerState, SingularityAlert, SingularityStatus
from plsing_ros.errors import PlsingError
from plsing_ros.experiments.run_record import Alert, RunRecord
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import Controller
from plsing_ros.nodes.conversions import nanoseconds, twist_from_message
from plsing_ros.nodes.feature_simulator import FeatureSimulator
from plsing_ros.nodes.harness import Collected, Harness
from plsing_ros.nodes.pose_conversions import camera_pose_from_message
from plsing_ros.nodes.pose_estimator import PoseEstimator
from plsing_ros.nodes.singularity_monitor import SingularityMonitor
from plsing_ros.servoing.monitoring.levels import Level
from plsing_ros.servoing.simulation import FIRST_STAMP

_SECOND = 1_000_000_000


def run_closed_loop(
    name: str,
    params_file: Path,
    start: Mapping[str, Any],
    target: Mapping[str, Any],
    arrived: float,
    most_steps: int,
    on_frame: Callable[[int, float], None] = lambda number, distance: None,
    on_alert: Callable[[Alert], None] = lambda alert: None,
    executor: str = "events",
    estimate_pose: bool = False,
) -> RunRecord:
    """Run the three nodes from a start until the camera is at the target.

    Args:
        name: Of the run, for the record.
        params_file: Parameter file for all three nodes.
        start: Parameters of the simulator over those of the file (start.position, ...).
        target: Parameters of the controller over those of the file (target.position, ...).
        arrived: Distance to the target at which the run ends [m].
        most_steps: Frames after which the run ends anyway.
        on_frame: Called with each frame's number and distance to the target [m].
        on_alert: Called with each alert as it comes in.
        executor: As in plsing_ros.nodes.run.make_executor.
        estimate_pose: The simulator shows image lines only, and a pose_estimator completes them for the others.

    Raises:
        PlsingError: If a parameter is refused, the loop stops, or a message was lost.
    """
    with Harness(executor, log_level="ERROR") as ros:
        best_effort = QoSProfile(depth=100, reliability=qos.SENSOR_DATA.reliability)
        reliable = QoSProfile(depth=100)
        truth = "true_camera_pose" if estimate_pose else "camera_pose"
        completed = {"line_features": "completed_line_features"} if estimate_pose else {}
        poses = ros.collect(PoseWithCovarianceStamped, truth, best_effort)
        twists = ros.collect(TwistStamped, "cmd_twist", reliable)
        states = ros.collect(ControllerState, "controller/state", reliable)
        statuses = ros.collect(SingularityStatus, "singularity_status", reliable)
        alerts = ros.collect(SingularityAlert, "singularity_alerts", qos.LATCHED)
        ros.add(SingularityMonitor, params_file, {"use_sim_time": True}, completed)
        controller = ros.add(Controller, params_file, {"use_sim_time": True, **target}, completed)
        if estimate_pose:
            ros.add(PoseEstimator, params_file, {"use_sim_time": True})
        in_lockstep = {
            "mode": "lockstep",
            "publish_clock": True,
            "wait_for_status": True,
            "image_only": estimate_pose,
        }
        simulator = ros.add(FeatureSimulator, params_file, {**in_lockstep, **start}, {"camera_pose": truth})
        destination = controller.parameters.target_pose().translation
        time_step = round(simulator.parameters.time_step * _SECOND)

        reported: list[Alert] = []
        stamp, is_there = FIRST_STAMP, False
        for number in range(1, most_steps + 1):
            stamp = FIRST_STAMP + (number - 1) * time_step
            ros.spin_until(
                lambda: all(each and stamp_of(each[-1]) >= stamp for each in (poses, twists, states, statuses)),
                f"frame {number} of {name}",
            )
            pose = camera_pose_from_message(message_of_stamp(poses, stamp), simulator.parameters.scene_frame)
            distance = float(np.linalg.norm(pose.translation - destination))
            on_frame(number, distance)
            # Before the first frame the monitor truly says that it has no features; that is not part of the run.
            of_run = [each for each in alerts if stamp_of(each) >= FIRST_STAMP]
            for message in of_run[len(reported) :]:
                seconds = (stamp_of(message) - FIRST_STAMP) / _SECOND
                reported.append(Alert(seconds, Level(message.level), message.text))
                on_alert(reported[-1])
            is_there = distance <= arrived
            if is_there:
                break

        stamps = range(FIRST_STAMP, stamp + 1, time_step)
        frame = simulator.parameters.camera_frame
        return RunRecord(
            name,
            (np.array(stamps) - FIRST_STAMP) / _SECOND,
            np.array(
                [
                    camera_pose_from_message(each, simulator.parameters.scene_frame).translation
                    for each in _rows(poses, stamps)
                ]
            ),
            np.array([twist_from_message(each, frame) for each in _rows(twists, stamps)]),
            np.array([each.error_norm for each in _rows(states, stamps)]),
            np.array([each.inverse_condition_number for each in _rows(statuses, stamps)]),
            destination,
            is_there,
            tuple(reported),
        )


def stamp_of(message: Any) -> int:
    """Return a message's stamp [ns]."""
    return nanoseconds(message.header.stamp)


def message_of_stamp(messages: Collected, stamp: int) -> Any:
    """Return the latest message with a stamp [ns].

    Raises:
        PlsingError: If there is none.
    """
    found = next((each for each in reversed(messages) if stamp_of(each) == stamp), None)
    if found is None:
        raise PlsingError(
            f"the message of {messages.topic} at {stamp / _SECOND:g} s was lost; is the machine overloaded?"
        )
    return found


def _rows(messages: Collected, stamps: Sequence[int]) -> list[Any]:
    by_stamp = {stamp_of(each): each for each in messages}
    missing = [each for each in stamps if each not in by_stamp]
    if missing:
        raise PlsingError(
            f"{len(missing)} of {len(stamps)} messages of {messages.topic} were lost, the first at "
            f"{missing[0] / _SECOND:g} s; is the machine overloaded?"
        )
    return [by_stamp[each] for each in stamps]
