# SPDX-License-Identifier: Apache-2.0
"""Parameters of the line tracker."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry.tag import FAMILIES, Tag
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.scene import SceneParameters, pose_from_parameters


@dataclass(frozen=True)
class LineTrackerParameters(SceneParameters):
    """How the object of model.* is tracked."""

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
    readout_time: float = parameter(
        0.0,
        "readout_time",
        "From the first row of an image to the last, of a camera with a rolling shutter; 0 if all are taken at once",
        unit="s",
        minimum=0.0,
        maximum=1.0,
        live=False,
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
    tag_family: str = parameter(
        "",
        "tag.family",
        "Of a tag that gives the first pose, and a new one after a loss; if empty, only initial_pose does",
        choices=("", *FAMILIES),
        live=False,
    )
    tag_id: int = parameter(0, "tag.id", "Which tag of the family", minimum=0, maximum=100_000, live=False)
    tag_size: float = parameter(
        0.05, "tag.size", "Side of the tag's black square", unit="m", minimum=1e-3, maximum=10.0, live=False
    )
    tag_position: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "tag.position", "Middle of the tag, in the scene frame: x, y, z", unit="m", live=False
    )
    tag_orientation: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0, 1.0),
        "tag.orientation",
        "Of the tag (x to the right and y up as it is printed, z out of it), in the scene frame: unit quaternion "
        "x, y, z, w",
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
        """Refuse an object or a tag that is none."""
        super().check()
        self.tag()

    def tag(self) -> Tag | None:
        """Return the tag, or None."""
        if not self.tag_family:
            return None
        T_world_tag = pose_from_parameters("tag", self.tag_position, self.tag_orientation)
        return Tag(self.tag_family, self.tag_id, self.tag_size, T_world_tag)

    def edge_std(self) -> Array:
        """Return how well each edge of the object is known, as lines.* say, shape (n, 2) [m] and [rad].

        Edges that are no lines of the scene are known as the worst of these.
        """
        lines = self.lines()
        of_lines = np.column_stack([lines.position_std, lines.direction_std])
        known, worst = dict(zip(lines.ids, of_lines, strict=True)), of_lines.max(axis=0)
        return np.array([known.get(each, worst) for each in self.model().ids])
