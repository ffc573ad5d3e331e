# SPDX-License-Identifier: Apache-2.0
"""Parameters from Python arguments: lines and poses as values, options by their parameters' names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from plsing_ros.errors import ParameterError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters.parameter_set import ParameterSet
from plsing_ros.parameters.scene import scene_values

_P = TypeVar("_P", bound=ParameterSet)


def parameters_from_options(kind: type[_P], options: Mapping[str, Any], lines: LineSet | None = None) -> _P:
    """Return a parameter set from keyword arguments.

    Args:
        kind: Of the set.
        options: By parameter name; names with dots are nested: detour={"margin": 0.2} is detour.margin. Lists, tuples
            and numpy arrays are taken for arrays, a Pose for its two parameters position and orientation.
        lines: The scene, for the parameters lines.*.

    Raises:
        ParameterError: If an option is unknown or its value is not allowed; the message speaks of the argument.
    """
    values = flatten_options(options)
    if lines is not None:
        values |= {**scene_values(lines), "scene_frame": lines.frame}
    try:
        return kind.from_values(values)
    except ParameterError as error:
        raise ParameterError(str(error).replace("parameter", "argument")) from None


def pose_options(pose: Pose) -> dict[str, Any]:
    """Return the parameters position and orientation of a pose."""
    return {"position": pose.translation.tolist(), "orientation": pose.quaternion_xyzw.tolist()}


def flatten_options(options: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested options by parameter name, with dots, after a prefix; a Pose becomes position and orientation."""
    values: dict[str, Any] = {}
    for name, value in options.items():
        if isinstance(value, Mapping):
            values |= flatten_options(value, f"{prefix}{name}.")
        elif isinstance(value, Pose):
            values |= flatten_options(pose_options(value), f"{prefix}{name}.")
        else:
            values[prefix + name] = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    return values
