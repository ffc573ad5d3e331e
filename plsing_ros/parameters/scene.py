# SPDX-License-Identifier: Apache-2.0
"""Parameters that describe the scene: the observed lines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.errors import ParameterError, PlsingError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.model import Model
from plsing_ros.geometry.model_files import model_from_lists, read_model
from plsing_ros.geometry.scene_file import DIRECTION_STD, POSITION_STD
from plsing_ros.parameters.parameter_set import ParameterSet, parameter

_ROWS: dict[str, Any] = {"minimum": -1, "maximum": 10**6, "live": False}
_INT32 = {"minimum": -(2**31), "maximum": 2**31 - 1}


@dataclass(frozen=True)
class SceneParameters(ParameterSet):
    """The lines of the scene as flat arrays, row i of each belonging to line i; at least one line.

    The default is empty, which `check` refuses: lines must be given, or an object, whose edges are the lines then.
    """

    lines_points: tuple[float, ...] = parameter(
        (), "lines.points", "A point on each line, in the scene frame (x1, y1, z1, x2, ...)", unit="m"
    )
    lines_directions: tuple[float, ...] = parameter(
        (),
        "lines.directions",
        "Direction of each line, in the scene frame, of any length but zero; its sign orients the line "
        "(x1, y1, z1, x2, ...)",
    )
    lines_ids: tuple[int, ...] = parameter(
        (), "lines.ids", "Distinct id of each line, as in line_features; if empty: 1 to n", **_INT32
    )
    lines_position_std: tuple[float, ...] = parameter(
        (POSITION_STD,),
        "lines.position_std",
        "How well the lines are known: standard deviation of the point of each line in both directions across it; "
        "one number for all lines, or one for each",
        unit="m",
        minimum=0.0,
        maximum=1e3,
        live=False,
        one_for_all=True,
    )
    lines_direction_std: tuple[float, ...] = parameter(
        (DIRECTION_STD,),
        "lines.direction_std",
        "Standard deviation of the direction of each line about both axes across it, with its point in place; one "
        "number for all lines, or one for each",
        unit="rad",
        minimum=0.0,
        maximum=1.0,
        live=False,
        one_for_all=True,
    )
    scene_frame: str = parameter(
        "world", "scene_frame", "Name of the frame of the lines and of camera_pose", live=False
    )
    camera_frame: str = parameter(
        "camera_optical_frame",
        "camera_frame",
        "Name of the camera's optical frame (z forward, x right, y down), of line_features and cmd_twist",
        live=False,
    )

    model_file: str = parameter(
        "",
        "model.file",
        "Path of the object's model, an .obj, .cao or .yaml file; if empty, model.vertices",
        live=False,
    )
    model_vertices: tuple[float, ...] = parameter(
        (), "model.vertices", "Corners of the object, in the scene frame (x1, y1, z1, x2, ...)", unit="m", live=False
    )
    model_faces: tuple[int, ...] = parameter(
        (), "model.faces", "Rows of model.vertices round each flat face, from 0; -1 ends a face", **_ROWS
    )
    model_edges: tuple[int, ...] = parameter(
        (), "model.edges", "Pairs of rows of model.vertices; if empty, the borders of the faces", **_ROWS
    )
    model_ids: tuple[int, ...] = parameter(
        (),
        "model.ids",
        "Distinct id of each edge, as in line_features; if empty: 1 to n",
        minimum=-(2**31),
        maximum=2**31 - 1,
        live=False,
    )

    def check(self) -> None:
        """Refuse arrays that describe no lines; where only an object is given, take its edges."""
        if not self.lines_points and not self.lines_directions and (self.model_file or self.model_vertices):
            edges = self.model().lines()
            object.__setattr__(self, "lines_points", tuple(edges.pivot.ravel().tolist()))
            object.__setattr__(self, "lines_directions", tuple(edges.direction.ravel().tolist()))
            object.__setattr__(self, "lines_ids", edges.ids)
        if not self.lines_points and not self.lines_directions:
            raise ParameterError(
                "parameters 'lines.points' and 'lines.directions' are empty: no scene given; "
                "start the node with a parameter file, for example "
                "--ros-args --params-file $(ros2 pkg prefix --share plsing_ros)/config/paper_p4l.yaml"
            )
        if len(self.lines_points) % 3 or len(self.lines_points) != len(self.lines_directions):
            raise ParameterError(
                f"parameters 'lines.points' and 'lines.directions' have {len(self.lines_points)} and "
                f"{len(self.lines_directions)} numbers; they must have 3 for each line, and as many as each other"
            )
        count = len(self.lines_points) // 3
        for name, std in (("position", self.lines_position_std), ("direction", self.lines_direction_std)):
            if len(std) not in (1, count):
                raise ParameterError(
                    f"parameter 'lines.{name}_std' has {len(std)} numbers for {count} lines; it must have 1, or one "
                    "for each line"
                )
        try:
            self.lines()
        except PlsingError as error:
            raise ParameterError(f"parameters 'lines.*': {error}") from None

    def model(self) -> Model:
        """Return the object, in the scene frame.

        Raises:
            ParameterError: If none is given, or the file or the lists do not describe one.
        """
        if not self.model_file and not self.model_vertices:
            raise ParameterError(
                "parameters 'model.file' and 'model.vertices' are empty: no object given; name its model, for example "
                "-p model.file:=part.obj"
            )
        try:
            if self.model_file:
                return read_model(Path(self.model_file), self.scene_frame)
            return model_from_lists(
                list(self.model_vertices),
                list(self.model_faces),
                list(self.model_edges),
                list(self.model_ids),
                self.scene_frame,
            )
        except PlsingError as error:
            raise ParameterError(f"parameters 'model.*': {error}") from None

    def require_three_lines(self, purpose: str) -> None:
        """Refuse a scene of fewer than three lines, with what they are needed for in words."""
        count = len(self.lines_points) // 3
        if count < 3:
            raise ParameterError(f"parameter 'lines.points' gives {count} line(s); at least 3 are needed {purpose}")

    @property
    def scene(self) -> tuple[tuple[float, ...], ...]:
        """All that the lines are made from: two sets with the same have the same lines."""
        return (
            self.lines_points,
            self.lines_directions,
            self.lines_ids,
            self.lines_position_std,
            self.lines_direction_std,
        )

    def lines(self) -> LineSet:
        """Return the lines in the scene frame."""
        count = len(self.lines_points) // 3
        return LineSet.from_points_directions(
            np.reshape(self.lines_points, (-1, 3)),
            np.reshape(self.lines_directions, (-1, 3)),
            self.scene_frame,
            self.lines_ids,
            position_std=np.broadcast_to(self.lines_position_std, (count,)),
            direction_std=np.broadcast_to(self.lines_direction_std, (count,)),
        )


def scene_values(lines: LineSet) -> dict[str, Any]:
    """Return a scene as parameters by ROS name."""
    return {
        "lines.points": lines.pivot.ravel().tolist(),
        "lines.directions": lines.direction.ravel().tolist(),
        "lines.ids": list(lines.ids),
        "lines.position_std": lines.position_std.tolist(),
        "lines.direction_std": lines.direction_std.tolist(),
    }


def pose_from_parameters(what: str, position: tuple[float, ...], orientation: tuple[float, ...]) -> Pose:
    """Return a pose given as position and quaternion parameters.

    Args:
        what: Name that the two parameters share, for the message: "<what>.position", "<what>.orientation".
        position: x, y, z [m].
        orientation: Unit quaternion x, y, z, w.

    Raises:
        ParameterError: If they are not of length 3 and 4, or the quaternion is not of unit length.
    """
    if len(position) != 3 or len(orientation) != 4:
        raise ParameterError(
            f"parameters '{what}.position' and '{what}.orientation' have {len(position)} and {len(orientation)} "
            "numbers; they must have 3 (x, y, z) and 4 (quaternion x, y, z, w)"
        )
    try:
        return Pose.from_quaternion(position, orientation)
    except PlsingError as error:
        raise ParameterError(f"parameters '{what}.position', '{what}.orientation': {error}") from None
