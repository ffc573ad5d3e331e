# SPDX-License-Identifier: Apache-2.0
"""Run a scene of the camera demo: all nodes as processes, and this one listens to what they publish."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from sensor_msgs.msg import Image, JointState

from plsing_msgs.msg import ControllerState, SimulatorState, SingularityAlert, SingularityStatus
from plsing_ros.geometry import Pose
from plsing_ros.geometry.rotations import exponential
from plsing_ros.levels import Level
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import header, nanoseconds
from plsing_ros.nodes.pose_conversions import camera_pose_from_message, camera_pose_message
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation.camera_record import CameraRecord, Picture
from plsing_ros.simulation.camera_scene import SCENE_FILE, CameraScene
from plsing_ros.simulation.run_record import Alert
from plsing_ros.testing.harness import Harness
from plsing_ros.testing.node_processes import NodeProcesses

_STARTUP = 60.0  # [s]
_STAYS = 1.0  # at the target [s]
_BETWEEN = 0.3  # pictures that are kept [s]
_COMPLETED = {"line_features": "completed_line_features"}
_NODES: dict[str, dict[str, str]] = {
    "line_tracker": {},
    "pose_estimator": {},
    "controller": _COMPLETED,
    "singularity_monitor": _COMPLETED,
}
# Of the pose that the tracker begins with [m] and [rad].
_FIRST_OFF = np.array([0.003, -0.003, 0.002]), np.radians([1.0, -1.0, 0.5])


def run_camera_scene(
    scene: CameraScene, on_alert: Callable[[Alert], None], on_distance: Callable[[float, float], None]
) -> CameraRecord:
    """Run a scene in real time until it has arrived and stays, or its time is over.

    Args:
        scene: What to run.
        on_alert: Called with each alert of the monitor.
        on_distance: Called with the time [s] and the distance [m] from the target of each frame.

    Raises:
        PlsingError: If a node ends by itself, or nothing comes.
    """
    file = config_file(SCENE_FILE)
    record = CameraRecord(scene)
    with Harness(log_level="FATAL") as ros, NodeProcesses(ros.environment()) as processes:
        listener = _Listener(ros, record, on_alert, on_distance)
        for node, remap in _NODES.items():
            processes.start(node, [file], scene.values(node), remap)
        first = ros.node.create_publisher(PoseWithCovarianceStamped, "initial_pose", qos.STATUS)
        wanted = ("line_tracker", "pose_estimator", "controller", "singularity_monitor")

        def ready() -> bool:
            processes.check()
            return first.get_subscription_count() > 0 and set(wanted) <= set(ros.node.get_node_names())

        ros.spin_until(ready, "the nodes to start", _STARTUP)
        shift, turn = _FIRST_OFF
        pose = Pose(scene.start.rotation @ exponential(turn)[0], scene.start.translation + shift)
        first.publish(camera_pose_message(pose, header(ros.node.get_clock().now().nanoseconds, "world")))
        processes.start("arm_simulator", [file], scene.values("arm_simulator"), {"camera_pose": "true_camera_pose"})

        def begun() -> bool:
            processes.check()
            return bool(record.rows)

        ros.spin_until(begun, "the first image", _STARTUP)
        end = time.monotonic() + scene.max_time
        while time.monotonic() < end and not record.stays(_STAYS):
            processes.check()
            ros.spin_for(0.1)
        listener.close()
    record.arrived = record.stays(_STAYS)
    return record


class _Listener:
    """Writes into a record what is published."""

    def __init__(
        self,
        ros: Harness,
        record: CameraRecord,
        on_alert: Callable[[Alert], None],
        on_distance: Callable[[float, float], None],
    ) -> None:
        self._record, self._on_alert, self._on_distance = record, on_alert, on_distance
        self._joints = np.zeros(6)
        node = ros.node
        node.create_subscription(PoseWithCovarianceStamped, "true_camera_pose", self._on_pose, qos.SENSOR_DATA)
        node.create_subscription(JointState, "joint_states", self._on_joints, qos.SENSOR_DATA)
        node.create_subscription(Image, "line_tracker/overlay", self._on_overlay, qos.SENSOR_DATA)
        node.create_subscription(TwistStamped, "cmd_twist", self._on_twist, qos.COMMAND_INPUT)
        node.create_subscription(SingularityStatus, "singularity_status", self._on_status, qos.STATUS)
        node.create_subscription(SingularityAlert, "singularity_alerts", self._on_alert_message, qos.LATCHED)
        node.create_subscription(DiagnosticArray, "line_tracker/state", self._on_tracker, qos.STATUS)
        node.create_subscription(ControllerState, "controller/state", self._on_controller, qos.STATUS)
        node.create_subscription(SimulatorState, "arm_simulator/state", self._on_arm, qos.STATUS)
        self._open = True

    def close(self) -> None:
        """Take no more notice."""
        self._open = False

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        if self._open:
            pose = camera_pose_from_message(message, message.header.frame_id)
            self._on_distance(*self._record.add(nanoseconds(message.header.stamp), pose))

    def _on_joints(self, message: JointState) -> None:
        self._joints = np.array(message.position)

    def _on_overlay(self, message: Image) -> None:
        record = self._record
        at = record.time_of(nanoseconds(message.header.stamp))
        if self._open and (not record.pictures or at - record.pictures[-1].time >= _BETWEEN):
            pixels = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width, 3)
            record.pictures.append(Picture(at, pixels[..., ::-1].copy(), self._joints))

    def _on_twist(self, message: TwistStamped) -> None:
        v, w = message.twist.linear, message.twist.angular
        stamp = nanoseconds(message.header.stamp)
        self._record.twists.append((self._record.time_of(stamp), np.array([v.x, v.y, v.z, w.x, w.y, w.z])))

    def _on_status(self, message: SingularityStatus) -> None:
        risk = message.risk if message.risk_valid else float("nan")
        at = self._record.time_of(nanoseconds(message.header.stamp))
        if self._open and message.line_count:
            self._record.statuses.append((at, message.inverse_condition_number, risk))

    def _on_alert_message(self, message: SingularityAlert) -> None:
        if self._open:
            at = self._record.time_of(nanoseconds(message.header.stamp))
            alert = Alert(at, Level(message.level), message.text)
            self._record.alerts.append(alert)
            self._on_alert(alert)

    def _on_tracker(self, message: DiagnosticArray) -> None:
        self._record.last_words["line_tracker"] = f"{message.status[0].name} {message.status[0].message}".strip()

    def _on_controller(self, message: ControllerState) -> None:
        self._record.last_words["controller"] = message.reason

    def _on_arm(self, message: SimulatorState) -> None:
        self._record.last_words["arm_simulator"] = message.reason
