# SPDX-License-Identifier: Apache-2.0
"""Scenes from ROS parameter files, for use without ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import PlsingError, SceneFileError
from plsing_ros.geometry.line_set import LineSet
from plsing_ros.geometry.model import Model

# How well lines are known if a file does not say: a measured map of a room or a workpiece.
POSITION_STD = 1e-3  # [m]
DIRECTION_STD = 1e-3  # [rad]
_MODELS = (".obj", ".cao")


def read_scene(path: str | Path) -> LineSet:
    """Return the lines that a ROS parameter file describes, under lines.points and so on, or the edges of a model.

    Args:
        path: YAML file as for --params-file, or a model: .obj, .cao, or model.* in a YAML file. The first node name in
            it that has either is taken ("/**" as a rule); an absent scene_frame means "world", and absent tolerances
            are those of the nodes, 1 mm and 1 mrad.

    Raises:
        SceneFileError: If the file cannot be read, is no such YAML, or does not describe lines; it names the file.
    """
    model = _model(path)
    if model is not None:
        edges = model.lines()
        return LineSet.from_points_directions(
            edges.pivot, edges.direction, edges.frame, edges.ids, position_std=POSITION_STD, direction_std=DIRECTION_STD
        )
    parameters = _scene_parameters(path)
    lines = parameters["lines"]
    try:
        return LineSet.from_points_directions(
            _rows("lines.points", lines["points"]),
            _rows("lines.directions", lines["directions"]),
            str(parameters.get("scene_frame", "world")),
            _listed("lines.ids", lines.get("ids", [])),
            position_std=_std("lines.position_std", lines.get("position_std", POSITION_STD)),
            direction_std=_std("lines.direction_std", lines.get("direction_std", DIRECTION_STD)),
        )
    except PlsingError as error:
        raise SceneFileError(f"scene file {path}: {error}") from None


def read_segment_ends(path: str | Path, count: int) -> Array | None:
    """Return the ends of the lines, shape (count, 2, 3) [m]: a file's lines.ends, a model's vertices, or None.

    Args:
        path: As for read_scene.
        count: Number of lines.

    Raises:
        SceneFileError: As read_scene, and if there are not two ends for each line.
    """
    model = _model(path)
    if model is not None:
        return model.vertices[model.edges]
    sections = [_scene_parameters(path), *_sections(path)]
    known = [lines["ends"] for each in sections if isinstance(lines := each.get("lines"), dict) and lines.get("ends")]
    ends = known[0] if known else []
    if not ends:
        return None
    try:
        return checked_array("lines.ends", np.reshape(_rows("lines.ends", ends), (-1, 2, 3)), (count, 2, 3))
    except (ValueError, PlsingError) as error:
        raise SceneFileError(f"scene file {path}: {error}; 6 numbers are needed for each of {count} lines") from None


def _model(path: str | Path) -> Model | None:
    """Return the model in a file; None if it has lines."""
    from plsing_ros.geometry.model_files import read_model

    if Path(path).suffix.lower() in _MODELS or "lines" not in _scene_parameters(path):
        return read_model(path)
    return None


def _scene_parameters(path: str | Path) -> dict[str, Any]:
    """Return the parameters of the first node in a file that has lines."""
    for parameters in _sections(path):
        lines = parameters.get("lines")
        if isinstance(lines, dict) and "points" in lines and "directions" in lines:
            return parameters
        if isinstance(parameters.get("model"), dict):
            return parameters
    raise SceneFileError(
        f"scene file {path} has no lines; expected <node>: ros__parameters: lines: points: [x1, y1, z1, ...], "
        "directions: [x1, y1, z1, ...]"
    )


def _sections(path: str | Path) -> list[dict[str, Any]]:
    """Return the parameters of each node in a file."""
    # Only where a file is read: the package imports without yaml.
    from plsing_ros.geometry.yaml_file import read_yaml

    content = read_yaml(path, "scene file")
    nodes = content.values() if isinstance(content, dict) else ()
    found = [node.get("ros__parameters") for node in nodes if isinstance(node, dict)]
    return [parameters for parameters in found if isinstance(parameters, dict)]


def _std(name: str, value: Any) -> Any:
    return value if isinstance(value, int | float) else _listed(name, value)


def _rows(name: str, values: Any) -> Any:
    numbers = _listed(name, values)
    if len(numbers) % 3 or not numbers:
        raise SceneFileError(f"{name} has {len(numbers)} numbers; it must have 3 for each line")
    return np.reshape(numbers, (-1, 3))


def _listed(name: str, values: Any) -> list[Any]:
    if not isinstance(values, list) or any(isinstance(each, list | dict) for each in values):
        raise SceneFileError(f"{name} is {values!r}; it must be a list of numbers")
    return values
