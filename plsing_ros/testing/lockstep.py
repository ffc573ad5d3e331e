# SPDX-License-Identifier: Apache-2.0
"""Simulator, controller and monitor in one process, in lockstep over the real topics, with everything recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped

from plsing_msgs.msg import LineFeatureArray, SingularityAlert, SingularityStatus, SingularLoci
from plsing_ros.levels import Level
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.conversions import twist_from_message
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.pose_conversions import camera_pose_from_message
from plsing_ros.nodes.pose_estimator import PoseEstimatorNode
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode
from plsing_ros.simulation.run_record import Alert, RunRecord
from plsing_ros.simulation.stepping import FIRST_STAMP
from plsing_ros.testing.harness import Harness
from plsing_ros.testing.recorder import BagRecorder
from plsing_ros.testing.synchronizer import BEST_EFFORT, RELIABLE, FrameSynchronizer, has_come, stamp_of, taken

_SECOND = 1_000_000_000
_RECORDED = [
    (LineFeatureArray, "line_features", BEST_EFFORT),
    (LineFeatureArray, "completed_line_features", BEST_EFFORT),
    (LineFeatureArray, "desired_line_features", qos.LATCHED),
    (PoseWithCovarianceStamped, "camera_pose", BEST_EFFORT),
    (TwistStamped, "cmd_twist", RELIABLE),
    (SingularLoci, "singular_loci", qos.LATCHED),
    (SingularityAlert, "singularity_alerts", qos.LATCHED),
]


def run_lockstep(
    name: str,
    params_file: Path,
    start: Mapping[str, Any],
    target: Mapping[str, Any],
    arrived: float,
    max_steps: int,
    on_frame: Callable[[int, float], None] = lambda number, distance: None,
    on_alert: Callable[[Alert], None] = lambda alert: None,
    executor: str = "events",
    estimate_pose: bool = False,
    record: Path | None = None,
) -> RunRecord:
    """Run the three nodes from a start until the camera is at the target.

    Args:
        name: Of the run, for the record.
        params_file: Parameter file for all three nodes.
        start: Parameters of the simulator over those of the file (start.position, ...).
        target: Parameters of the controller over those of the file (target.position, ...).
        arrived: Distance to the target at which the run ends [m].
        max_steps: Frames after which the run ends anyway.
        on_frame: Called with each frame's number and distance to the target [m].
        on_alert: Called with each alert as it comes in.
        executor: As in plsing_ros.nodes.main.make_executor.
        estimate_pose: The simulator shows image lines only, and a pose_estimator completes them for the others.
        record: Folder to record the topics into, for the command replay; it must not exist.

    Raises:
        PlsingError: If a parameter is refused, the loop stops, or a message was lost.
    """
    with Harness(executor, log_level="ERROR") as ros, ExitStack() as recording:
        if record is not None:
            recording.enter_context(BagRecorder(ros.node, record, _RECORDED))
        truth = "true_camera_pose" if estimate_pose else "camera_pose"
        completed = {"line_features": "completed_line_features"} if estimate_pose else {}
        frames = FrameSynchronizer(ros, truth)
        statuses = ros.collect(SingularityStatus, "singularity_status", RELIABLE)
        alerts = ros.collect(SingularityAlert, "singularity_alerts", qos.LATCHED)
        ros.add(SingularityMonitorNode, params_file, {"use_sim_time": True}, completed)
        controller = ros.add(ControllerNode, params_file, {"use_sim_time": True, **target}, completed)
        if estimate_pose:
            ros.add(PoseEstimatorNode, params_file, {"use_sim_time": True})
        in_lockstep = {
            "mode": "lockstep",
            "publish_clock": True,
            "wait_for_status": True,
            "image_only": estimate_pose,
        }
        simulator = ros.add(FeatureSimulatorNode, params_file, {**in_lockstep, **start}, {"camera_pose": truth})
        destination = controller.parameters.target_pose().translation
        time_step = round(simulator.parameters.time_step * _SECOND)

        reported: list[Alert] = []
        rows, is_there = [], False
        for number in range(1, max_steps + 1):
            stamp = FIRST_STAMP + (number - 1) * time_step
            ros.spin_until(
                lambda: frames.have_come(stamp) and has_come(statuses, stamp, _is_of_run),
                f"frame {number} of {name}",
            )
            rows.append((*frames.of(stamp), taken(statuses, stamp, _is_of_run)))
            pose = camera_pose_from_message(rows[-1][0], simulator.parameters.scene_frame)
            distance = float(np.linalg.norm(pose.translation - destination))
            on_frame(number, distance)
            of_run = [each for each in alerts if stamp_of(each) >= FIRST_STAMP]
            for message in of_run[len(reported) :]:
                seconds = (stamp_of(message) - FIRST_STAMP) / _SECOND
                reported.append(Alert(seconds, Level(message.level), message.text))
                on_alert(reported[-1])
            is_there = distance <= arrived
            if is_there:
                break

        scene_frame, camera_frame = simulator.parameters.scene_frame, simulator.parameters.camera_frame
        return RunRecord(
            name,
            np.arange(len(rows)) * time_step / _SECOND,
            np.array([camera_pose_from_message(pose, scene_frame).translation for pose, _, _, _ in rows]),
            np.array([twist_from_message(twist, camera_frame) for _, twist, _, _ in rows]),
            np.array([state.error_norm for _, _, state, _ in rows]),
            np.array([status.inverse_condition_number for _, _, _, status in rows]),
            destination,
            is_there,
            tuple(reported),
        )


def _is_of_run(status: SingularityStatus) -> bool:
    # Before the first frame the monitor truly says that it has no features.
    return status.level != SingularityStatus.LEVEL_STALE
