# SPDX-License-Identifier: Apache-2.0
"""Models from files: Wavefront OBJ, ViSP's .cao, and ROS parameter files with model.*."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.errors import GeometryError, PlsingError, SceneFileError
from plsing_ros.geometry.model import Model

_MAX_DEPTH = 8  # of .cao files that load each other


def read_model(path: str | Path, frame: str = "world") -> Model:
    """Return the object that a file describes; its ending says how.

    Args:
        path: An .obj, .cao, .yaml or .yml file.
        frame: Name for the frame of the vertices; a parameter file's own scene_frame goes before it.

    Raises:
        SceneFileError: If the file cannot be read or does not describe a model; it names the file and, where there is
            one, the line.
    """
    file = Path(path)
    readers = {".obj": _read_obj, ".cao": _read_cao, ".yaml": _read_yaml, ".yml": _read_yaml}
    reader = readers.get(file.suffix.lower())
    if reader is None:
        raise SceneFileError(f"model file {file}: its ending is '{file.suffix}'; known are {', '.join(readers)}")
    try:
        return reader(file, frame)
    except SceneFileError:
        raise
    except PlsingError as error:
        raise SceneFileError(f"model file {file}: {error}") from None


def model_from_lists(vertices: list[float], faces: list[int], edges: list[int], ids: list[int], frame: str) -> Model:
    """Return the model of flat lists, as ROS parameters have them.

    Args:
        vertices: x1, y1, z1, x2, ... [m].
        faces: Rows of vertices round each face, from 0; -1 ends a face.
        edges: Pairs of rows of vertices; if empty, the borders of the faces are the edges.
        ids: Of the edges; if empty, 1 to n.
        frame: Frame of the vertices.

    Raises:
        GeometryError: If the lists have impossible lengths or do not describe a model.
    """
    if len(vertices) % 3 or not vertices:
        raise GeometryError(f"model.vertices has {len(vertices)} numbers; it must have 3 for each vertex")
    if len(edges) % 2:
        raise GeometryError(f"model.edges has {len(edges)} numbers; it must have 2 for each edge")
    points = np.reshape(np.array(vertices, dtype=float), (-1, 3))
    polygons: list[list[int]] = [[]]
    for row in faces:
        if row == -1:
            polygons.append([])
        else:
            polygons[-1].append(row)
    polygons = [polygon for polygon in polygons if polygon]
    if not edges:
        model = Model.from_faces(points, polygons, frame)
        return Model(model.vertices, model.edges, model.faces, frame, tuple(ids)) if ids else model
    pairs = np.reshape(np.array(edges, dtype=np.int32), (-1, 2))
    return Model(points, pairs, tuple(tuple(polygon) for polygon in polygons), frame, tuple(ids))


def _lines(file: Path) -> Iterator[tuple[int, str]]:
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneFileError(f"cannot read model file {file}: {error}") from None
    for number, line in enumerate(text.splitlines(), 1):
        content = line.split("#", 1)[0].strip()
        if content:
            yield number, content


def _read_obj(file: Path, frame: str) -> Model:
    """Vertices, faces and line elements; where there are line elements, they are the edges."""
    vertices: list[list[float]] = []
    faces: list[list[int]] = []
    drawn: list[tuple[int, int]] = []
    for number, line in _lines(file):
        word, *rest = line.split()
        try:
            if word == "v":
                vertices.append([float(each) for each in rest[:3]])
                if len(vertices[-1]) != 3:
                    raise ValueError(f"a vertex has {len(rest)} numbers, expected 3")
            elif word in ("f", "l"):
                rows = [_obj_row(each, len(vertices)) for each in rest]
                if word == "f":
                    faces.append(rows)
                else:
                    drawn += pairwise(rows)
        except ValueError as error:
            raise SceneFileError(f"model file {file}, line {number}: {error}") from None
    if not vertices or not (faces or drawn):
        raise SceneFileError(f"model file {file} has {len(vertices)} vertices and no faces or lines")
    if drawn:
        return Model(np.array(vertices), np.array(drawn, dtype=np.int32), tuple(map(tuple, faces)), frame)
    return Model.from_faces(np.array(vertices), faces, frame)


def _obj_row(text: str, count: int) -> int:
    row = int(text.split("/", 1)[0])
    row = row - 1 if row > 0 else count + row
    if not 0 <= row < count:
        raise ValueError(f"vertex {text} does not exist; {count} were given before this line")
    return row


class _CaoReader:
    """The numbers of a .cao file one after the other, each with its line for messages."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.loads: list[Path] = []
        self._lines: list[tuple[int, list[str]]] = []
        lines = list(_lines(file))
        if not lines or lines[0][1].split()[0] != "V1":
            raise SceneFileError(f"model file {file}: the first line must be V1")
        for number, line in lines[1:]:
            loaded = re.fullmatch(r'load\(\s*"([^"]+)"\s*\)', line)
            if loaded:
                self.loads.append(file.parent / loaded.group(1))
            else:
                self._lines.append((number, line.split()))

    def count(self, what: str) -> int:
        if not self._lines:
            return 0
        number, words = self._lines.pop(0)
        if not words[0].isdigit():
            raise SceneFileError(f"model file {self.file}, line {number}: '{words[0]}' is no number of {what}")
        return int(words[0])

    def numbers(self, what: str, kind: type, length: int | None = None) -> list[Any]:
        """Return the numbers of a line: as many as given, or as its first number says; names behind are left out."""
        if not self._lines:
            raise SceneFileError(f"model file {self.file} ends where {what} should be")
        number, words = self._lines.pop(0)
        try:
            values = [kind(word) for word in words[: length or int(words[0]) + 1]]
        except ValueError:
            values = []
        if len(values) != (length or (values[0] + 1 if values else 1)):
            raise SceneFileError(f"model file {self.file}, line {number}: '{' '.join(words)}' is not {what}")
        return values if length else values[1:]


def _read_cao(file: Path, frame: str) -> Model:
    """Points, lines, faces from lines and faces from points; cylinders and circles have no straight edges."""
    vertices: list[list[float]] = []
    faces: list[list[int]] = []
    drawn: list[tuple[int, int]] = []
    _add_cao(file, vertices, faces, drawn, 0)
    if not faces and not drawn:
        raise SceneFileError(f"model file {file} has no straight edges")
    return Model.from_faces(np.array(vertices), faces, frame, extra_edges=drawn)


def _add_cao(
    file: Path, vertices: list[list[float]], faces: list[list[int]], drawn: list[tuple[int, int]], depth: int
) -> None:
    if depth > _MAX_DEPTH:
        raise SceneFileError(f"model file {file} is loaded by a file that it loads")
    reader = _CaoReader(file)
    for loaded in reader.loads:
        _add_cao(loaded, vertices, faces, drawn, depth + 1)
    base = len(vertices)
    vertices += [reader.numbers("a point", float, 3) for _ in range(reader.count("points"))]
    segments = [reader.numbers("a line between two points", int, 2) for _ in range(reader.count("lines"))]
    of_lines = [reader.numbers("a face from lines", int) for _ in range(reader.count("faces from lines"))]
    of_points = [reader.numbers("a face from points", int) for _ in range(reader.count("faces from points"))]
    try:
        polygons = [*([segments[i][0] for i in face] for face in of_lines), *of_points]
    except IndexError:
        raise SceneFileError(f"model file {file}: a face names a line that does not exist") from None
    used = [row for each in (*segments, *polygons) for row in each]
    if used and not 0 <= min(used) <= max(used) < len(vertices) - base:
        raise SceneFileError(
            f"model file {file}: points {min(used)} to {max(used)} are named; there are 0 to {len(vertices) - base - 1}"
        )
    faces += [[base + row for row in face] for face in polygons]
    drawn += [(base + a, base + b) for a, b in segments]


def _read_yaml(file: Path, frame: str) -> Model:
    # Only where such a file is read: the package imports without yaml.
    from plsing_ros.geometry.yaml_file import read_yaml

    content = read_yaml(file, "model file")
    for node in content.values() if isinstance(content, dict) else ():
        parameters = node.get("ros__parameters") if isinstance(node, dict) else None
        described = parameters.get("model") if isinstance(parameters, dict) else None
        if isinstance(parameters, dict) and isinstance(described, dict):
            return _yaml_model(file, described, str(parameters.get("scene_frame", frame)))
    raise SceneFileError(
        f"model file {file} has no model; expected <node>: ros__parameters: model: vertices: [x1, y1, z1, ...], "
        "faces: [0, 1, 2, 3, -1, ...]"
    )


def _yaml_model(file: Path, described: dict[str, Any], frame: str) -> Model:
    if described.get("file"):
        named = Path(str(described["file"]))
        return read_model(named if named.is_absolute() else file.parent / named, frame)
    lists: dict[str, list[Any]] = {}
    for name, kind in (("vertices", (int, float)), ("faces", int), ("edges", int), ("ids", int)):
        values = described.get(name, [])
        if not isinstance(values, list) or not all(isinstance(each, kind) for each in values):
            raise SceneFileError(f"model file {file}: model.{name} must be a list of numbers")
        lists[name] = values
    return model_from_lists(lists["vertices"], lists["faces"], lists["edges"], lists["ids"], frame)
