# SPDX-License-Identifier: Apache-2.0
"""Node controller: the camera twist that brings the line features to their desired values."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from nav_msgs.msg import Path
from rclpy.publisher import Publisher
from std_msgs.msg import Header
from std_srvs.srv import SetBool

from plsing_msgs.msg import ControllerState, LineFeatureArray, SingularityStatus
from plsing_msgs.srv import CheckTarget
from plsing_ros.control.command import Command, Mode
from plsing_ros.control.halt_messages import HaltMessages
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.control.servo_cycle import PLANNING
from plsing_ros.errors import PlsingError
from plsing_ros.features.feature_message import sender_text
from plsing_ros.features.target import Target
from plsing_ros.monitoring.law_risks import laws_without_noise
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import (
    controller_state_message,
    features_message,
    fill_stamp,
    fill_twist,
    header,
    nanoseconds,
    observation_from_message,
)
from plsing_ros.nodes.diagnostics import Diagnostics
from plsing_ros.nodes.main import run_node
from plsing_ros.nodes.parameterized_node import ParameterizedNode
from plsing_ros.nodes.path_conversions import path_message, target_answer, target_question
from plsing_ros.nodes.pose_conversions import camera_pose_from_message, covariance_from_message
from plsing_ros.nodes.second_publishers import SecondPublishers
from plsing_ros.nodes.tool_transform import ToolTransform
from plsing_ros.parameters import ControllerParameters
from plsing_ros.planning.detour import Plan
from plsing_ros.planning.planner import Answer, PlanProcess

_LEVELS = {
    Mode.WAITING: DiagnosticStatus.STALE,
    Mode.SERVOING: DiagnosticStatus.OK,
    Mode.CONVERGED: DiagnosticStatus.OK,
    Mode.HALTED: DiagnosticStatus.ERROR,
    Mode.DISABLED: DiagnosticStatus.OK,
    Mode.STALLED: DiagnosticStatus.WARN,
    Mode.REFUSED: DiagnosticStatus.ERROR,
}


# What keeps a robot safe: a live change is logged.
_SAFETY = (
    "ambiguous_lines",
    "features_timeout",
    "future_tolerance",
    "gate",
    "latency",
    "max_",
    "poor_lines",
    "slow_scale",
    "target.min",
    "tolerance.",
    "zero_twists",
)

# How often second publishers are looked for [s].
_LOOK_PERIOD = 1.0
# Of a published path.
_PATH_POSES = 100


class ControllerNode(ParameterizedNode[ControllerParameters]):
    """Answers each line_features with a cmd_twist of the same stamp; zero if it must not move, and ~/state says why."""

    moves_robot = True

    def __init__(self, **options: Any) -> None:
        super().__init__("controller", ControllerParameters, **options)
        parameters = self.parameters
        # Paths are planned in a process of their own, so that control is never held up.
        self._planner = PlanProcess()
        # The operator's word outlives what configure makes.
        self._enabled = self.parameters.enabled
        self._halt_messages = HaltMessages()
        self._latest: Command | None = None
        self._warning = ""
        # Made once and filled again: to make a message takes longer than to send it.
        self._twist_message = TwistStamped(header=Header(frame_id=parameters.tool_frame or parameters.camera_frame))
        self._twist = self.advertise(TwistStamped, "cmd_twist", qos.COMMAND)
        self._state = self.advertise(ControllerState, "~/state", qos.STATUS)
        # Before the features, so that of what has come together the pose is taken first.
        self.subscribe(PoseWithCovarianceStamped, "camera_pose", self._on_pose, qos.SENSOR_DATA)
        self.subscribe(LineFeatureArray, "line_features", self._on_features, qos.SENSOR_DATA)
        # Where the target is a pose, the monitor learns from here where the task leads.
        self._desired: Publisher | None = None
        self._shown_target: Target | None = None
        if parameters.target_source == "topic":
            self.subscribe(LineFeatureArray, "desired_line_features", self._on_desired, qos.LATCHED)
        else:
            self._desired = self.advertise(LineFeatureArray, "desired_line_features", qos.LATCHED)
        if parameters.gate != "none":
            self.subscribe(SingularityStatus, "singularity_status", self._on_status, qos.STATUS)
        self._path = self.advertise(Path, "~/planned_path", qos.LATCHED)
        self._plan: Plan | None = None
        self._others = SecondPublishers(self, ("cmd_twist", "line_features", "singularity_status"))
        self.create_steady_timer(_LOOK_PERIOD, self._look_for_others)
        self._tool = ToolTransform(self)
        self._diagnostics = Diagnostics(self, self._report_diagnostics)
        self.serve(SetBool, "~/enable", self._on_enable)
        self.serve_slowly(CheckTarget, "~/check_target", self._on_check_target)
        self.create_steady_timer(parameters.watchdog_period, self._on_watchdog)
        self.start()

    def configure(self) -> None:
        """Compute the target's features and the scene's loci."""
        self._tool.check()
        self._servo = ServoController.from_parameters(self.parameters, self._planner)
        self._servo.compute_loci()
        if self.parameters.law == "detour":
            self._planner.start()
        self._servo.enabled = self._enabled
        self._latest = self._plan = self._shown_target = None
        self._warning = ""

    def activate(self) -> None:
        """Say what it is going to do, where it leads, and what is doubtful about it."""
        parameters = self.parameters
        limits = [parameters.max_linear_speed, parameters.max_angular_speed]
        speeds = ["at any" if value == 0.0 else f"at most {value:g}" for value in limits]
        self.get_logger().info(
            f"law {parameters.law}, gain {parameters.gain:g} 1/s, {speeds[0]} m/s and {speeds[1]} rad/s; "
            f"{len(parameters.lines_points) // 3} lines in {parameters.scene_frame}; target from "
            f"{parameters.target_source}, gate {parameters.gate}; {self.topics('line_features', 'cmd_twist')}"
        )
        if parameters.law == "detour":
            self.get_logger().info("the process that plans paths is started; the camera stands still until it is ready")
        self._say_where_it_leads()

    def _say_where_it_leads(self) -> None:
        self._report_warning()
        self._show_target()

    def stop(self) -> None:
        """Command zero twist, and plan no more."""
        super().stop()
        self._planner.close()

    def deactivate(self, reason: str) -> None:
        """Command zero twist."""
        self._command(self._servo.halt(reason), self.now())

    def fail(self, reason: str) -> None:
        """Command zero twist."""
        self._command(self._servo.halt(reason), self.now())

    def prepare(self, parameters: ControllerParameters) -> Callable[[], None]:
        """Use changed parameters from the next features on; a change of what keeps the robot safe is logged."""
        change_core = self._servo.prepare(parameters)
        before, after = self.parameters.values(), parameters.values()
        changes = [
            f"parameter {name} changed from {before[name]} to {after[name]}"
            for name in sorted(after)
            if name.startswith(_SAFETY) and after[name] != before[name]
        ]

        def put_in_force() -> None:
            change_core()
            self._servo.compute_loci()
            for change in changes:
                self.report(change, DiagnosticStatus.OK)
            if self.active:
                self._say_where_it_leads()

        return put_in_force

    def _on_features(self, message: LineFeatureArray) -> None:
        stamp = nanoseconds(message.header.stamp)
        if self._servo.is_stray(stamp, self.now()):
            return
        try:
            observation = observation_from_message(message, self.parameters.camera_frame)
            self._tool.update()
            command = self._servo.answer(observation, stamp, self.now())
        except PlsingError as error:
            command = self._servo.halt(str(error))
        self._command(command, stamp)
        self._diagnostics.count(stamp)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        try:
            pose = camera_pose_from_message(message, self.parameters.scene_frame)
        except PlsingError as error:
            self._servo.forget_poses()
            self.get_logger().warning(f"camera_pose refused: {error}", throttle_duration_sec=1.0)
        else:
            self._servo.receive_pose(pose, nanoseconds(message.header.stamp), covariance_from_message(message))

    def _on_desired(self, message: LineFeatureArray) -> None:
        try:
            self._servo.set_target(observation_from_message(message, self.parameters.camera_frame))
        except PlsingError as error:
            self.get_logger().error(f"desired_line_features refused, the target stays as it was: {error}")
        self._report_warning()

    def _on_status(self, message: SingularityStatus) -> None:
        stamp = nanoseconds(message.header.stamp)
        reason = sender_text(message.reason)
        self._servo.gate.receive(message.level, reason, stamp, self.now(), message.risk_valid)

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._servo.enabled = self._enabled = request.data
        response.success, response.message = True, "enabled" if request.data else "disabled: zero twist"
        return response

    def _on_check_target(
        self, request: CheckTarget.Request, response: CheckTarget.Response
    ) -> Generator[None, None, CheckTarget.Response]:
        frame, parameters = self.parameters.scene_frame, self.parameters
        note = "" if parameters.law == "detour" else f"law {parameters.law} plans no path; detour would say: "
        try:
            target, start = target_question(request, frame)
            check = yield from _waited_for(self._servo.check_target(target, start))
            laws = yield from _waited_for(self._planner.ask(laws_without_noise, parameters, check.start, target))
        except PlsingError as error:
            response.success, response.message = False, str(error)
            return response
        answer = target_answer(check, note, header(self.now(), frame))
        answer.reason += f"; rolled out to the target without noise, {laws}"
        return answer

    def _show_target(self) -> None:
        target = self._servo.target
        if self._desired is not None and target is not None and target is not self._shown_target:
            self._shown_target = target
            head = header(self.now(), self.parameters.camera_frame)
            self._desired.publish(features_message(target.observation, head))

    def _count_status_publishers(self) -> None:
        gate = self._servo.gate
        before, gate.publishers = gate.publishers, self.count_publishers(self.resolve_topic_name("singularity_status"))
        if gate.publishers > max(before, 1):
            self.get_logger().error(
                f"singularity_status has {gate.publishers} publishers; the gate cannot tell the monitor from others"
            )

    def _on_watchdog(self) -> None:
        if self.parameters.gate == "status":
            self._count_status_publishers()
        command = self._servo.silence(self.now())
        if command is not None:
            self._command(command, self.now())

    def _look_for_others(self) -> None:
        if self._others.look():
            level = DiagnosticStatus.WARN if self._others.text else DiagnosticStatus.OK
            self.report(self._others.text or "no topic has a second publisher any more", level)

    def _command(self, command: Command, stamp: int) -> None:
        if self._others.text:
            command = command._replace(reason="; ".join(filter(None, (command.reason, self._others.text))))
        if self._halt_messages.to_be_published(command, self.parameters.zero_twists):
            fill_stamp(self._twist_message.header.stamp, stamp)
            fill_twist(self._twist_message.twist, command.output)
            self._twist.publish(self._twist_message)
        if self._state.get_subscription_count():
            head = header(stamp, self.parameters.camera_frame)
            covariance, unchecked = self._servo.twist_covariance(), self._servo.unchecked
            self._state.publish(controller_state_message(command, self._servo.law, covariance, unchecked, head))
        self._publish_path(stamp)
        previous, self._latest = self._latest, command
        if previous is None or command.mode is not previous.mode:
            level = DiagnosticStatus.OK if command.reason.startswith(PLANNING) else _LEVELS[command.mode]
            self.report(f"{command.mode.name}  {command.reason}".strip(), level)

    def _publish_path(self, stamp: int) -> None:
        plan = self._servo.plan
        if plan is self._plan:
            return
        self._plan = plan
        poses = () if plan is None or plan.path is None else plan.path.sampled(_PATH_POSES)
        self._path.publish(path_message(poses, header(stamp, self.parameters.scene_frame)))
        if plan is not None:
            level = DiagnosticStatus.ERROR if plan.path is None else DiagnosticStatus.OK
            self.report(f"{plan.decision.name}  {plan.reason}", level)

    def _report_warning(self) -> None:
        if self._servo.warning and self._servo.warning != self._warning:
            self.report(self._servo.warning, DiagnosticStatus.WARN)
        self._warning = self._servo.warning

    def _report_diagnostics(self) -> tuple[bytes, str, Mapping[str, str]]:
        latest = self._latest
        if latest is None:
            return DiagnosticStatus.STALE, "no features received yet", {}
        return (
            _LEVELS[latest.mode],
            f"{latest.mode.name} {latest.reason}".strip(),
            {
                "error norm": f"{latest.error_norm:.4g}",
                "inverse condition number": f"{latest.inverse_condition_number:.4g}",
                "law": self._servo.law,
                "scale": f"{latest.scale:.3g}",
                "warning": "; ".join(filter(None, (self._servo.warning, self._others.text))),
            },
        )


def _waited_for(answer: Answer) -> Generator[None, None, Any]:
    """Yield while the process that plans works on an answer, and return it."""
    while (found := answer.result()) is None:
        yield
    return found


_EXAMPLES = """examples:
  share=$(ros2 pkg prefix --share plsing_ros)
  ros2 run plsing_ros controller --ros-args --params-file $share/config/paper_p4l.yaml
  ros2 run plsing_ros controller --ros-args --params-file $share/config/paper_p4l.yaml -p gain:=0.5
  ros2 run plsing_ros controller --ros-args --params-file $share/config/paper_p4l.yaml -p law:=guarded
  ros2 service call /controller/enable std_srvs/srv/SetBool "{data: false}"

All parameters with units and ranges: $share/config/controller.yaml"""


def main() -> int:
    """Run the node."""
    return run_node(ControllerNode, __doc__.split("\n")[0], _EXAMPLES)


if __name__ == "__main__":
    sys.exit(main())
