"""Parameters of the line tracker."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from plsing_ros.errors import ParameterError, PlsingError
from plsing_ros.geometry.model import Model
from plsing_ros.geometry.model_files import model_from_lists, read_model
from plsing_ros.parameters.parameter_set import ParameterSet, parameter

_ROWS = {"minimum": -1, "maximum": 10**6, "live": False}


@dataclass(frozen=True)
class LineTrackerParameters(ParameterSet):
    """The object that is tracked, and how."""

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
    scene_frame: str = parameter(
        "world", "scene_frame", "Name of the frame of the model and of camera poses", live=False
    )
    camera_frame: str = parameter(
        "camera_optical_frame", "camera_frame", "Name of the camera's optical frame, of line_features", live=False
    )
    gamma: float = parameter(
        2.2,
        "gamma",
        "Exponent from grey levels to light: 2.2 for nearly all cameras, 1 for images that are linear",
        minimum=0.3,
        maximum=4.0,
        live=False,
    )
    use_points: bool = parameter(
        True, "use_points", "Follow points on the faces beside the edges, where OpenCV is installed", live=False
    )
    image_timeout: float = parameter(
        0.5,
        "image_timeout",
        "Images older than this on the node clock are refused",
        unit="s",
        minimum=1e-3,
        maximum=60.0,
    )
    future_tolerance: float = parameter(
        0.1,
        "future_tolerance",
        "Images stamped further ahead of the node clock than this are refused",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )
    max_repeats: int = parameter(
        30,
        "max_repeats",
        "Images in a row that are equal in every pixel, beyond which the camera is taken for frozen",
        minimum=1,
        maximum=10**6,
        live=False,
    )
    watchdog_period: float = parameter(
        0.05,
        "watchdog_period",
        "How often the age of the images is checked (wall clock)",
        unit="s",
        minimum=1e-3,
        maximum=10.0,
        live=False,
    )

    def check(self) -> None:
        """Refuse a model that is none; without any, `model` does."""
        if self.model_file or self.model_vertices:
            self.model()

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
