# SPDX-License-Identifier: Apache-2.0
"""What a camera would see along a path, for many poses at once: conditioning, and lines near the focal plane."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array, IntArray
from plsing_ros.features.image_jacobians import image_jacobians, lines_in_cameras
from plsing_ros.geometry import LineSet


def inverse_condition_numbers(lines: LineSet, rotation: Array, position: Array) -> Array:
    """Return the raw inverse condition number of L at each pose, shape (k,); 0 where a line has no image.

    Args:
        lines: n lines in the scene frame.
        rotation: Of T_world_camera, shape (k, 3, 3).
        position: Camera centres, shape (k, 3) [m].
    """
    jacobians = image_jacobians(lines, rotation, position)
    matrix = jacobians.of_twist.reshape(len(rotation), 2 * len(lines), 6)
    values = np.linalg.svd(matrix, compute_uv=False)
    if values.shape[1] < 6:
        return np.zeros(len(rotation))
    inverse: Array = np.where(jacobians.has_image.all(axis=1), values[:, -1] / values[:, 0], 0.0)
    return inverse


def focal_angles(lines: LineSet, rotation: Array, position: Array) -> Array:
    """Return the angle between the focal plane and the plane of camera centre and line, shape (k, n) [rad].

    Where it is zero the line has no image; args as for inverse_condition_numbers.
    """
    _, moment = lines_in_cameras(lines, rotation, position)
    angle: Array = np.arctan2(np.hypot(moment[..., 0], moment[..., 1]), np.abs(moment[..., 2]))
    return angle


def lines_in_view(lines: LineSet, rotation: Array, position: Array, half_view: tuple[float, float]) -> IntArray:
    """Return how many lines are seen from each pose, shape (k,): those that pass through the image in front of it.

    Args:
        lines, rotation, position: As for inverse_condition_numbers.
        half_view: Tangents of half the field of view, horizontal and vertical.
    """
    direction, moment = lines_in_cameras(lines, rotation, position)
    seen = np.zeros(moment.shape[:2], dtype=bool)
    # The image line l . (x, y, 1) = 0 is cut with the image's four edges, each cut is followed to the line in space.
    for axis, other in ((0, 1), (1, 0)):
        for edge in (-half_view[axis], half_view[axis]):
            with np.errstate(divide="ignore", invalid="ignore"):
                along = -(moment[..., axis] * edge + moment[..., 2]) / moment[..., other]
                ray = np.empty((*along.shape, 3))
                ray[..., axis], ray[..., other], ray[..., 2] = edge, along, 1.0
                across = np.cross(ray, direction)
                depth = np.einsum("kni,kni->kn", moment, across) / np.einsum("kni,kni->kn", across, across)
                seen |= (np.abs(along) <= half_view[other]) & (depth > 0.0)
    counts: IntArray = np.count_nonzero(seen, axis=1)
    return counts
