# SPDX-License-Identifier: Apache-2.0
"""What the nodes that simulate a camera share: twists in, frames out, in lockstep or in real time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from plsing_msgs.msg import SimulatorState, SingularityStatus
from plsing_ros.errors import PlsingError
from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import fill_stamp, fill_twist, nanoseconds, twist_from_message
from plsing_ros.nodes.diagnostics import Diagnostics
from plsing_ros.nodes.parameterized_node import ParameterizedNode
from plsing_ros.nodes.pose_conversions import fill_pose
from plsing_ros.nodes.pose_transform import PoseTransform
from plsing_ros.parameters.stepping import SteppingParameters
from plsing_ros.simulation.stepping import SteppedSimulation

_P = TypeVar("_P", bound=SteppingParameters)


class SimulatorNode(ParameterizedNode[_P]):
    """Publishes camera_pose and ~/state, integrates cmd_twist; ~/reset puts the camera back to its start.

    A node that inherits it makes `simulation` in `configure` and publishes what its camera sees in `publish_view`.
    """

    simulation: SteppedSimulation

    def __init__(self, name: str, kind: type[_P], **options: Any) -> None:
        """Create the node; the other arguments are those of ParameterizedNode."""
        super().__init__(name, kind, **options)
        parameters = self.parameters
        self._lockstep = parameters.mode == "lockstep"
        self._told: tuple[bool, str] | None = None
        # The messages of each frame are made once and filled again: to make one takes longer than to send it.
        self._in_scene = Header(frame_id=parameters.scene_frame)
        self._clock_message = Clock()
        self._pose_message = PoseWithCovarianceStamped(header=self._in_scene)
        self.advertise_view()
        self._pose = self.advertise(PoseWithCovarianceStamped, "camera_pose", qos.SENSOR_DATA)
        self._transform = PoseTransform(self, parameters.publish_tf, parameters.scene_frame, parameters.camera_frame)
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

    def advertise_view(self) -> None:
        """Create the publishers of what the camera sees."""
        raise NotImplementedError

    def publish_view(self, stamp: int) -> None:
        """Publish what the camera sees in the current frame, of that stamp [ns]."""
        raise NotImplementedError

    def camera_pose(self) -> Pose:
        """Return T_world_camera of the current frame."""
        raise NotImplementedError

    def fail(self, reason: str) -> None:
        """Let the camera stand still."""
        self.simulation.refuse_twist(reason)
        self._publish_state()

    def prepare(self, parameters: _P) -> Callable[[], None]:
        """Put what may change while it runs in force from the next frame on, a start pose at the next reset."""
        raise NotImplementedError

    def _on_twist(self, message: TwistStamped) -> None:
        try:
            twist = twist_from_message(message, self.parameters.camera_frame)
            self.simulation.receive_twist(twist, nanoseconds(message.header.stamp))
            self.warn_of("cmd_twist refused", "")
        except PlsingError as error:
            self.simulation.refuse_twist(str(error))
            self.warn_of("cmd_twist refused", str(error))
        self._advance_in_lockstep()

    def _on_status(self, message: SingularityStatus) -> None:
        self.simulation.receive_status(nanoseconds(message.header.stamp))
        self._advance_in_lockstep()

    def _on_step_timer(self) -> None:
        self.simulation.step_in_realtime(self.now())
        self._publish_frame()

    def _on_resend_timer(self) -> None:
        if self.simulation.idle_since_last_call():
            self._publish_frame()

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.simulation.reset()
        response.success, response.message = True, "the camera is at its start"
        if self._lockstep:
            self._publish_frame()
        return response

    def _advance_in_lockstep(self) -> None:
        if self._lockstep and self.simulation.step_in_lockstep():
            self._publish_frame()

    def _publish_frame(self) -> None:
        simulation = self.simulation
        fill_stamp(self._in_scene.stamp, simulation.stamp)
        if self._pose.get_subscription_count():
            fill_pose(self._pose_message.pose.pose, self.camera_pose())
            self._pose.publish(self._pose_message)
        self._transform.publish(self.camera_pose(), simulation.stamp)
        if self._clock_topic is not None:
            # Just before the view, so that whoever takes both wakes up once.
            fill_stamp(self._clock_message.clock, simulation.stamp)
            self._clock_topic.publish(self._clock_message)
        self.publish_view(simulation.stamp)
        self._diagnostics.count(simulation.stamp)
        reason, remark = simulation.reason, simulation.remark
        if self._told != (bool(reason), remark):
            self._told = (bool(reason), remark)
            moving = f"the camera moves, but {remark}" if remark else "the camera moves"
            self.report(
                f"the camera stands still: {reason}" if reason else moving,
                DiagnosticStatus.WARN if reason or remark else DiagnosticStatus.OK,
            )
        if self._state.get_subscription_count():
            self._publish_state()

    def _publish_state(self) -> None:
        simulation = self.simulation
        state = SimulatorState(
            header=self._in_scene,
            mode=SimulatorState.MODE_LOCKSTEP if self._lockstep else SimulatorState.MODE_REALTIME,
            step=simulation.step,
            waiting=bool(simulation.reason),
            reason=simulation.reason or simulation.remark,
        )
        fill_twist(state.twist, simulation.twist)
        self._state.publish(state)

    def _report_diagnostics(self) -> tuple[bytes, str, Mapping[str, str]]:
        simulation = self.simulation
        problem = simulation.reason or simulation.remark
        level = DiagnosticStatus.WARN if problem else DiagnosticStatus.OK
        return level, problem or "running", {"step": str(simulation.step)}
