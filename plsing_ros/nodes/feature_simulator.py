# SPDX-License-Identifier: Apache-2.0
"""Node feature_simulator: the line features of a free-flying camera that moves by the twists it receives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from plsing_msgs.msg import LineFeatureArray, SimulatorState, SingularityStatus
from plsing_ros.errors import PlsingError
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import (
    fill_features,
    fill_stamp,
    fill_twist,
    nanoseconds,
    twist_from_message,
)
from plsing_ros.nodes.diagnostics import Diagnostics
from plsing_ros.nodes.main import run_node
from plsing_ros.nodes.parameterized_node import ParameterizedNode
from plsing_ros.nodes.pose_conversions import fill_pose
from plsing_ros.parameters import SimulatorParameters
from plsing_ros.simulation.simulation import Frame, Simulation


class FeatureSimulatorNode(ParameterizedNode[SimulatorParameters]):
    """Publishes line_features and camera_pose, integrates cmd_twist; ~/reset puts the camera back to its start."""

    def __init__(self, **options: Any) -> None:
        super().__init__("feature_simulator", SimulatorParameters, **options)
        parameters = self.parameters
        self._lockstep = parameters.mode == "lockstep"
        self._stands: bool | None = None
        # The messages of each frame are made once and filled again: to make one takes longer than to send it.
        self._in_scene = Header(frame_id=parameters.scene_frame)
        self._clock_message = Clock()
        self._pose_message = PoseWithCovarianceStamped(header=self._in_scene)
        self._features_message = LineFeatureArray(header=Header(frame_id=parameters.camera_frame))
        self._features = self.advertise(LineFeatureArray, "line_features", qos.SENSOR_DATA)
        self._pose = self.advertise(PoseWithCovarianceStamped, "camera_pose", qos.SENSOR_DATA)
        self._state = self.advertise(SimulatorState, "~/state", qos.STATUS)
        self._clock_topic = (
            self.create_publisher(Clock, "/clock", qos.CLOCK) if self._lockstep and parameters.publish_clock else None
        )
        self.subscribe(TwistStamped, "cmd_twist", self._on_twist, qos.COMMAND_INPUT)
        self._diagnostics = Diagnostics(self, self._report_diagnostics)
        self.serve(Trigger, "~/reset", self._on_reset)
        if self._lockstep:
            if parameters.wait_for_status:
                self.subscribe(SingularityStatus, "singularity_status", self._on_status, qos.STATUS)
            self.create_steady_timer(parameters.resend_period, self._on_resend_timer)
        else:
            self.create_timer(parameters.time_step, self.guarded(self._on_step_timer))
        self.start()

    def configure(self) -> None:
        """Put the camera at its start."""
        self._simulation = Simulation(self.parameters)

    def activate(self) -> None:
        """Say what it is going to do."""
        parameters = self.parameters
        self.get_logger().info(
            f"{parameters.mode}, a frame each {parameters.time_step:g} s, noise {parameters.noise:g}; "
            f"{len(parameters.lines_points) // 3} lines in {parameters.scene_frame}; "
            f"{self.topics('cmd_twist', 'line_features')}"
        )

    def fail(self, reason: str) -> None:
        """Let the camera stand still."""
        self._simulation.refuse_twist(reason)
        self._publish_state(self._simulation.frame())

    def prepare(self, parameters: SimulatorParameters) -> Callable[[], None]:
        """Use a changed scene or noise from the next frame on, a changed start pose at the next reset."""
        return self._simulation.prepare(parameters)

    def _on_twist(self, message: TwistStamped) -> None:
        try:
            twist = twist_from_message(message, self.parameters.camera_frame)
            self._simulation.receive_twist(twist, nanoseconds(message.header.stamp))
        except PlsingError as error:
            self._simulation.refuse_twist(str(error))
            self.get_logger().warning(f"cmd_twist refused: {error}", throttle_duration_sec=1.0)
        self._advance_in_lockstep()

    def _on_status(self, message: SingularityStatus) -> None:
        self._simulation.receive_status(nanoseconds(message.header.stamp))
        self._advance_in_lockstep()

    def _on_step_timer(self) -> None:
        self._simulation.step_in_realtime(self.now())
        self._publish_frame()

    def _on_resend_timer(self) -> None:
        if self._simulation.idle_since_last_call():
            self._publish_frame()

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._simulation.reset()
        response.success, response.message = True, "the camera is at its start"
        if self._lockstep:
            self._publish_frame()
        return response

    def _advance_in_lockstep(self) -> None:
        if self._lockstep and self._simulation.step_in_lockstep():
            self._publish_frame()

    def _publish_frame(self) -> None:
        frame = self._simulation.frame()
        fill_stamp(self._in_scene.stamp, frame.stamp)
        if self._pose.get_subscription_count():
            fill_pose(self._pose_message.pose.pose, frame.T_world_camera)
            self._pose.publish(self._pose_message)
        fill_stamp(self._features_message.header.stamp, frame.stamp)
        fill_features(self._features_message, frame.observation)
        if self._clock_topic is not None:
            # Just before the features, so that whoever takes both wakes up once.
            fill_stamp(self._clock_message.clock, frame.stamp)
            self._clock_topic.publish(self._clock_message)
        self._features.publish(self._features_message)
        self._diagnostics.count(frame.stamp)
        if self._stands is not bool(frame.reason):
            self._stands = bool(frame.reason)
            self.report(
                f"the camera stands still: {frame.reason}" if frame.reason else "the camera moves",
                DiagnosticStatus.WARN if frame.reason else DiagnosticStatus.OK,
            )
        if self._state.get_subscription_count():
            self._publish_state(frame)

    def _publish_state(self, frame: Frame) -> None:
        state = SimulatorState(
            header=self._in_scene,
            mode=SimulatorState.MODE_LOCKSTEP if self._lockstep else SimulatorState.MODE_REALTIME,
            step=frame.step,
            waiting=bool(frame.reason),
            reason=frame.reason,
        )
        fill_twist(state.twist, frame.twist)
        self._state.publish(state)

    def _report_diagnostics(self) -> tuple[bytes, str, Mapping[str, str]]:
        frame = self._simulation.frame()
        level = DiagnosticStatus.WARN if frame.reason else DiagnosticStatus.OK
        return level, frame.reason or "running", {"step": str(frame.step)}


_EXAMPLES = """examples:
  share=$(ros2 pkg prefix --share plsing_ros)
  ros2 run plsing_ros feature_simulator --ros-args --params-file $share/config/paper_p4l.yaml
  ros2 run plsing_ros feature_simulator --ros-args --params-file $share/config/paper_p4l.yaml -p noise:=0.002
  ros2 service call /feature_simulator/reset std_srvs/srv/Trigger

All parameters with units and ranges: $share/config/feature_simulator.yaml"""


def main() -> int:
    """Run the node."""
    return run_node(FeatureSimulatorNode, __doc__.split("\n")[0], _EXAMPLES)
