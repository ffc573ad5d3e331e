# SPDX-License-Identifier: Apache-2.0
"""A managed node that no message, request or fault can end: its transitions, and one guard for every callback."""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable, Iterator
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from plsing_ros.errors import PlsingError, StartError
from plsing_ros.nodes import qos
from plsing_ros.nodes.slow_service import LOOK_PERIOD, SlowAnswer, SlowService
from plsing_ros.parameters.node import AUTOSTART, AUTOSTART_DEFAULT

# A fault in a stream of messages is said this seldom [s].
_SELDOM = 1.0


class ManagedNode(LifecycleNode):
    """Base of this package's nodes: hooks for the transitions, and callbacks that run only while it is active.

    A subclass makes its publishers, subscriptions, services and timers in its constructor, whose last line is
    self.start(). They stay; what they work with is made in configure and forgotten in cleanup.

    Attributes:
        moves_robot: Whether a robot moves by what it publishes.
        takes_images: Whether it listens to images.
    """

    moves_robot: ClassVar[bool] = False
    takes_images: ClassVar[bool] = False

    def __init__(self, name: str, **options: Any) -> None:
        """Create the node, unconfigured; options are those of rclpy.node.Node."""
        self._configured = self._active = self._starting = self._ending = False
        self._failure = ""
        self._warned: dict[str, str] = {}
        self._slow: list[Service] = []
        self._latched: dict[str, tuple[Callable[[Any], None], Any]] = {}
        super().__init__(name, **options)
        # Services of rclpy itself (parameters, lifecycle) raise out of spin at some malformed requests.
        for service in self.services:
            service.callback = self._surviving(service.callback)
        self._service_change_state.callback = self._refusing_impossible(self._service_change_state.callback)
        self.declare_parameter(
            AUTOSTART.name,
            AUTOSTART_DEFAULT,
            ParameterDescriptor(description=AUTOSTART.description, read_only=True),
        )

    # -- what a node does in a transition --------------------------------------------------------------------------

    def configure(self) -> None:
        """Make what the callbacks work with from the parameters; PlsingError if that cannot be."""

    def activate(self) -> None:
        """Begin: say what others wait for; PlsingError if it cannot."""

    def deactivate(self, reason: str) -> None:
        """Leave the robot in a safe state; called while still active, also before the node is destroyed."""

    def cleanup(self) -> None:
        """Forget what configure made."""

    def fail(self, reason: str) -> None:
        """Publish that a callback failed by a fault of our own, and leave the robot in a safe state meanwhile."""

    # -- use -------------------------------------------------------------------------------------------------------

    @property
    def configured(self) -> bool:
        """Whether what configure makes is there."""
        return self._configured

    @property
    def active(self) -> bool:
        """Whether messages are answered."""
        return self._active

    @property
    def state_label(self) -> str:
        """State of its lifecycle: unconfigured, inactive, active or finalized."""
        label: str = self._state_machine.current_state[1]
        return label

    def start(self) -> None:
        """Configure and activate, where the parameter autostart says so; the last line of a node's constructor.

        Raises:
            StartError: If a transition fails; the node is destroyed then.
        """
        if not self.get_parameter(AUTOSTART.name).value:
            return
        self._starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() is not TransitionCallbackReturn.SUCCESS:
                self.destroy_node()
                raise StartError(self._failure)
        self._starting = False

    def stop(self) -> None:
        """Leave the robot in a safe state; called once before the node is destroyed."""
        if self._active:
            self._end(f"the {self.get_name()} shuts down")

    def destroy_node(self) -> None:
        """Destroy the node and all it has in the middleware."""
        super().destroy_node()
        # rclpy leaves it, and it would keep the node's participant alive until the next garbage collection.
        self._state_machine.destroy_when_not_in_use()

    def now(self) -> int:
        """Return the node clock's time [ns]."""
        nanoseconds: int = self.get_clock().now().nanoseconds
        return nanoseconds

    def report(self, text: str, level: bytes) -> None:
        """Log a change of state, as severe as its level of diagnostic_msgs/DiagnosticStatus."""
        # One call for each, because rclpy ties a severity to a place in the source.
        # That it is told to stop is no error.
        if level == DiagnosticStatus.OK or self._ending:
            self.get_logger().info(text)
        elif level == DiagnosticStatus.ERROR:
            self.get_logger().error(text)
        else:
            self.get_logger().warning(text)

    def warn_of(self, what: str, problem: str) -> None:
        """Log a warning about an input once, until its problem is another one, or none; numbers make no other one."""
        if not problem:
            self._warned.pop(what, None)
            return
        kind = re.sub(r"[0-9.e+-]+", "", problem)
        if kind != self._warned.get(what):
            self.get_logger().warning(f"{what}: {problem}")
        self._warned[what] = kind

    def topics(self, source: str, result: str) -> str:
        """Return where a node listens and what it publishes, with the names after remapping, for its first line."""
        return f"{self.resolve_topic_name(source)} in, {self.resolve_topic_name(result)} out"

    def advertise(self, message_type: type, topic: str, profile: Any) -> Publisher:
        """Create a publisher whose quality of service can be overridden by parameters."""
        return self.create_publisher(message_type, topic, profile, qos_overriding_options=qos.overridable())

    def subscribe(self, message_type: type, topic: str, callback: Callable[[Any], None], profile: Any) -> None:
        """Call back for each message while active; quality of service can be overridden by parameters.

        The latest message of a latched topic is handed over at each activation, for it does not come again.
        """
        guarded = self.guarded(callback)
        receive = guarded
        if profile.durability is DurabilityPolicy.TRANSIENT_LOCAL:

            def receive(message: Any) -> None:
                self._latched[topic] = (guarded, message)
                guarded(message)

        super().create_subscription(message_type, topic, receive, profile, qos_overriding_options=qos.overridable())

    def serve(self, service_type: type, name: str, callback: Callable[[Any, Any], Any]) -> None:
        """Answer a service while active; otherwise, and at a fault, its answer is success: false with a message."""
        self.create_service(service_type, name, self.guarded(callback))

    def serve_slowly(self, service_type: type, name: str, answer: SlowAnswer) -> None:
        """Answer a service as serve does, but go on with everything else until the answer is ready."""
        service = self.create_service(service_type, name, answer)
        self._slow.append(service)
        looked_after = SlowService(service, answer, self.guarded)
        self.create_steady_timer(LOOK_PERIOD, looked_after.look, also_inactive=True)

    def create_steady_timer(self, period: float, callback: Callable[[], None], also_inactive: bool = False) -> None:
        """Call back every period [s] of the wall clock, so also while a simulated clock stands still."""
        wrapped = self._surviving(callback) if also_inactive else self.guarded(callback)
        super().create_timer(period, wrapped, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def guarded(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that does nothing unless the node is active, and that reports a fault and goes on."""

        def call(*arguments: Any) -> Any:
            if not self._active:
                return _refused(arguments, f"the node is {self.state_label}; it answers when it is active")
            try:
                return callback(*arguments)
            except Exception as error:
                reason = f"a fault in the {self.get_name()} itself: {error!r}"
                self._log_fault()
                try:
                    self.fail(reason)
                except Exception:
                    self._log_fault()
                return _refused(arguments, reason)

        return call

    # -- rclpy -----------------------------------------------------------------------------------------------------

    @property
    def services(self) -> Iterator[Service]:
        """Those that an executor serves."""
        return (each for each in super().services if each not in self._slow)

    def create_subscription(
        self, message_type: Any, topic: str, callback: Any, *rest: Any, **options: Any
    ) -> Subscription:
        """As in rclpy.node.Node, but an exception in the callback is logged and does not end the program."""
        return super().create_subscription(message_type, topic, self._surviving(callback), *rest, **options)

    def create_timer(self, period: float, callback: Any, *rest: Any, **options: Any) -> Timer:
        """As in rclpy.node.Node, but an exception in the callback is logged and does not end the program."""
        return super().create_timer(period, self._surviving(callback), *rest, **options)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure."""
        result = self._transition("configure", self._set_up)
        return super().on_configure(state) if result is TransitionCallbackReturn.SUCCESS else result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate."""
        result = self._transition("activate", self._begin)
        return super().on_activate(state) if result is TransitionCallbackReturn.SUCCESS else result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate: first of all the robot is left in a safe state."""
        result = self._transition("deactivate", lambda: self._end("deactivated"))
        # A failure would leave it active; an error takes it down.
        return super().on_deactivate(state) if result is TransitionCallbackReturn.SUCCESS else _ERROR

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up."""
        result = self._transition("cleanup", self._take_down)
        return super().on_cleanup(state) if result is TransitionCallbackReturn.SUCCESS else result

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Shut down: first of all the robot is left in a safe state."""
        self._transition("shutdown", self.stop)
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the node down to unconfigured after a fault in a transition, from where it can be configured anew."""
        self._transition("deactivate", self.stop)
        self._transition("cleanup", self._take_down)
        return super().on_error(state)

    def _set_up(self) -> None:
        self.configure()
        self._configured = True

    def _take_down(self) -> None:
        self._configured = False
        self.cleanup()

    def _begin(self) -> None:
        self.activate()
        self._active = True
        for callback, message in list(self._latched.values()):
            callback(message)

    def _end(self, reason: str) -> None:
        self._ending = True
        try:
            self.deactivate(reason)
        finally:
            self._active = self._ending = False

    def _transition(self, name: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            action()
        except PlsingError as error:
            result, self._failure = TransitionCallbackReturn.FAILURE, str(error)
        except Exception as error:
            result, self._failure = _ERROR, f"a fault in the {self.get_name()} itself: {error!r}"
            self.get_logger().debug(traceback.format_exc())
        else:
            return TransitionCallbackReturn.SUCCESS
        # Under autostart whoever made the node is told, and says it.
        if not self._starting:
            self.get_logger().error(f"{name} failed: {self._failure}")
        return result

    def _refusing_impossible(self, change_state: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """Return the service's callback, but refusing a transition that the state does not have.

        rclpy 7.1.6 raises out of spin at one, so that any participant could end the program.
        """

        def call(request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
            asked = request.transition
            possible = {each[0]: each[1] for each in self._state_machine.available_transitions}
            if asked.label in possible.values() if asked.label else asked.id in possible:
                return change_state(request, response)
            self.get_logger().error(
                f"change_state refused: transition '{asked.label or asked.id}' is not one of the state "
                f"{self.state_label}; it has {', '.join(sorted(possible.values())) or 'none'}",
                throttle_duration_sec=_SELDOM,
            )
            response.success = False
            return response

        return call

    def _surviving(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except Exception as error:
                reason = f"a request or message that cannot be answered: {error!r}"
                self.get_logger().error(reason, throttle_duration_sec=_SELDOM)
                self.get_logger().debug(traceback.format_exc())
                return _refused(arguments, reason)

        return call

    def _log_fault(self) -> None:
        self.get_logger().error(traceback.format_exc(), throttle_duration_sec=_SELDOM)


_ERROR = TransitionCallbackReturn.ERROR


def _refused(arguments: tuple[Any, ...], reason: str) -> Any:
    """Return what a callback answers that did not do its work: for a service its response, else nothing."""
    if len(arguments) != 2:
        return None
    response = arguments[1]
    if hasattr(response, "success"):
        response.success = False
    if hasattr(response, "message"):
        response.message = reason
    return response
