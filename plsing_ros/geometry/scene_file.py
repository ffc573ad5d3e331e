"""Scenes from ROS parameter files, for use without ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from plsing_ros.errors import PlsingError, SceneFileError
from plsing_ros.geometry.line_set import LineSet


def read_scene(path: str | Path) -> LineSet:
    """Return the lines that a ROS parameter file describes under lines.points, lines.directions, lines.ids.

    Args:
        path: YAML file as for --params-file. The first node name in it that has lines is taken ("/**" as a rule); an
            absent scene_frame means "world".

    Raises:
        SceneFileError: If the file cannot be read, is no such YAML, or does not describe lines; it names the file.
    """
    try:
        content = yaml.safe_load(Path(path).read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise SceneFileError(f"cannot read scene file {path}: {error}") from None
    except yaml.YAMLError as error:
        raise SceneFileError(f"scene file {path} is not YAML: {error}") from None
    for node in content.values() if isinstance(content, dict) else ():
        parameters = node.get("ros__parameters") if isinstance(node, dict) else None
        if not isinstance(parameters, dict):
            continue
        lines = parameters.get("lines")
        if isinstance(lines, dict) and "points" in lines and "directions" in lines:
            try:
                return LineSet.from_points_directions(
                    _rows(lines["points"]),
                    _rows(lines["directions"]),
                    str(parameters.get("scene_frame", "world")),
                    lines.get("ids", ()),
                )
            except (PlsingError, TypeError, ValueError) as error:
                raise SceneFileError(f"scene file {path}: {error}") from None
    raise SceneFileError(
        f"scene file {path} has no lines; expected <node>: ros__parameters: lines: points: [x1, y1, z1, ...], "
        "directions: [x1, y1, z1, ...]"
    )


def _rows(values: Any) -> Any:
    return np.reshape(values, (-1, 3))
