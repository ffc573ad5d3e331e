"""Node controller: the camera twist that brings the line features to their desired values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TwistStamped
from std_srvs.srv import SetBool

from plsing_msgs.msg import ControllerState, LineFeatureArray
from plsing_ros.errors import PlsingError
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import (
    controller_state_message,
    header,
    nanoseconds,
    observation_from_message,
    twist_stamped,
)
from plsing_ros.nodes.diagnostics import Diagnostics
from plsing_ros.nodes.parameterized_node import ParameterizedNode
from plsing_ros.nodes.run import run_node
from plsing_ros.parameters import ControllerParameters
from plsing_ros.servoing.line_servo import Command, LineServo, Mode

_DIAGNOSTIC_LEVELS = {
    Mode.WAITING: DiagnosticStatus.STALE,
    Mode.SERVOING: DiagnosticStatus.OK,
    Mode.CONVERGED: DiagnosticStatus.OK,
    Mode.HALTED: DiagnosticStatus.ERROR,
    Mode.DISABLED: DiagnosticStatus.OK,
}


class Controller(ParameterizedNode[ControllerParameters]):
    """Answers each line_features with a cmd_twist of the same stamp; zero if it must not move, and ~/state says why."""

    def __init__(self, **options: Any) -> None:
        super().__init__("controller", ControllerParameters, **options)
        try:
            self._servo = LineServo(self.parameters)
        except PlsingError:
            self.destroy_node()
            raise
        self._twist = self.publish_on(TwistStamped, "cmd_twist", qos.COMMAND)
        self._state = self.publish_on(ControllerState, "~/state", qos.STATUS)
        self.listen_to(LineFeatureArray, "line_features", self._on_features, qos.SENSOR_DATA)
        if self.parameters.target_source == "topic":
            self.listen_to(LineFeatureArray, "desired_line_features", self._on_desired, qos.LATCHED)
        self._latest: Command | None = None
        self._diagnostics = Diagnostics(self, self._report_diagnostics)
        self.create_service(SetBool, "~/enable", self._on_enable)
        self.every(self.parameters.watchdog_period, self._on_watchdog)

    def apply(self, parameters: ControllerParameters) -> None:
        """Use changed parameters from the next features on."""
        self._servo.parameters = parameters

    def stop(self) -> None:
        """Command zero twist."""
        self._command(self._servo.halt("the controller shuts down"), self.now())

    def _on_features(self, message: LineFeatureArray) -> None:
        stamp = nanoseconds(message.header.stamp)
        try:
            observation = observation_from_message(message, self.parameters.camera_frame)
            command = self._servo.step(observation, stamp, self.now())
        except PlsingError as error:
            command = self._servo.halt(str(error))
        self._command(command, stamp)
        self._diagnostics.count(stamp)

    def _on_desired(self, message: LineFeatureArray) -> None:
        try:
            self._servo.set_target(observation_from_message(message, self.parameters.camera_frame))
        except PlsingError as error:
            self.get_logger().error(f"desired_line_features refused, the target stays as it was: {error}")

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._servo.enabled = request.data
        response.success, response.message = True, "enabled" if request.data else "disabled: zero twist"
        return response

    def _on_watchdog(self) -> None:
        command = self._servo.silence(self.now())
        if command is not None:
            self._command(command, self.now())

    def _command(self, command: Command, stamp: int) -> None:
        head = header(stamp, self.parameters.camera_frame)
        # Without a single usable message nobody has asked this controller to move anything, not even to stop it.
        if command.mode is not Mode.WAITING:
            self._twist.publish(twist_stamped(command.twist, head))
        self._state.publish(controller_state_message(command, head))
        previous, self._latest = self._latest, command
        if previous is None or command.mode is not previous.mode:
            self.report(f"{command.mode.name}  {command.reason}".strip(), good=command.mode is not Mode.HALTED)

    def _report_diagnostics(self) -> tuple[bytes, str, Mapping[str, str]]:
        latest = self._latest
        if latest is None:
            return DiagnosticStatus.STALE, "no features received yet", {}
        return (
            _DIAGNOSTIC_LEVELS[latest.mode],
            f"{latest.mode.name} {latest.reason}".strip(),
            {
                "error norm": f"{latest.error_norm:.4g}",
                "inverse condition number": f"{latest.inverse_condition_number:.4g}",
            },
        )


_EXAMPLES = """examples:
  ros2 run plsing_ros controller --ros-args --params-file config/paper_p4l.yaml
  ros2 run plsing_ros controller --ros-args --params-file config/paper_p4l.yaml -p gain:=0.5
  ros2 service call /controller/enable std_srvs/srv/SetBool "{data: false}"

All parameters with units and ranges: config/controller.yaml"""


def main() -> int:
    """Run the node."""
    return run_node(Controller, __doc__.split("\n")[0], _EXAMPLES)
