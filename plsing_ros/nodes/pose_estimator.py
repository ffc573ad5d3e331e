# SPDX-License-Identifier: Apache-2.0
"""Node pose_estimator: the camera pose from image lines and its motion, and how far it can be trusted."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped

from plsing_msgs.msg import LineFeatureArray, PoseEstimate
from plsing_ros.errors import PlsingError
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import (
    features_message,
    header,
    nanoseconds,
    observation_from_message,
    twist_from_message,
)
from plsing_ros.nodes.diagnostics import Diagnostics
from plsing_ros.nodes.main import run_node
from plsing_ros.nodes.parameterized_node import ParameterizedNode
from plsing_ros.nodes.pose_conversions import camera_pose_message, pose_estimate_message
from plsing_ros.nodes.pose_transform import PoseTransform
from plsing_ros.parameters import PoseEstimatorParameters
from plsing_ros.pose import Verdict
from plsing_ros.pose.pose_tracker import PoseTracker, TrackedPose

_DIAGNOSTIC_LEVELS = {
    Verdict.OK: DiagnosticStatus.OK,
    Verdict.POOR: DiagnosticStatus.WARN,
    Verdict.AMBIGUOUS: DiagnosticStatus.ERROR,
    Verdict.FAILED: DiagnosticStatus.ERROR,
    Verdict.LOST: DiagnosticStatus.ERROR,
}


class PoseEstimatorNode(ParameterizedNode[PoseEstimatorParameters]):
    """Answers each line_features with ~/state and completed_line_features, and with camera_pose where there is a pose.

    Features without a pose carry the reason alone, so that controller and monitor know that features come.
    A pose that another one is as plausible as is not published on camera_pose; the features completed with it carry
    the verdict, which the controller and the monitor act on.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("pose_estimator", PoseEstimatorParameters, **options)
        self._latest: TrackedPose | None = None
        self._pose = self.advertise(PoseWithCovarianceStamped, "camera_pose", qos.SENSOR_DATA)
        parameters = self.parameters
        self._transform = PoseTransform(self, parameters.publish_tf, parameters.scene_frame, parameters.camera_frame)
        self._completed = self.advertise(LineFeatureArray, "completed_line_features", qos.SENSOR_DATA)
        self._state = self.advertise(PoseEstimate, "~/state", qos.STATUS)
        self._diagnostics = Diagnostics(self, self._report_diagnostics)
        # Before the features, so that of what has come together the motion is taken first.
        self.subscribe(TwistStamped, self.parameters.twist_source, self._on_twist, qos.COMMAND_INPUT)
        self.subscribe(LineFeatureArray, "line_features", self._on_features, qos.SENSOR_DATA)
        self.create_steady_timer(self.parameters.watchdog_period, self._on_watchdog)
        self.start()

    def configure(self) -> None:
        """Prepare the scene for the search of poses."""
        self._tracking = PoseTracker(self.parameters)
        self._latest = None

    def activate(self) -> None:
        """Say what it is going to do."""
        parameters = self.parameters
        self.get_logger().info(
            f"{len(parameters.lines_points) // 3} lines in {parameters.scene_frame}; "
            f"{self.topics('line_features', 'completed_line_features')}"
        )

    def deactivate(self, reason: str) -> None:
        """Say that no pose is known any more."""
        self.fail(reason)

    def fail(self, reason: str) -> None:
        """Publish that there is no pose."""
        self._publish(self._tracking.fail(reason), self.now())

    def prepare(self, parameters: PoseEstimatorParameters) -> Callable[[], None]:
        """Use changed parameters from the next features on."""
        return self._tracking.prepare(parameters)

    def _on_twist(self, message: TwistStamped) -> None:
        try:
            twist = twist_from_message(message, self.parameters.camera_frame, self.parameters.twist_source)
        except PlsingError as error:
            self.warn_of(f"{self.parameters.twist_source} not used", str(error))
        else:
            self.warn_of(f"{self.parameters.twist_source} not used", "")
            self._tracking.receive_twist(twist, nanoseconds(message.header.stamp))

    def _on_features(self, message: LineFeatureArray) -> None:
        stamp = nanoseconds(message.header.stamp)
        try:
            observation = observation_from_message(message, self.parameters.camera_frame)
            tracked = self._tracking.track(observation, stamp, self.now())
        except PlsingError as error:
            tracked = self._tracking.fail(str(error))
        self._publish(tracked, stamp)
        self._diagnostics.count(stamp)

    def _on_watchdog(self) -> None:
        tracked = self._tracking.silence(self.now())
        if tracked is not None:
            self._publish(tracked, self.now())

    def _publish(self, tracked: TrackedPose, stamp: int) -> None:
        estimate, in_scene = tracked.estimate, header(stamp, self.parameters.scene_frame)
        if estimate.T_world_camera is not None and estimate.verdict is not Verdict.AMBIGUOUS:
            self._pose.publish(camera_pose_message(estimate.T_world_camera, in_scene, estimate.covariance))
            self._transform.publish(estimate.T_world_camera, stamp)
        if tracked.completed is not None:
            in_camera = header(stamp, self.parameters.camera_frame)
            self._completed.publish(features_message(tracked.completed, in_camera))
        self._state.publish(pose_estimate_message(estimate, in_scene))
        previous, self._latest = self._latest, tracked
        if previous is None or previous.estimate.verdict is not estimate.verdict:
            self.report(f"{estimate.verdict.name}  {estimate.reason}".strip(), _DIAGNOSTIC_LEVELS[estimate.verdict])

    def _report_diagnostics(self) -> tuple[bytes, str, Mapping[str, str]]:
        if self._latest is None:
            return DiagnosticStatus.STALE, "no features received yet", {}
        estimate = self._latest.estimate
        nearest = estimate.nearest
        return (
            _DIAGNOSTIC_LEVELS[estimate.verdict],
            f"{estimate.verdict.name} {estimate.reason}".strip(),
            {
                "source": estimate.source,
                "innovation [standard deviations]": f"{estimate.innovation:.3g}",
                "covariance": "trusted" if estimate.covariance_trusted else "not to be trusted",
                "standard deviation of the position [m]": f"{estimate.position_deviation:.3g}",
                "standard deviation of the orientation [rad]": f"{estimate.rotation_deviation:.3g}",
                "inverse condition number": f"{estimate.inverse_condition_number:.4g}",
                "nearest locus": "none" if nearest is None else f"{nearest.name}, {nearest.distance:.3f} m",
            },
        )


_EXAMPLES = """examples:
  share=$(ros2 pkg prefix --share plsing_ros)
  ros2 run plsing_ros pose_estimator --ros-args --params-file $share/config/paper_p4l.yaml
  ros2 topic echo /pose_estimator/state --field verdict

The whole chain without ground truth: the simulator shows image lines only, the others use the estimate.
  ros2 run plsing_ros feature_simulator --ros-args --params-file $share/config/paper_p4l.yaml \\
      -p image_only:=true -r camera_pose:=true_camera_pose
  ros2 run plsing_ros controller --ros-args --params-file $share/config/paper_p4l.yaml \\
      -r line_features:=completed_line_features
  ros2 run plsing_ros singularity_monitor --ros-args --params-file $share/config/paper_p4l.yaml \\
      -r line_features:=completed_line_features

All parameters with units and ranges: $share/config/pose_estimator.yaml"""


def main() -> int:
    """Run the node."""
    return run_node(PoseEstimatorNode, __doc__.split("\n")[0], _EXAMPLES)


if __name__ == "__main__":
    sys.exit(main())
