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
    values = _flatten("", options)
    if lines is not None:
        values |= {**scene_values(lines), "scene_frame": lines.frame}
    try:
        return kind.from_values(values)
    except ParameterError as error:
        raise ParameterError(str(error).replace("parameter", "argument")) from None


def _flatten(prefix: str, options: Mapping[str, Any]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, value in options.items():
        if isinstance(value, Mapping):
            values |= _flatten(f"{prefix}{name}.", value)
        elif isinstance(value, Pose):
            values[f"{prefix}{name}.position"] = value.translation.tolist()
            values[f"{prefix}{name}.orientation"] = value.quaternion_xyzw.tolist()
        else:
            values[prefix + name] = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    return values
