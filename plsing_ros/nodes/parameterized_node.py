"""A node whose parameters are one ParameterSet: declared with descriptors, refused or changed as a whole."""

from __future__ import annotations

import array
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher

from plsing_ros.errors import ParameterError, PlsingError
from plsing_ros.nodes import qos
from plsing_ros.parameters import ParameterSet, Specification

_P = TypeVar("_P", bound=ParameterSet)

# Parameters that rclpy itself takes from a parameter file.
_OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")


class ParameterizedNode(Node, Generic[_P]):
    """Base of this package's nodes.

    Attributes:
        parameters: The parameters in force.
    """

    def __init__(self, name: str, kind: type[_P], **options: Any) -> None:
        """Create the node and declare its parameters.

        Args:
            name: Default node name.
            kind: The node's parameters.
            options: Further arguments of rclpy.node.Node, such as context, namespace, parameter_overrides.

        Raises:
            ParameterError: If a given parameter is unknown or not allowed.
        """
        try:
            super().__init__(name, automatically_declare_parameters_from_overrides=True, **options)
        except ValueError as error:
            if "PARAMETER_NOT_SET" not in str(error):
                raise
            raise ParameterError(
                "a parameter is given as an empty list, which has no type in ROS; give it a value, or leave it out"
            ) from None
        try:
            given = {
                each: _plain(parameter.value)
                for each, parameter in self.get_parameters_by_prefix("").items()
                if not each.startswith(_OF_RCLPY)
            }
            self.parameters: _P = kind.from_values(given)
            values = self.parameters.values()
            for each, (_, specification) in kind.specifications().items():
                descriptor = _descriptor(specification, values[each])
                if each in given:
                    self.set_descriptor(each, descriptor)
                else:
                    value = values[each]
                    self.declare_parameter(each, list(value) if isinstance(value, tuple) else value, descriptor)
        except ParameterError:
            self.destroy_node()
            raise
        self.add_on_set_parameters_callback(self._on_set_parameters)

    def apply(self, parameters: _P) -> None:
        """Put changed parameters in force as a whole, or raise PlsingError and leave the node as it was."""
        raise NotImplementedError

    def now(self) -> int:
        """Return the node clock's time [ns]."""
        nanoseconds: int = self.get_clock().now().nanoseconds
        return nanoseconds

    def advertise(self, message_type: type, topic: str, profile: Any) -> Publisher:
        """Create a publisher whose quality of service can be overridden by parameters."""
        return self.create_publisher(message_type, topic, profile, qos_overriding_options=qos.overridable())

    def subscribe(self, message_type: type, topic: str, callback: Callable[[Any], None], profile: Any) -> None:
        """Create a subscription whose quality of service can be overridden by parameters."""
        self.create_subscription(message_type, topic, callback, profile, qos_overriding_options=qos.overridable())

    def create_steady_timer(self, period: float, callback: Callable[[], None]) -> None:
        """Call back every period [s] of the wall clock, so also while a simulated clock stands still."""
        self.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def report(self, text: str, good: bool) -> None:
        """Log a change of state, as information or as a warning."""
        # Two calls, because rclpy ties a severity to a place in the source.
        if good:
            self.get_logger().info(text)
        else:
            self.get_logger().warning(text)

    def stop(self) -> None:
        """Leave the robot in a safe state; called once before the node is destroyed."""

    def _on_set_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        known = type(self.parameters).specifications()
        values = {each.name: _plain(each.value) for each in changes if each.name in known}
        if not values:
            return SetParametersResult(successful=True)
        try:
            candidate = self.parameters.with_values(values)
            self.apply(candidate)
        except PlsingError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.parameters = candidate
        return SetParametersResult(successful=True)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, array.array) else value


def _descriptor(specification: Specification, value: Any) -> ParameterDescriptor:
    unit = f" [{specification.unit}]" if specification.unit else ""
    descriptor = ParameterDescriptor(
        description=specification.description + unit,
        additional_constraints=specification.range_text,
        read_only=not specification.live,
        # So that 1 is accepted where 1.0 is meant, and what is not is refused with our own reason.
        dynamic_typing=True,
    )
    minimum, maximum = specification.minimum, specification.maximum
    if minimum is not None and maximum is not None and not isinstance(value, tuple):
        if isinstance(value, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=minimum, to_value=maximum)]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(minimum), to_value=int(maximum))]
    return descriptor
