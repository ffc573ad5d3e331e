"""Node singularity_monitor: how near the camera is to a singularity, and alerts before things go wrong."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from plsing_msgs.msg import LineFeatureArray, SingularityAlert, SingularityStatus, SingularLoci

from plsing_ros.errors import PlsingError
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import (
    alert_message,
    camera_pose_from_message,
    header,
    loci_message,
    nanoseconds,
    observation_from_message,
    status_message,
)
from plsing_ros.nodes.parameterized_node import ParameterizedNode
from plsing_ros.nodes.run import run_node
from plsing_ros.parameters import MonitorParameters
from plsing_ros.servoing.levels import Level
from plsing_ros.servoing.singularity_monitor import Assessment
from plsing_ros.servoing.singularity_monitor import SingularityMonitor as Monitor


class SingularityMonitor(ParameterizedNode[MonitorParameters]):
    """Answers each line_features with a singularity_status, and each change of level with a singularity_alerts."""

    def __init__(self, **options: Any) -> None:
        super().__init__("singularity_monitor", MonitorParameters, **options)
        try:
            self._monitor = Monitor(self.parameters)
        except PlsingError:
            self.destroy_node()
            raise
        self._level: Level | None = None
        self._status = self.publish_on(SingularityStatus, "singularity_status", qos.STATUS)
        self._alerts = self.publish_on(SingularityAlert, "singularity_alerts", qos.LATCHED)
        self._loci = self.publish_on(SingularLoci, "singular_loci", qos.LATCHED)
        self.listen_to(PoseWithCovarianceStamped, "camera_pose", self._on_pose, qos.SENSOR_DATA)
        self.listen_to(LineFeatureArray, "line_features", self._on_features, qos.SENSOR_DATA)
        self.every(self.parameters.heartbeat_period, self._on_heartbeat)
        self._publish_loci()

    def apply(self, parameters: MonitorParameters) -> None:
        """Use changed parameters from the next features on; a changed scene has its loci computed and published."""
        before = self._monitor.found
        self._monitor.parameters = parameters
        if self._monitor.found is not before:
            self._publish_loci()

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        try:
            pose = camera_pose_from_message(message, self.parameters.scene_frame)
        except PlsingError as error:
            self._monitor.forget_poses()
            self.get_logger().warning(f"camera_pose refused: {error}", throttle_duration_sec=1.0)
        else:
            self._monitor.receive_pose(pose, nanoseconds(message.header.stamp))

    def _on_features(self, message: LineFeatureArray) -> None:
        stamp = nanoseconds(message.header.stamp)
        try:
            observation = observation_from_message(message, self.parameters.camera_frame)
            assessment = self._monitor.assess(observation, stamp, self.now())
        except PlsingError as error:
            assessment = self._monitor.unusable(str(error), stamp)
        if assessment is not None:
            self._publish(assessment)

    def _on_heartbeat(self) -> None:
        assessment = self._monitor.silence(self.now())
        if assessment is not None:
            self._publish(assessment)

    def _publish(self, assessment: Assessment) -> None:
        self._status.publish(status_message(assessment, self._monitor.found, self.parameters.camera_frame))
        if assessment.level is self._level:
            return
        previous = assessment.level if self._level is None else self._level
        self._level = assessment.level
        alert = alert_message(assessment, previous, self.parameters.camera_frame)
        self._alerts.publish(alert)
        self.report(alert.text, good=assessment.level is Level.OK)

    def _publish_loci(self) -> None:
        found = self._monitor.found
        self._loci.publish(loci_message(found, header(self.now(), self.parameters.scene_frame)))
        self.get_logger().info(f"singular set of {len(found.lines)} lines: {found.description}")


_EXAMPLES = """examples:
  ros2 run plsing_ros singularity_monitor --ros-args --params-file config/paper_p4l.yaml
  ros2 topic echo /singularity_alerts
  ros2 param set /singularity_monitor warn.distance 0.3

All parameters with units and ranges: config/singularity_monitor.yaml"""


def main() -> int:
    """Run the node."""
    return run_node(SingularityMonitor, __doc__.split("\n")[0], _EXAMPLES)
