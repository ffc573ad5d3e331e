# SPDX-License-Identifier: Apache-2.0
"""A calibrated camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from plsing_ros._core import compiled
from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import GeometryError

# Coefficients in the order k1 k2 p1 p2 k3 k4 k5 k6 of each distortion model of sensor_msgs/CameraInfo.
DISTORTION_MODELS = {"": 0, "plumb_bob": 5, "rational_polynomial": 8}


@dataclass(frozen=True)
class PinholeCamera:
    """Image size, focal lengths and principal point, and lens distortion.

    The centre of the upper left pixel is (0, 0), as in OpenCV and ROS.

    Attributes:
        width: Of the image [px].
        height: Of the image [px].
        fx: Focal length across [px].
        fy: Focal length down [px].
        cx: Principal point [px].
        cy: Principal point [px].
        distortion: k1, k2, p1, p2, k3, k4, k5, k6; shorter if the rest is zero.
        numbers: All of these but the size, shape (12,), as the native core takes them.

    Raises:
        GeometryError: If a size or a focal length is not above zero, or a number is not finite.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    numbers: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not (self.width >= 16 and self.height >= 16):
            raise GeometryError(f"the image is {self.width} x {self.height}; at least 16 x 16 pixels are needed")
        numbers = checked_array("fx, fy, cx, cy of the camera", (self.fx, self.fy, self.cx, self.cy), (4,))
        if not (numbers[:2] > 0.0).all():
            raise GeometryError(
                f"the focal lengths are {self.fx:g} and {self.fy:g}; they must be above 0: is the camera calibrated?"
            )
        coefficients = tuple(float(each) for each in self.distortion)
        if len(coefficients) > 8:
            raise GeometryError(
                f"{len(coefficients)} coefficients of distortion; at most 8 (k1 to k6, p1, p2) are known"
            )
        checked_array("the distortion", coefficients, (len(coefficients),))
        object.__setattr__(self, "distortion", coefficients)
        packed = np.zeros(12)
        packed[:4] = numbers
        packed[4 : 4 + len(coefficients)] = coefficients
        packed.setflags(write=False)
        object.__setattr__(self, "numbers", packed)

    @classmethod
    def from_calibration(
        cls, width: int, height: int, matrix: Sequence[float], model: str, coefficients: Sequence[float]
    ) -> PinholeCamera:
        """Return the camera of a calibration as sensor_msgs/CameraInfo has it.

        Args:
            width: Of the image [px].
            height: Of the image [px].
            matrix: K, row by row, 9 numbers.
            model: Name of the distortion model.
            coefficients: D.

        Raises:
            GeometryError: If the distortion model is not known, or K or D do not describe a camera.
        """
        if model not in DISTORTION_MODELS:
            known = ", ".join(name for name in DISTORTION_MODELS if name)
            raise GeometryError(f"the distortion model is '{model}'; known are {known}")
        if len(matrix) != 9:
            raise GeometryError(f"K has {len(matrix)} numbers, expected 9")
        if len(coefficients) > 0 and len(coefficients) != DISTORTION_MODELS[model]:
            raise GeometryError(
                f"D has {len(coefficients)} numbers, expected {DISTORTION_MODELS[model]} for '{model}' (or none)"
            )
        return cls(width, height, matrix[0], matrix[4], matrix[2], matrix[5], tuple(coefficients))

    @property
    def focal(self) -> float:
        """The mean focal length [px]."""
        return 0.5 * (self.fx + self.fy)

    def project(self, points_camera: Array) -> Array:
        """Return the pixels of points in the optical frame in front of the camera.

        Args:
            points_camera: Shape (n, 3) [m], z > 0.

        Returns:
            Shape (n, 2) [px].

        Source: the distortion model of OpenCV.
        """
        return compiled.project(points_camera, self.numbers)

    def normalised(self, pixels: Array) -> Array:
        """Return where the rays of pixels meet the plane z = 1, shape (n, 2), by fixed-point iteration.

        Args:
            pixels: Shape (n, 2) [px].
        """
        target = (pixels - self.numbers[2:4]) / self.numbers[:2]
        points = target.copy()
        if not self.distortion:
            return points
        for _ in range(20):
            seen = self.project(np.column_stack([points, np.ones(len(points))]))
            points += target - (seen - self.numbers[2:4]) / self.numbers[:2]
        return points
