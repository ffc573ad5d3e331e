# SPDX-License-Identifier: Apache-2.0
"""A camera with a field of view that sees segments of lines, each with an error of angle and offset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, BoolArray
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose

# A line without ends is taken as this long on either side of its pivot [m].
_HALF_LENGTH = 50.0


@dataclass(frozen=True, eq=False)
class SegmentCamera:
    """What is seen, and how exactly.

    Attributes:
        lines: The true lines, in the world frame.
        ends: Of their segments, shape (n, 2, 3) [m]; None: far away.
        noise: Standard deviation of the angle [rad] and of the offset of an image line.
        half_view: Tangents of half the field of view, horizontal and vertical; 0: not limited.
        nearest: Nothing nearer is seen [m].
        min_length: Of the image of a segment that is found, on z = 1.
        frame: Name of the optical frame.
    """

    lines: LineSet
    ends: Array | None
    noise: float
    half_view: tuple[float, float]
    nearest: float
    min_length: float
    frame: str

    def visible(self, T_world_camera: Pose) -> BoolArray:
        """Return which segments have a part in view that is long enough, shape (n,)."""
        ends = self.ends
        if ends is None:
            reach = _HALF_LENGTH * self.lines.direction
            ends = np.stack([self.lines.pivot - reach, self.lines.pivot + reach], axis=1)
        first, second = ((ends[:, k] - T_world_camera.translation) @ T_world_camera.rotation for k in (0, 1))
        step = second - first
        low: Array = np.zeros(len(ends))
        high: Array = np.ones(len(ends))
        for normal, offset in self._planes():
            value, slope = first @ normal - offset, step @ normal
            with np.errstate(divide="ignore", invalid="ignore"):
                crossing = -value / slope
            low = np.where(slope > 0.0, np.maximum(low, crossing), low)
            high = np.where(slope < 0.0, np.minimum(high, crossing), high)
            high = np.where((slope == 0.0) & (value < 0.0), -1.0, high)
        in_view = high > low
        low, high = np.where(in_view, low, 0.0)[:, np.newaxis], np.where(in_view, high, 1.0)[:, np.newaxis]
        parts = np.stack([first + low * step, first + high * step], axis=1)
        depth = np.where(in_view[:, np.newaxis], parts[..., 2], 1.0)[..., np.newaxis]
        image = parts[..., :2] / depth
        long_enough: BoolArray = np.linalg.norm(image[:, 1] - image[:, 0], axis=1) >= self.min_length
        return in_view & long_enough

    def observe(self, T_world_camera: Pose, generator: np.random.Generator) -> LineObservation:
        """Return the image lines with their covariances, and no 3-D lines; draws as much whatever is in view.

        Raises:
            GeometryError: If the camera is too far away to see anything in numbers.
        """
        exact = LineObservation.of_lines(self.lines.transformed(T_world_camera.inverse(), self.frame))
        error = self.noise * generator.normal(size=(len(self.lines), 2))
        image = exact.image_lines
        angle = np.arctan2(image[:, 1], image[:, 0]) + error[:, 0]
        noisy = np.stack([np.cos(angle), np.sin(angle), image[:, 2] + error[:, 1]], axis=1)
        usable = exact.usable & self.visible(T_world_camera)
        variance = max(self.noise, 1e-9) ** 2
        covariances = np.tile([variance, 0.0, variance], (len(self.lines), 1))
        return LineObservation(exact.ids, noisy * usable[:, np.newaxis], usable, None, covariances=covariances)

    def _planes(self) -> list[tuple[Array, float]]:
        """Return the half spaces normal . p >= offset that are seen."""
        planes = [(np.array([0.0, 0.0, 1.0]), self.nearest)]
        for axis, half in enumerate(self.half_view):
            if half > 0.0:
                for sign in (-1.0, 1.0):
                    normal = np.array([0.0, 0.0, half])
                    normal[axis] = sign
                    planes.append((normal, 0.0))
        return planes
