# SPDX-License-Identifier: Apache-2.0
"""Node line_tracker: line features of a known object from the images of a calibrated camera."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from sensor_msgs.msg import CameraInfo, Image

from plsing_msgs.msg import LineFeatureArray
from plsing_ros.errors import GeometryError, PlsingError
from plsing_ros.features import LineObservation
from plsing_ros.geometry.pose import Pose, checked_twist
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import features_message, header, nanoseconds
from plsing_ros.nodes.diagnostics import Diagnostics
from plsing_ros.nodes.image_conversions import camera_from_message, grey_from_message, image_message
from plsing_ros.nodes.main import run_node
from plsing_ros.nodes.parameterized_node import ParameterizedNode
from plsing_ros.nodes.pose_conversions import camera_pose_from_message, camera_pose_message
from plsing_ros.parameters.line_tracker import LineTrackerParameters
from plsing_ros.stamp_filter import StampFilter
from plsing_ros.tracking.session import SessionReport, SessionState, TrackingSession

_LEVELS = {SessionState.TRACKING: DiagnosticStatus.OK, SessionState.WEAK: DiagnosticStatus.WARN}
# A twist moves the camera for as long as this after it came, at most [s].
_MAX_PREDICTION = 0.2


class LineTrackerNode(ParameterizedNode[LineTrackerParameters]):
    """Answers each image with line_features, ~/state and, where the object is found, tracked_camera_pose.

    Lines are usable while the state is TRACKING or WEAK; else none is, so that a controller halts by itself.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("line_tracker", LineTrackerParameters, **options)
        self._latest: SessionReport | None = None
        self._features = self.advertise(LineFeatureArray, "line_features", qos.SENSOR_DATA)
        self._pose = self.advertise(PoseWithCovarianceStamped, "tracked_camera_pose", qos.SENSOR_DATA)
        self._state = self.advertise(DiagnosticArray, "~/state", qos.STATUS)
        self._overlay = self.advertise(Image, "~/overlay", qos.SENSOR_DATA)
        self._diagnostics = Diagnostics(self, self._report_diagnostics)
        self.subscribe(CameraInfo, "camera_info", self._on_camera_info, qos.SENSOR_DATA)
        self.subscribe(PoseWithCovarianceStamped, "initial_pose", self._on_initial_pose, qos.STATUS)
        self.subscribe(TwistStamped, "cmd_twist", self._on_twist, qos.COMMAND_INPUT)
        self.subscribe(Image, "image", self._on_image, qos.SENSOR_DATA)
        self.create_steady_timer(self.parameters.watchdog_period, self._on_watchdog)
        self.start()

    def configure(self) -> None:
        """Read the model."""
        parameters = self.parameters
        self._model = parameters.model()
        self._session = TrackingSession(
            self._model,
            parameters.use_points,
            parameters.gamma,
            parameters.max_repeats,
            parameters.tag(),
            parameters.readout_time,
            parameters.edge_std(),
        )
        self._stamps = StampFilter("images", parameters.image_timeout, parameters.future_tolerance)
        self._twist: tuple[Any, int] | None = None
        self._latest, self._silent = None, False

    def activate(self) -> None:
        """Say what it is going to do."""
        self.get_logger().info(
            f"an object of {len(self._model)} edges in {self.parameters.scene_frame}, followed by its edges"
            f"{' and points' if self.parameters.use_points else ''}; {self.topics('image', 'line_features')}"
        )

    def deactivate(self, reason: str) -> None:
        """Say that nothing is tracked any more."""
        self.fail(reason)

    def fail(self, reason: str) -> None:
        """Publish that no line can be used."""
        self._publish(SessionReport(SessionState.LOST, reason), self.now())

    def prepare(self, parameters: LineTrackerParameters) -> Callable[[], None]:
        """Use changed time limits from the next image on."""

        def put_in_force() -> None:
            self._stamps = StampFilter("images", parameters.image_timeout, parameters.future_tolerance)

        return put_in_force

    def _on_camera_info(self, message: CameraInfo) -> None:
        try:
            self._session.set_camera(camera_from_message(message))
        except GeometryError as error:
            self._session.refuse_camera(f"camera_info cannot be used: {error}")

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        try:
            pose = camera_pose_from_message(message, self.parameters.scene_frame, "initial_pose")
            self._session.set_pose(pose)
        except GeometryError as error:
            self.report(f"initial_pose refused: {error}", DiagnosticStatus.WARN)

    def _on_twist(self, message: TwistStamped) -> None:
        linear, angular = message.twist.linear, message.twist.angular
        try:
            twist = checked_twist("cmd_twist", [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z])
        except GeometryError:
            self._twist = None
            return
        self._twist = (twist, nanoseconds(message.header.stamp))

    def _on_image(self, message: Image) -> None:
        stamp, before = nanoseconds(message.header.stamp), self._stamps.last_stamp
        refusal = self._stamps.refusal(stamp, self.now())
        if refusal is not None:
            report = SessionReport(SessionState.LOST, refusal)
        else:
            try:
                if message.header.frame_id not in ("", self.parameters.camera_frame):
                    raise GeometryError(
                        f"the image is in frame '{message.header.frame_id}', expected "
                        f"'{self.parameters.camera_frame}' (parameter camera_frame)"
                    )
                grey = grey_from_message(message)
                report = self._session.process(grey, self._predicted(stamp, before), 1e-9 * stamp)
                self._draw(grey, report, stamp)
            except PlsingError as error:
                report = SessionReport(SessionState.LOST, str(error))
        self._silent = False
        self._publish(report, stamp)
        self._diagnostics.count(stamp)

    def _predicted(self, stamp: int, before: int | None) -> Pose | None:
        """Return where the camera is by the last pose and the twist commanded since; None if there is no twist."""
        pose = self._session.T_world_camera
        if self._twist is None or before is None or pose is None:
            return None
        twist, commanded = self._twist
        elapsed = (stamp - before) * 1e-9
        if not 0.0 < elapsed < _MAX_PREDICTION or not abs(stamp - commanded) * 1e-9 < _MAX_PREDICTION:
            return None
        return pose.integrate(twist, elapsed)

    def _on_watchdog(self) -> None:
        reason = self._stamps.silence(self.now())
        if reason is None:
            self._silent = False
        elif not self._silent:
            self._silent = True
            self._publish(SessionReport(SessionState.LOST, reason), self.now())

    def _publish(self, report: SessionReport, stamp: int) -> None:
        tracking = report.tracking
        if tracking is not None and report.usable:
            observation = tracking.observation
        else:
            n = len(self._model)
            observation = LineObservation(self._model.ids, np.zeros((n, 3)), np.zeros(n, dtype=bool))
        self._features.publish(features_message(observation, header(stamp, self.parameters.camera_frame)))
        if tracking is not None and tracking.T_world_camera is not None and report.usable:
            in_scene = header(stamp, self.parameters.scene_frame)
            self._pose.publish(camera_pose_message(tracking.T_world_camera, in_scene, tracking.covariance))
        state = DiagnosticArray(header=header(stamp, self.parameters.scene_frame))
        level, text, values = self._described(report)
        state.status = [
            DiagnosticStatus(
                level=level,
                name=report.state.name,
                message=text,
                hardware_id=self.get_name(),
                values=[KeyValue(key=key, value=value) for key, value in values.items()],
            )
        ]
        self._state.publish(state)
        previous, self._latest = self._latest, report
        if previous is None or previous.state is not report.state:
            level = DiagnosticStatus.OK if report.state is SessionState.TRACKING else DiagnosticStatus.WARN
            self.report(f"{report.state.name}  {report.reason}".strip(), level)

    def _draw(self, grey: Any, report: SessionReport, stamp: int) -> None:
        camera, tracking = self._session.camera, report.tracking
        if not self._overlay.get_subscription_count() or camera is None:
            return
        try:
            cv = importlib.import_module("cv2")
        except ImportError:
            return
        picture = cv.cvtColor(grey, cv.COLOR_GRAY2BGR)
        if tracking is not None and tracking.T_world_camera is not None:
            points = self._model.vertices - tracking.T_world_camera.translation
            corners = points @ tracking.T_world_camera.rotation
            if corners[:, 2].min() > 0.0:
                pixels = np.round(8.0 * camera.project(corners)).astype(int)
                for row, (a, b) in enumerate(self._model.edges.tolist()):
                    color = (0, 220, 0) if tracking.observation.usable[row] else (0, 0, 220)
                    cv.line(picture, pixels[a].tolist(), pixels[b].tolist(), color, 1, cv.LINE_AA, 3)
        cv.putText(picture, report.state.name, (8, 20), cv.FONT_HERSHEY_SIMPLEX, 0.6, (0, 220, 255), 2)
        self._overlay.publish(image_message(picture, header(stamp, self.parameters.camera_frame)))

    def _described(self, report: SessionReport) -> tuple[bytes, str, dict[str, str]]:
        values = {"state": report.state.name}
        if report.tracking is not None:
            tracking = report.tracking
            values |= {
                "usable lines": str(int(tracking.observation.usable.sum()) if report.usable else 0),
                "share of visible edges explained": f"{tracking.support:.2f}",
                "share explained by chance": f"{tracking.chance:.2f}",
                "points": str(tracking.point_count),
            }
        return _LEVELS.get(report.state, DiagnosticStatus.ERROR), report.reason, values

    def _report_diagnostics(self) -> tuple[bytes, str, Mapping[str, str]]:
        if self._latest is None:
            return DiagnosticStatus.STALE, "no image received yet", {}
        level, text, values = self._described(self._latest)
        return level, f"{self._latest.state.name} {text}".strip(), values


_EXAMPLES = """examples:
  ros2 run plsing_ros line_tracker --ros-args -p model.file:=part.obj -r image:=/camera/image_rect
  ros2 topic echo /line_tracker/state

Needs camera_info, and one initial_pose (geometry_msgs/PoseWithCovarianceStamped of the camera in the scene) or a tag.
All parameters with units and ranges: config/line_tracker.yaml"""


def main() -> int:
    """Run the node."""
    return run_node(LineTrackerNode, __doc__.split("\n")[0], _EXAMPLES)


if __name__ == "__main__":
    sys.exit(main())
