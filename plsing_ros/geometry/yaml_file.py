# SPDX-License-Identifier: Apache-2.0
"""YAML files that come from anywhere: what would burn time or memory is refused before it does."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from plsing_ros.errors import SceneFileError

try:
    import yaml
except ImportError:
    raise SceneFileError(
        "files are read with PyYAML, which is not installed: sudo apt install python3-yaml, or pip install PyYAML"
    ) from None

# A scene of ten thousand lines has half of it.
_MAX_BYTES = 2**20
_MAX_DEPTH = 20
_INT64 = range(-(2**63), 2**63)


class _Loader(yaml.SafeLoader):
    """Takes 1e-06 for a number, as ROS and YAML 1.2 do; YAML 1.1 wants 1.0e-06."""


_Loader.add_implicit_resolver(  # type: ignore[no-untyped-call]
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?[0-9]+[eE][-+]?[0-9]+$"), list("-+0123456789")
)


def read_yaml(path: str | Path, what: str) -> Any:
    """Return the content of a YAML file.

    Args:
        path: Of the file.
        what: What it is, for the message: "scene file".

    Raises:
        SceneFileError: If the file cannot be read, is larger than a mebibyte, is not YAML, has aliases, is nested more
            than 20 deep, or has an integer of more than 64 bits; it names the file.
    """
    try:
        with Path(path).open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
        if len(content) > _MAX_BYTES:
            raise SceneFileError(f"{what} {path} is larger than {_MAX_BYTES} bytes, more than any scene needs")
        text = content.decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneFileError(f"cannot read {what} {path}: {error}") from None
    try:
        _check_structure(text, f"{what} {path}")
        value = yaml.load(text, _Loader)
    except (yaml.YAMLError, ValueError) as error:
        raise SceneFileError(f"{what} {path} is not YAML: {' '.join(str(error).split())}") from None
    _check_integers(value, f"{what} {path}")
    return value


def _check_structure(text: str, file: str) -> None:
    """Refuse aliases, of which few bytes make gigabytes, and a nesting at which readers overflow their stack."""
    depth = 0
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent):
            raise SceneFileError(
                f"{file} has an alias, *{event.anchor}, in line {event.start_mark.line + 1}; write the value out"
            )
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > _MAX_DEPTH:
            raise SceneFileError(
                f"{file} is nested more than {_MAX_DEPTH} deep in line {event.start_mark.line + 1}; no parameter is"
            )


def _check_integers(value: Any, file: str) -> None:
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, list | set | tuple):
        for each in value:
            _check_integers(each, file)
    elif isinstance(value, int) and value not in _INT64:
        raise SceneFileError(f"{file} has an integer of {value.bit_length()} bits; allowed are 64")
