# SPDX-License-Identifier: Apache-2.0
"""Parameters of a node as one immutable, checked value that needs no ROS."""

from __future__ import annotations

import dataclasses
import difflib
import math
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from plsing_ros.errors import ParameterError

_SPECIFICATION = "specification"


@dataclass(frozen=True)
class Specification:
    """What a parameter means and which values it may have.

    Attributes:
        name: ROS parameter name, for example "lines.points".
        description: One sentence.
        unit: SI unit, or "" for a pure number or a word.
        minimum: Smallest allowed value of a number, or of each number of an array.
        maximum: Largest allowed value likewise.
        choices: Allowed words; empty if any.
        live: Whether it may change at run time.
        one_for_all: Whether one number may stand for an array.
    """

    name: str
    description: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = True
    one_for_all: bool = False

    @property
    def range_text(self) -> str:
        """The allowed values in words, or "" if any value of the type is allowed."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if self.minimum is not None and self.maximum is not None:
            return f"{self.minimum:.10g} to {self.maximum:.10g}"
        if self.minimum is not None:
            return f"at least {self.minimum:.10g}"
        if self.maximum is not None:
            return f"at most {self.maximum:.10g}"
        return ""


def parameter(default: Any, name: str, description: str, **details: Any) -> Any:
    """Declare a field of a ParameterSet; details are those of Specification."""
    return dataclasses.field(default=default, metadata={_SPECIFICATION: Specification(name, description, **details)})


_Self = TypeVar("_Self", bound="ParameterSet")


@dataclass(frozen=True)
class ParameterSet:
    """Base of the nodes' parameters: a frozen dataclass whose fields are made with `parameter`.

    Field types are bool, int, float, str, and tuples of int or of float. Every value is checked when the set is made:
    type, finite, range; then `check` compares values with each other. So a set that exists is valid.

    Raises:
        ParameterError: On construction, naming the parameter, its value, and what is allowed.
    """

    def __post_init__(self) -> None:
        types = typing.get_type_hints(type(self))
        for field in dataclasses.fields(self):
            value = _converted(specification(field), types[field.name], getattr(self, field.name))
            object.__setattr__(self, field.name, value)
        self.check()

    def check(self) -> None:
        """Compare values with each other; override to raise ParameterError."""

    @classmethod
    def specifications(cls) -> dict[str, tuple[dataclasses.Field[Any], Specification]]:
        """Return the fields by ROS name, with their specifications, in order of declaration."""
        return {specification(field).name: (field, specification(field)) for field in dataclasses.fields(cls)}

    @classmethod
    def from_values(cls: type[_Self], values: Mapping[str, Any]) -> _Self:
        """Build a set from values by ROS name; the others keep their defaults.

        Raises:
            ParameterError: If a name is unknown (with the nearest known name) or a value is not allowed.
        """
        return cls(**{cls._field_name(name): value for name, value in values.items()})

    def with_values(self: _Self, values: Mapping[str, Any]) -> _Self:
        """Return a copy with some values changed, by ROS name: valid as a whole or refused as a whole."""
        return dataclasses.replace(self, **{self._field_name(name): value for name, value in values.items()})

    def values(self) -> dict[str, Any]:
        """Return the values by ROS name."""
        return {name: getattr(self, field.name) for name, (field, _) in self.specifications().items()}

    @classmethod
    def _field_name(cls, name: str) -> str:
        known = cls.specifications()
        if name not in known:
            similar = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean '{similar[0]}'?" if similar else "known are: " + ", ".join(known)
            raise ParameterError(f"unknown parameter '{name}'; {hint}")
        return known[name][0].name


def specification(field: dataclasses.Field[Any]) -> Specification:
    """Return what `parameter` recorded for a field."""
    found: Specification = field.metadata[_SPECIFICATION]
    return found


def _converted(spec: Specification, expected: Any, value: Any) -> Any:
    arguments = typing.get_args(expected)
    if arguments:
        if spec.one_for_all and isinstance(value, int | float):
            value = (value,)
        try:
            items = list(value)
        except TypeError:
            items = [None]
        if isinstance(value, str) or any(item is None for item in items):
            raise ParameterError(
                f"parameter '{spec.name}' is {value!r}; it must be an array of {arguments[0].__name__}"
            )
        return tuple(_converted_scalar(spec, arguments[0], item, f"[{i}]") for i, item in enumerate(items))
    return _converted_scalar(spec, expected, value, "")


def _converted_scalar(spec: Specification, expected: type, value: Any, where: str) -> Any:
    name = f"parameter '{spec.name}{where}'"
    unit = f" {spec.unit}" if spec.unit else ""
    if expected in (int, float):
        # bool is an int to Python, not to a user; 2.0 is no count, 2 is a fine length.
        if isinstance(value, bool) or not isinstance(value, (int, float) if expected is float else int):
            kind = "a number" if expected is float else "a whole number"
            raise ParameterError(f"{name} is {value!r}; it must be {kind}{unit}")
        number = expected(value)
        if not math.isfinite(number):
            raise ParameterError(f"{name} is {value!r}; it must be finite")
        if (spec.minimum is not None and number < spec.minimum) or (spec.maximum is not None and number > spec.maximum):
            raise ParameterError(f"{name} is {value!r}{unit}; allowed: {spec.range_text}{unit}")
        return number
    if not isinstance(value, expected):
        raise ParameterError(f"{name} is {value!r}; it must be {'true or false' if expected is bool else 'a text'}")
    if spec.choices and value not in spec.choices:
        raise ParameterError(f"{name} is '{value}'; allowed: {spec.range_text}")
    return value
