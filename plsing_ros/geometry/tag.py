# SPDX-License-Identifier: Apache-2.0
"""A printed tag at a known place in the scene."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.geometry.pose import Pose

# Names of OpenCV's dictionaries by the families' own.
FAMILIES = {
    "tag16h5": "DICT_APRILTAG_16h5",
    "tag25h9": "DICT_APRILTAG_25h9",
    "tag36h10": "DICT_APRILTAG_36h10",
    "tag36h11": "DICT_APRILTAG_36h11",
    "aruco4x4": "DICT_4X4_250",
    "aruco5x5": "DICT_5X5_250",
    "aruco6x6": "DICT_6X6_250",
}


@dataclass(frozen=True, eq=False)
class Tag:
    """A tag in the scene.

    Attributes:
        family: One of FAMILIES.
        number: Its id.
        size: Side of the black square [m].
        T_world_tag: Where its middle is: x to the right and y up as it is printed, z out of it.
    """

    family: str
    number: int
    size: float
    T_world_tag: Pose
