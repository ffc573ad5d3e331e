# SPDX-License-Identifier: Apache-2.0
"""Node singularity_monitor: how near the camera is to a singularity, and alerts before things go wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from nav_msgs.msg import Path
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from plsing_msgs.msg import ControllerState, LineFeatureArray, SingularityAlert, SingularityStatus, SingularLoci
from plsing_msgs.srv import CheckPose
from plsing_ros.errors import PlsingError
from plsing_ros.levels import Level
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor as Monitor
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import (
    alert_message,
    fill_status,
    header,
    nanoseconds,
    observation_from_message,
    status_message,
    twist_from_message,
)
from plsing_ros.nodes.diagnostics import Diagnostics
from plsing_ros.nodes.locus_conversions import loci_message
from plsing_ros.nodes.main import run_node
from plsing_ros.nodes.markers import CameraMarkers, scene_markers
from plsing_ros.nodes.parameterized_node import ParameterizedNode
from plsing_ros.nodes.path_conversions import path_from_message
from plsing_ros.nodes.pose_conversions import camera_pose_from_message, covariance_from_message, pose_from_message
from plsing_ros.parameters import MonitorParameters

_DIAGNOSTIC_LEVELS = {
    Level.OK: DiagnosticStatus.OK,
    Level.WARN: DiagnosticStatus.WARN,
    Level.CRITICAL: DiagnosticStatus.ERROR,
    Level.STALE: DiagnosticStatus.STALE,
    Level.UNOBSERVABLE: DiagnosticStatus.ERROR,
    Level.DISABLED: DiagnosticStatus.OK,
}


class SingularityMonitorNode(ParameterizedNode[MonitorParameters]):
    """Answers each line_features with a singularity_status, and each change of level with a singularity_alerts."""

    def __init__(self, **options: Any) -> None:
        super().__init__("singularity_monitor", MonitorParameters, **options)
        # Roll-outs take a core, but neither the interpreter nor this node's callbacks.
        self._rollouts = ThreadPoolExecutor(1, "rollouts")
        self._latest: Assessment | None = None
        self._drawn: Assessment | None = None
        # The operator's word outlives what configure makes.
        self._enabled = True
        self._message = SingularityStatus()
        self._status = self.advertise(SingularityStatus, "singularity_status", qos.STATUS)
        self._alerts = self.advertise(SingularityAlert, "singularity_alerts", qos.LATCHED)
        self._loci = self.advertise(SingularLoci, "singular_loci", qos.LATCHED)
        self._scene_markers = self.advertise(MarkerArray, "singularity_markers", qos.LATCHED)
        self._camera_markers = self.advertise(MarkerArray, "camera_markers", qos.LATCHED)
        self._diagnostics = Diagnostics(self, self._report_diagnostics)
        self.subscribe(PoseWithCovarianceStamped, "camera_pose", self._on_pose, qos.SENSOR_DATA)
        self.subscribe(TwistStamped, "cmd_twist", self._on_twist, qos.COMMAND_INPUT)
        self.subscribe(LineFeatureArray, "desired_line_features", self._on_desired, qos.LATCHED)
        self.subscribe(LineFeatureArray, "line_features", self._on_features, qos.SENSOR_DATA)
        self.subscribe(ControllerState, "controller/state", self._on_controller, qos.STATUS)
        self.subscribe(Path, "controller/planned_path", self._on_path, qos.LATCHED)
        self.serve(SetBool, "~/enable", self._on_enable)
        self.serve(CheckPose, "~/check_pose", self._on_check_pose)
        self.create_steady_timer(self.parameters.heartbeat_period, self._on_heartbeat)
        self.create_steady_timer(self.parameters.marker_period, self._on_marker_timer)
        self.start()

    def configure(self) -> None:
        """Compute the singular set of the scene."""
        self._monitor = Monitor.from_parameters(self.parameters, self._rollouts)
        self._monitor.enabled = self._enabled
        self._latest = self._drawn = None

    def activate(self) -> None:
        """Publish the singular set."""
        self._publish_scene()

    def deactivate(self, reason: str) -> None:
        """Say that nobody watches any more."""
        self.fail(reason)

    def fail(self, reason: str) -> None:
        """Publish that the level is not known."""
        self._publish(self._monitor.unusable(reason, self.now()))

    def prepare(self, parameters: MonitorParameters) -> Callable[[], None]:
        """Use changed parameters from the next features on; a changed scene has its loci computed and published."""
        before = self._monitor.singular_set
        change_core = self._monitor.prepare(parameters)

        def put_in_force() -> None:
            change_core()
            if self.active and self._monitor.singular_set is not before:
                self._publish_scene()

        return put_in_force

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        try:
            pose = camera_pose_from_message(message, self.parameters.scene_frame)
        except PlsingError as error:
            self._monitor.forget_poses()
            self.warn_of("camera_pose refused", str(error))
        else:
            self.warn_of("camera_pose refused", "")
            self._monitor.receive_pose(pose, nanoseconds(message.header.stamp), covariance_from_message(message))

    def _on_twist(self, message: TwistStamped) -> None:
        try:
            twist = twist_from_message(message, self.parameters.camera_frame)
        except PlsingError as error:
            self.warn_of("cmd_twist not used for prediction", str(error))
        else:
            self.warn_of("cmd_twist not used for prediction", "")
            self._monitor.receive_twist(twist, nanoseconds(message.header.stamp))

    def _on_controller(self, message: ControllerState) -> None:
        self._monitor.receive_controller(message.law, message.gain)

    def _on_path(self, message: Path) -> None:
        try:
            path = path_from_message(message, self.parameters.scene_frame)
        except PlsingError as error:
            self.warn_of("planned_path not used for prediction", str(error))
            path = ()
        else:
            self.warn_of("planned_path not used for prediction", "")
        self._monitor.receive_path(path)

    def stop(self) -> None:
        """Say that nobody watches any more, and wait for no roll-out."""
        super().stop()
        self._rollouts.shutdown(wait=False, cancel_futures=True)

    def _on_desired(self, message: LineFeatureArray) -> None:
        try:
            self._monitor.set_target(observation_from_message(message, self.parameters.camera_frame))
        except PlsingError as error:
            self.get_logger().warning(f"desired_line_features not used as the target: {error}")

    def _on_features(self, message: LineFeatureArray) -> None:
        stamp = nanoseconds(message.header.stamp)
        try:
            observation = observation_from_message(message, self.parameters.camera_frame)
            assessment = self._monitor.answer(observation, stamp, self.now())
        except PlsingError as error:
            assessment = self._monitor.unusable(str(error), stamp)
        if assessment is not None:
            self._publish(assessment)
        self._diagnostics.count(stamp)
        # Only now: the thread of the roll-outs would take the interpreter from this callback.
        self._monitor.begin_rollout()

    def _on_heartbeat(self) -> None:
        assessment = self._monitor.silence(self.now())
        if assessment is not None:
            self._publish(assessment)

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._monitor.enabled = self._enabled = request.data
        response.success, response.message = True, "enabled" if request.data else "disabled: level DISABLED"
        return response

    def _on_check_pose(self, request: CheckPose.Request, response: CheckPose.Response) -> CheckPose.Response:
        try:
            pose = pose_from_message(request.pose, self.parameters.scene_frame)
            assessment = self._monitor.assess_pose(pose)
        except PlsingError as error:
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = True, f"{assessment.level.name}: {assessment.reason}"
            response.status = status_message(assessment, self._monitor.singular_set, self.parameters.camera_frame)
            response.status.header.stamp = request.pose.header.stamp
        return response

    def _publish(self, assessment: Assessment) -> None:
        previous, self._latest = self._latest, assessment
        if self._status.get_subscription_count():
            # One message for all: it is taken over before publish returns, and making one costs more than filling it.
            fill_status(self._message, assessment, self._monitor.singular_set, self.parameters.camera_frame)
            self._status.publish(self._message)
        if previous is not None and (previous.level, previous.kind) == (assessment.level, assessment.kind):
            return
        before = assessment.level if previous is None else previous.level
        alert = alert_message(assessment, before, self.parameters.camera_frame, self.parameters.scene_frame)
        self._alerts.publish(alert)
        self.report(alert.text, _DIAGNOSTIC_LEVELS[assessment.level])

    def _on_marker_timer(self) -> None:
        latest = self._latest
        if latest is None or latest.pose is None or latest is self._drawn:
            return
        self._drawn = latest
        markers = self._camera.markers(
            latest.pose,
            latest.level,
            f"{latest.level.name}: {latest.reason}",
            latest.conditioning.least_observable_direction
            if latest.conditioning and latest.unobservable_motion_text
            else None,
            header(latest.stamp, self.parameters.scene_frame),
        )
        self._camera_markers.publish(markers)

    def _report_diagnostics(self) -> tuple[bytes, str, Mapping[str, str]]:
        latest = self._latest
        if latest is None:
            return DiagnosticStatus.STALE, "no features received yet", {}
        nearest = "unknown" if latest.nearest is None else f"{latest.nearest.name}, {latest.nearest.distance:.3f} m"
        return (
            _DIAGNOSTIC_LEVELS[latest.level],
            f"{latest.level.name}: {latest.reason}",
            {"level": latest.level.name, "nearest locus": nearest},
        )

    def _publish_scene(self) -> None:
        found, head = self._monitor.singular_set, header(self.now(), self.parameters.scene_frame)
        self._loci.publish(loci_message(found, head))
        self._scene_markers.publish(scene_markers(found, head))
        self._camera = CameraMarkers(found)
        self.get_logger().info(
            f"singular set of {len(found.lines)} lines: {found.description} "
            f"{self.topics('line_features', 'singularity_status')}"
        )


_EXAMPLES = """examples:
  share=$(ros2 pkg prefix --share plsing_ros)
  ros2 run plsing_ros singularity_monitor --ros-args --params-file $share/config/paper_p4l.yaml
  ros2 topic echo /singularity_alerts
  ros2 param set /singularity_monitor warn.transversal_distance 0.3
  ros2 service call /singularity_monitor/check_pose plsing_msgs/srv/CheckPose \\
    "{pose: {pose: {position: {x: 0.7, y: -4.6, z: 7.8}, orientation: {w: 1.0}}}}"

All parameters with units and ranges: $share/config/singularity_monitor.yaml"""


def main() -> int:
    """Run the node."""
    return run_node(SingularityMonitorNode, __doc__.split("\n")[0], _EXAMPLES)


if __name__ == "__main__":
    sys.exit(main())
