"""The pose of a camera from lines that it sees and the same lines in the scene: see alignment.c."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array


@np.errstate(invalid="ignore", over="ignore")
def align(
    direction: Array,
    moment: Array,
    seen_direction: Array,
    seen_moment: Array,
    rotation: Array,
    translation: Array,
    quality: Array,
) -> bool:
    """Fill T_world_camera from n lines; return False, with it unfinished, if the lines do not fix it or are not finite.

    Args:
        direction: In the scene frame, shape (n, 3).
        moment: Likewise, shape (n, 3) [m].
        seen_direction: In the camera frame, shape (n, 3).
        seen_moment: Likewise, shape (n, 3) [m].
        rotation: Filled, shape (3, 3).
        translation: Filled, shape (3,) [m].
        quality: Filled, shape (3,): the second singular value of the directions' correlation, the least cosine between
            a direction and the seen one, and the root mean square misfit of the moments [m].

    Source: geometry.align_lines.
    """
    correlation = direction.T @ seen_direction
    if not np.isfinite(correlation).all():
        quality[0] = -1.0
        return False
    left, values, right = np.linalg.svd(correlation)
    if np.linalg.det(left) * np.linalg.det(right) < 0.0:
        left = left * (1.0, 1.0, -1.0)
    np.matmul(left, right, out=rotation)
    quality[:2] = values[1], least_cosine(direction, rotation, seen_direction)
    # The rows of t x u are those of -[u]x t.
    x, y, z = direction.T
    zero = np.zeros_like(x)
    matrix = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=-1).reshape(-1, 3)
    difference = (moment - seen_moment @ rotation.T).ravel()
    # LAPACK does not return from what is not finite.
    if not np.isfinite(difference).all():
        return False
    translation[:], _, rank, _ = np.linalg.lstsq(matrix, difference, rcond=None)
    misfit = matrix @ translation - difference
    quality[2] = np.sqrt(misfit @ misfit / len(direction))
    return bool(rank == 3 and np.isfinite(translation).all())


def least_cosine(direction: Array, rotation: Array, seen_direction: Array) -> float:
    """Return the least cosine between directions and the seen ones turned by the rotation.

    Args:
        direction: In the scene frame, shape (n, 3).
        rotation: Of T_world_camera, shape (3, 3).
        seen_direction: In the camera frame, shape (n, 3).
    """
    return float(np.einsum("ij,ij->i", direction @ rotation, seen_direction).min())
