# SPDX-License-Identifier: Apache-2.0
"""Parameters of the line tracker."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.scene import SceneParameters


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
