"""The interaction matrix, and the mean of two: see interaction.c."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.kernels.lines import have_images


def interaction_matrix(direction: Array, moment: Array, matrix: Array, least_depth: float) -> bool:
    """Fill the interaction matrix of n lines; return False, with the matrix unfinished, if one has no image.

    Args:
        direction: In the camera frame, shape (n, 3).
        moment: Likewise, shape (n, 3) [m].
        matrix: Filled, shape (3n, 6).
        least_depth: As for have_images.

    Source: features.interaction_matrix.
    """
    if not have_images(moment, least_depth):
        return False
    depth = np.hypot(moment[:, 0], moment[:, 1])
    image = moment / depth[:, np.newaxis]
    moment_rate = matrix.reshape(-1, 3, 6)
    moment_rate[:] = np.concatenate([direction @ _SKEW, moment @ _SKEW], axis=2).transpose(1, 0, 2)
    depth_rate = (image * _IN_PLANE)[:, np.newaxis] @ moment_rate
    moment_rate -= image[:, :, np.newaxis] * depth_rate
    moment_rate /= depth[:, np.newaxis, np.newaxis]
    return True


def mean_interaction(
    image: Array, desired_image: Array, interaction: Array, desired_interaction: Array, mean: Array, columns: int
) -> None:
    """Fill the mean of L and L*, whose rows are turned to the image lines of L before.

    Args:
        image: s, shape (3n,).
        desired_image: s*, shape (3n,).
        interaction: L, or some columns of it, shape (3n, k).
        desired_interaction: L*, likewise.
        mean: Filled, shape (3n, k).
        columns: k, from 1 to 6.

    Source: servoing.laws.mean_interaction.
    """
    across, across_desired = _across(image), _across(desired_image)
    turned = desired_interaction.reshape(-1, 3, columns).copy()
    turn = np.einsum("ij,ijk->ik", across_desired, turned[:, :2])
    turned[:, :2] = across[:, :, np.newaxis] * turn[:, np.newaxis]
    mean[:] = 0.5 * (interaction + turned.reshape(mean.shape))


def _across(image: Array) -> Array:
    """Return (-sin a, cos a) of each image line, shape (n, 2)."""
    lines = image.reshape(-1, 3)
    return np.column_stack([-lines[:, 1], lines[:, 0]])


# vectors @ _SKEW are the rows of [vector]x: the first of each vector, then the second, then the third.
_SKEW = np.zeros((3, 3, 3))
_SKEW[0, 2, 1], _SKEW[0, 1, 2], _SKEW[1, 2, 0], _SKEW[1, 0, 2], _SKEW[2, 1, 0], _SKEW[2, 0, 1] = -1, 1, 1, -1, -1, 1
_IN_PLANE = np.array([1.0, 1.0, 0.0])
