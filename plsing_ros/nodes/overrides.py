# SPDX-License-Identifier: Apache-2.0
"""Parameters given to nodes that are not there: on the command line, and in parameter files."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from plsing_ros.errors import ParameterError, SceneFileError
from plsing_ros.geometry.yaml_file import read_yaml

_OUR_NODES = ("controller", "feature_simulator", "line_tracker", "pose_estimator", "singularity_monitor")
# Of a name that is meant to be another one.
_CLOSE = 0.8
_PARAMETERS = "ros__parameters"


def check_overrides(arguments: Sequence[str], names: Sequence[str]) -> None:
    """Refuse parameters for nodes that are not in this process, which ROS leaves out without a word.

    A parameter file may have sections for other nodes. It is refused if none is for a node of this process, and one
    has the name of such a node under another namespace, or nearly its name.

    Args:
        arguments: Of the command line.
        names: Of the nodes in this process, with namespace: "/robot/controller".

    Raises:
        ParameterError: With the name that was meant, where one is near.
    """
    for node, parameter in _overrides(arguments):
        if not any(matches(node, name) for name in names):
            raise ParameterError(
                f"-p {node}:{parameter} is for a node that is not in this process, whose node"
                f"{'s are' if len(names) > 1 else ' is'} {', '.join(names)}; did you mean '{_nearest(node, names)}'?"
            )
    for path in _values(arguments, ("--params-file",)):
        _check_file(Path(path), names)


def matches(section: str, name: str) -> bool:
    """Return whether a section of a parameter file is for a node: * stands for one part of a name, ** for any."""
    pattern = re.escape("/" + section.strip("/"))
    pattern = pattern.replace(r"/\*\*", r"(/[^/]+)*").replace(r"\*", r"[^/]+")
    return re.fullmatch(pattern, name) is not None


def _check_file(path: Path, names: Sequence[str]) -> None:
    try:
        content = read_yaml(path, "parameter file")
    except SceneFileError:
        # ROS says what is wrong with it.
        return
    sections = list(_sections(content))
    if any(matches(section, name) for section in sections for name in names):
        return
    for section in sections:
        last = section.rsplit("/", 1)[-1]
        for name in names:
            own = name.rsplit("/", 1)[-1]
            if last == own or (last not in _OUR_NODES and difflib.SequenceMatcher(None, last, own).ratio() > _CLOSE):
                raise ParameterError(
                    f"parameter file {path} has no section for {name}, but one for {section}; did you mean {name}, or "
                    f"/**/{own} for any namespace?"
                )


def _sections(content: Any, prefix: str = "") -> Iterator[str]:
    """Return the names of nodes with parameters, namespaces written out."""
    if not isinstance(content, dict):
        return
    for key, value in content.items():
        name = f"{prefix}/{str(key).strip('/')}"
        if isinstance(value, dict) and _PARAMETERS in value:
            yield name
        else:
            yield from _sections(value, name)


def _overrides(arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Return node and parameter of those given for one node: -p node:parameter:=value."""
    for each in _values(arguments, ("-p", "--param")):
        node, colon, parameter = each.split(":=", 1)[0].rpartition(":")
        if colon:
            yield node, parameter


def _values(arguments: Sequence[str], options: tuple[str, ...]) -> Iterator[str]:
    """Return the values of ROS options, which stand between --ros-args and --."""
    inside = False
    for option, value in zip(arguments, [*arguments[1:], ""], strict=True):
        if option == "--ros-args":
            inside = True
        elif option == "--":
            inside = False
        elif inside and option in options:
            yield value


def _nearest(node: str, names: Sequence[str]) -> str:
    known = [name.lstrip("/") for name in names]
    return next(iter(difflib.get_close_matches(node.lstrip("/"), known, n=1, cutoff=0.0)), known[0])
