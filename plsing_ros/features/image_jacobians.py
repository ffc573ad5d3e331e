# SPDX-License-Identifier: Apache-2.0
"""How image lines move with the camera, for many poses at once, in their own two coordinates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array, BoolArray, cross
from plsing_ros.features.projection import DEGENERATE_DEPTH
from plsing_ros.geometry import LineSet


class ImageJacobians(NamedTuple):
    """Derivatives of the image lines l' = (cos phi, sin phi, rho) of n lines at k poses.

    Attributes:
        of_twist: d(phi, rho) / d(v, omega) of the camera in its optical frame, shape (k, n, 2, 6).
        of_moment: d(phi, rho) / dl of the line's moment in the camera frame, shape (k, n, 2, 3) [1/m].
        image_lines: l', shape (k, n, 3).
        has_image: Whether the line has an image there, shape (k, n); the other rows mean nothing.
    """

    of_twist: Array
    of_moment: Array
    image_lines: Array
    has_image: BoolArray


def image_jacobians(lines: LineSet, rotation: Array, position: Array) -> ImageJacobians:
    """Return how the image lines of each pose move.

    L has the same singular values as of_twist: an image line moves along (-l'_y, l'_x, 0) and (0, 0, 1) only.

    Args:
        lines: n lines in the world frame.
        rotation: Of T_world_camera, shape (k, 3, 3).
        position: Camera centres, shape (k, 3) [m].

    Source: eq. MPlucker in the coordinates (phi, rho); tested against central differences.
    """
    direction, moment = lines_in_cameras(lines, rotation, position)
    depth = np.hypot(moment[..., 0], moment[..., 1])
    seen = depth >= DEGENERATE_DEPTH * np.maximum(1.0, np.abs(moment).max(axis=2))
    depth = np.where(seen, depth, 1.0)
    image = moment / depth[..., np.newaxis]
    tangent = np.stack([-image[..., 1], image[..., 0], np.zeros_like(depth)], axis=-1)
    last = np.array([0.0, 0.0, 1.0]) - image[..., 2:] * image * (1.0, 1.0, 0.0)
    rows = np.stack([tangent, last], axis=2) / depth[..., np.newaxis, np.newaxis]
    of_twist = np.concatenate(
        [cross(rows, direction[:, :, np.newaxis]), cross(rows, moment[:, :, np.newaxis])], axis=-1
    )
    return ImageJacobians(of_twist, rows, image, seen)


def lines_in_cameras(lines: LineSet, rotation: Array, position: Array) -> tuple[Array, Array]:
    """Return directions and moments of lines in the frames of cameras, shapes (k, n, 3); arguments as above."""
    moment = lines.moment - cross(position[:, np.newaxis], lines.direction)
    return lines.direction @ rotation, moment @ rotation
