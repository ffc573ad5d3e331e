# SPDX-License-Identifier: Apache-2.0
"""A managed node whose parameters are one ParameterSet: typed, described, refused or changed as a whole."""

from __future__ import annotations

import array
import typing
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.parameter import Parameter

from plsing_ros.errors import ParameterError, PlsingError
from plsing_ros.nodes.managed_node import ManagedNode
from plsing_ros.parameters import ParameterSet, Specification
from plsing_ros.parameters.node import AUTOSTART

_P = TypeVar("_P", bound=ParameterSet)

# Parameters that rclpy itself takes from a parameter file, and those that ManagedNode declares.
_OF_THE_BASE = ("use_sim_time", "start_type_description_service", "qos_overrides.", AUTOSTART.name)

_TYPES = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
    tuple[int, ...]: Parameter.Type.INTEGER_ARRAY,
    tuple[float, ...]: Parameter.Type.DOUBLE_ARRAY,
}
_ARRAYS = (
    Parameter.Type.BYTE_ARRAY,
    Parameter.Type.BOOL_ARRAY,
    Parameter.Type.INTEGER_ARRAY,
    Parameter.Type.DOUBLE_ARRAY,
    Parameter.Type.STRING_ARRAY,
)


class _UnknownParameterError(ParameterNotDeclaredException):
    """A name that the node does not have; rclpy answers a request with the text of this error only."""

    def __init__(self, error: ParameterError) -> None:
        Exception.__init__(self, str(error))


class ParameterizedNode(ManagedNode, Generic[_P]):
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
        super().__init__(name, **options)
        hints = typing.get_type_hints(kind)
        specifications = kind.specifications()
        self._types = {each: _TYPES[hints[field.name]] for each, (field, _) in specifications.items()}
        self._pending: tuple[_P, Callable[[], None]] | None = None
        try:
            given = {
                each: self._given(parameter)
                for each, parameter in self._parameter_overrides.items()
                if not each.startswith(_OF_THE_BASE)
            }
            self.parameters: _P = kind.from_values(given)
            for each, value in self.parameters.values().items():
                self._declare(each, value, _descriptor(specifications[each][1], self._types[each]))
        except ParameterError:
            self.destroy_node()
            raise
        self.add_pre_set_parameters_callback(self._convert)
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._put_in_force)

    def prepare(self, parameters: _P) -> Callable[[], None]:
        """Return what puts changed parameters in force as a whole; called only between configure and cleanup.

        Raises:
            PlsingError: If they are refused; nothing is changed then.
        """
        raise NotImplementedError

    def _given(self, parameter: Parameter) -> Any:
        value, kind = parameter.value, self._types.get(parameter.name)
        if value is None and kind is not None:
            # An empty list in a file has no type.
            if kind in _ARRAYS:
                return ()
            raise ParameterError(f"parameter '{parameter.name}' is given without a value, or as an empty list")
        return list(value) if isinstance(value, array.array) else value

    def _declare(self, name: str, value: Any, descriptor: ParameterDescriptor) -> None:
        if value != ():
            value = list(value) if isinstance(value, tuple) else value
            self.declare_parameter(name, value, descriptor, ignore_override=True)
        else:
            # rclpy cannot tell the type of an empty list.
            self.declare_parameter(name, self._types[name], descriptor, ignore_override=True)
            self._parameters[name] = Parameter(name, self._types[name], [])

    def _convert(self, changes: list[Parameter]) -> list[Parameter]:
        """Take whole numbers for numbers, and an empty list of any type for one of the right type."""
        converted = []
        for change in changes:
            kind, value = self._types.get(change.name), change.value
            if kind is None and not self.has_parameter(change.name):
                try:
                    self.parameters.with_values({change.name: value})
                except ParameterError as error:
                    raise _UnknownParameterError(error) from None
            if kind is Parameter.Type.DOUBLE and change.type_ is Parameter.Type.INTEGER:
                value = float(value)
            elif kind is Parameter.Type.DOUBLE_ARRAY and change.type_ is Parameter.Type.INTEGER_ARRAY:
                value = [float(each) for each in value]
            elif not (kind in _ARRAYS and change.type_ in _ARRAYS and len(value) == 0):
                converted.append(change)
                continue
            converted.append(Parameter(change.name, kind, value))
        return converted

    def _validate(self, changes: Sequence[Parameter]) -> SetParametersResult:
        self._pending = None
        values = {each.name: self._given(each) for each in changes if each.name in self._types}
        if not values:
            return SetParametersResult(successful=True)
        try:
            candidate = self.parameters.with_values(values)
            self._pending = (candidate, self.prepare(candidate) if self.configured else _nothing)
        except PlsingError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _put_in_force(self, _: Sequence[Parameter]) -> None:
        if self._pending is None:
            return
        pending, self._pending = self._pending, None
        self.parameters, put_in_force = pending
        put_in_force()


def _nothing() -> None:
    """Unconfigured, there is nothing that a parameter is in force in."""


def _descriptor(specification: Specification, kind: Parameter.Type) -> ParameterDescriptor:
    unit = f" [{specification.unit}]" if specification.unit else ""
    descriptor = ParameterDescriptor(
        description=specification.description + unit,
        additional_constraints=specification.range_text,
        read_only=not specification.live,
    )
    minimum, maximum = specification.minimum, specification.maximum
    if minimum is not None and maximum is not None:
        if kind is Parameter.Type.DOUBLE:
            descriptor.floating_point_range = [FloatingPointRange(from_value=minimum, to_value=maximum)]
        elif kind is Parameter.Type.INTEGER:
            descriptor.integer_range = [IntegerRange(from_value=int(minimum), to_value=int(maximum))]
    return descriptor
