"""The interaction matrix L of line features: ds/dt = L tau."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.features.projection import _usable_depth
from plsing_ros.geometry import LineSet


def interaction_matrix(lines_camera: LineSet) -> Array:
    """Return L with ds/dt = L @ twist for the image lines of fixed 3-D lines seen by a moving camera.

    Args:
        lines_camera: n lines in the camera's optical frame.

    Returns:
        Shape (3n, 6). Columns 0 to 2 multiply the camera's linear velocity [1/m], columns 3 to 5 its angular
        velocity [1/rad], both in the camera's optical frame. Rank at most 2 for each line.

    Raises:
        DegenerateProjectionError: If a line meets the camera centre or lies in z = 0.

    Source: eq. MPlucker with the opposite sign: the paper's twist is that of the lines relative to the camera, ours
    that of the camera (docs/conventions.md).
    """
    depth = _usable_depth(lines_camera)[:, np.newaxis, np.newaxis]
    image = lines_camera.moment / depth[:, :, 0]
    in_plane = image * (1.0, 1.0, 0.0)
    d_image_d_moment = (np.eye(3) - image[:, :, np.newaxis] * in_plane[:, np.newaxis, :]) / depth
    d_moment_d_twist = np.concatenate([_skew(lines_camera.direction), _skew(lines_camera.moment)], axis=2)
    matrix: Array = (d_image_d_moment @ d_moment_d_twist).reshape(-1, 6)
    return matrix


def _skew(vectors: Array) -> Array:
    """Return the matrices of b -> a cross b for the rows a, shape (n, 3, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
