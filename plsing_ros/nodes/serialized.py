# SPDX-License-Identifier: Apache-2.0
"""Messages in the middleware's serialized form, read and written without their Python classes.

A message class runs a Python function for each of its fields. Between two frames of a camera these leave the caches of
the processor, so that for a callback of every frame they cost more than the work itself.
"""

from __future__ import annotations

from typing import Any

from rclpy.serialization import deserialize_message, serialize_message

from plsing_ros import _core

_KINDS = {
    "boolean": "B",
    "uint8": "B",
    "int32": "i",
    "uint32": "I",
    "string": "s",
    "double": "F1",
    "sequence<double>": "D",
    "sequence<int32>": "L",
    "sequence<uint8>": "U",
    "sequence<string>": "S",
}
# Second byte of a serialized message in little-endian CDR.
_LITTLE_ENDIAN = 1


class SerializedType:
    """A message type whose messages are tuples of values.

    The values are those of all fields in order, a message in a message by its own. Doubles next to each other are one
    array, so is a sequence, but that of int32 is a tuple; a stamp is its seconds and nanoseconds.
    """

    def __init__(self, message_type: type) -> None:
        """Take a type; ValueError if it has a field of another kind than line features, poses and twists have."""
        self._type = message_type
        kinds = _merged(_kinds(message_type()))
        self._layout = "".join("d" if each == "F1" else each for each in kinds)

    def read(self, data: bytes) -> tuple[Any, ...]:
        """Return the values of a message as a raw subscription hands it over.

        Raises:
            ValueError: If it ends too early.
        """
        if data[1] != _LITTLE_ENDIAN:
            # From a machine of the other kind: the middleware turns it round.
            data = serialize_message(deserialize_message(data, self._type))
        return _core.read_serialized(self._layout, data)

    def write(self, values: tuple[Any, ...]) -> bytes:
        """Return what a publisher takes in the place of a message.

        Raises:
            ValueError: If there are more or fewer values than the type has.
        """
        return _core.write_serialized(self._layout, values)


def _kinds(message: Any) -> list[str]:
    """Return the kinds of all values of a message."""
    found: list[str] = []
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if hasattr(value, "get_fields_and_field_types"):
            found += _kinds(value)
        elif kind in _KINDS:
            found.append(_KINDS[kind])
        elif kind.startswith("double[") and "<" not in kind:
            found.append(f"F{len(value)}")
        else:
            raise ValueError(f"a field of type {kind} is not read or written in its serialized form")
    return found


def _merged(kinds: list[str]) -> list[str]:
    """Return kinds with doubles next to each other as one."""
    found: list[str] = []
    for kind in kinds:
        if found and kind[0] == found[-1][0] == "F":
            found[-1] = f"F{int(found[-1][1:]) + int(kind[1:])}"
        else:
            found.append(kind)
    return found
