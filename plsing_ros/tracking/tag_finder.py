# SPDX-License-Identifier: Apache-2.0
"""The camera's pose from an AprilTag or ArUco marker at a known place, by OpenCV: a first pose for the tracker."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.errors import ParameterError
from plsing_ros.geometry import Pose
from plsing_ros.geometry.tag import FAMILIES, Tag
from plsing_ros.tracking.camera import PinholeCamera

Image = npt.NDArray[np.uint8]

# Corners in the order of OpenCV: top left, top right, bottom right, bottom left.
_CORNERS = 0.5 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]], dtype=float)


class TagFinder:
    """Finds a tag in images.

    Raises:
        ParameterError: If OpenCV, or its module aruco, is not installed, or the family has no such tag.
    """

    def __init__(self, tag: Tag) -> None:
        self._tag = tag
        try:
            self._cv: ModuleType = importlib.import_module("cv2")
            aruco: Any = self._cv.aruco
        except (ImportError, AttributeError):
            raise ParameterError(
                "a tag needs OpenCV with its module aruco: sudo apt install python3-opencv "
                "or pip install opencv-python-headless"
            ) from None
        name = getattr(aruco, FAMILIES[tag.family])
        # OpenCV 4.7 took these functions away and made a class of them.
        if hasattr(aruco, "ArucoDetector"):
            dictionary, options = aruco.getPredefinedDictionary(name), aruco.DetectorParameters()
        else:
            dictionary, options = aruco.Dictionary_get(name), aruco.DetectorParameters_create()
        options.cornerRefinementMethod = aruco.CORNER_REFINE_APRILTAG
        self._detect = (
            aruco.ArucoDetector(dictionary, options).detectMarkers
            if hasattr(aruco, "ArucoDetector")
            else lambda image: aruco.detectMarkers(image, dictionary, parameters=options)
        )
        count = len(dictionary.bytesList)
        if tag.number >= count:
            raise ParameterError(f"the tag's id is {tag.number}; the family {tag.family} has the tags 0 to {count - 1}")

    def find(self, image: Image, camera: PinholeCamera) -> list[Pose]:
        """Return T_world_camera, the likeliest first; of a small tag two poses look nearly the same.

        Args:
            image: Grey, of the camera's size.
            camera: Its calibration.

        Returns:
            Nothing if the tag is not seen, or seen twice.
        """
        corners, numbers, _ = self._detect(image)
        pairs = [] if numbers is None else zip(corners, numbers.ravel().tolist(), strict=True)
        seen = [each for each, number in pairs if number == self._tag.number]
        if len(seen) != 1:
            return []
        points = camera.normalised(seen[0].reshape(4, 2).astype(float))
        done, turns, shifts, errors = self._cv.solvePnPGeneric(
            self._tag.size * _CORNERS, points, np.eye(3), None, flags=self._cv.SOLVEPNP_IPPE_SQUARE
        )
        if not done:
            return []
        found = []
        for row in np.argsort(np.ravel(errors), kind="stable").tolist():
            T_camera_tag = Pose(self._cv.Rodrigues(turns[row])[0], shifts[row].ravel())
            found.append(self._tag.T_world_tag @ T_camera_tag.inverse())
        return found
