# SPDX-License-Identifier: Apache-2.0
"""Messages as the bytes that are sent: all fields at once, where one property after another costs too much."""

from __future__ import annotations

import importlib
import re
from typing import Any

from plsing_ros import _core

_LETTERS = {"boolean": "?", "uint8": "B", "int32": "i", "uint32": "I", "double": "d", "string": "s"}


class Serializer:
    """Reads and writes messages of one type as tuples of their fields, those of the messages within in their place.

    Sequences and arrays of numbers are one field each, an array, and so is a message of numbers alone: of a Twist,
    shape (6,). Sequences of uint8 are bytes.
    """

    def __init__(self, message_type: Any) -> None:
        """Prepare; ValueError if the type has fields of which nothing here makes use."""
        self._layout = _layout(message_type)

    def fields(self, data: bytes) -> tuple[Any, ...] | None:
        """Return the fields of a serialized message; None if it ends too early or is not little-endian CDR."""
        return _core.unpack(self._layout, data)

    def data(self, fields: tuple[Any, ...]) -> bytes:
        """Return the serialized message of fields."""
        return _core.pack(self._layout, fields)


def _layout(message_type: Any) -> str:
    letters = []
    for kind in message_type.get_fields_and_field_types().values():
        found = re.fullmatch(r"(sequence<)?([\w/]+)>?(?:\[(\d+)\])?", kind)
        sequence, name, count = ("", "", "") if found is None else found.groups()
        if name in _LETTERS:
            letters.append(f"{'*' if sequence else count or ''}{_LETTERS[name]}")
        elif name == kind and "/" in name:
            package, own = name.split("/")
            letters.append(_layout(getattr(importlib.import_module(f"{package}.msg"), own)))
        else:
            raise ValueError(f"{message_type.__name__} has a field of type {kind}")
    # Numbers of messages of numbers, as of a Pose, are one field; those of an array are another one.
    if all(re.fullmatch(r"d|[3-7]d", each) for each in letters):
        return f"{sum(int(each[:-1] or 1) for each in letters)}d"
    return "".join(letters)
