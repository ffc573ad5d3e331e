"""What a camera would see along a path, for many poses at once: conditioning, and lines near the focal plane."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.features.projection import DEGENERATE_DEPTH
from plsing_ros.geometry import LineSet


def inverse_condition_numbers(lines: LineSet, rotation: Array, position: Array) -> Array:
    """Return the raw inverse condition number of L at each pose, shape (k,); 0 where a line has no image.

    Args:
        lines: n lines in the scene frame.
        rotation: Of T_world_camera, shape (k, 3, 3).
        position: Camera centres, shape (k, 3) [m].
    """
    direction, moment = _in_camera(lines, rotation, position)
    depth = np.hypot(moment[..., 0], moment[..., 1])
    seen = depth >= DEGENERATE_DEPTH * np.maximum(1.0, np.abs(moment).max(axis=2))
    depth = np.where(seen, depth, 1.0)
    # An image line moves along (-l'_y, l'_x, 0) and (0, 0, 1) only: these two rows have L's singular values.
    image = moment / depth[..., np.newaxis]
    tangent = np.stack([-image[..., 1], image[..., 0], np.zeros_like(depth)], axis=-1)
    last = np.array([0.0, 0.0, 1.0]) - image[..., 2:] * image * (1.0, 1.0, 0.0)
    rows = np.stack([tangent, last], axis=2) / depth[..., np.newaxis, np.newaxis]
    matrix = np.concatenate([cross(rows, direction[:, :, np.newaxis]), cross(rows, moment[:, :, np.newaxis])], axis=-1)
    values = np.linalg.svd(matrix.reshape(len(rotation), 2 * len(lines), 6), compute_uv=False)
    if values.shape[1] < 6:
        return np.zeros(len(rotation))
    inverse: Array = np.where(seen.all(axis=1), values[:, -1] / values[:, 0], 0.0)
    return inverse


def focal_angles(lines: LineSet, rotation: Array, position: Array) -> Array:
    """Return the angle between the focal plane and the plane of camera centre and line, shape (k, n) [rad].

    Where it is zero the line has no image; args as for inverse_condition_numbers.
    """
    _, moment = _in_camera(lines, rotation, position)
    angle: Array = np.arctan2(np.hypot(moment[..., 0], moment[..., 1]), np.abs(moment[..., 2]))
    return angle


def _in_camera(lines: LineSet, rotation: Array, position: Array) -> tuple[Array, Array]:
    moment = lines.moment - cross(position[:, np.newaxis], lines.direction)
    return lines.direction @ rotation, moment @ rotation
