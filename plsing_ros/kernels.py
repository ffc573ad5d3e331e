"""The inner loops of every cycle: compiled where the package was built with a C compiler, else made of numpy.

Both give the same numbers to rounding. They fill arrays that the caller has made, C-contiguous and float64, and check
nothing of them but what they say; use them through LineSet, interaction_matrix and factorised.
"""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array

__all__ = [
    "COMPILED",
    "are_image_lines",
    "are_lines",
    "have_images",
    "interaction_matrix",
    "is_rotation",
    "svd",
]


def are_lines_of_numpy(direction: Array, moment: Array, tolerance: float) -> bool:
    """Return whether all rows are finite, directions of unit length, and moments orthogonal to them.

    Args:
        direction: Shape (n, 3).
        moment: Shape (n, 3) [m].
        tolerance: Of the squared length, and of the product relative to 1 m plus the moment's largest element.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        unit_error = np.abs(np.einsum("ij,ij->i", direction, direction) - 1.0)
        skewness = np.abs(np.einsum("ij,ij->i", direction, moment))
        allowed = tolerance * (1.0 + np.abs(moment).max(axis=1))
        return bool(np.isfinite(moment).all() and ((unit_error <= tolerance) & (skewness <= allowed)).all())


def are_image_lines_of_numpy(image_lines: Array, tolerance: float) -> bool:
    """Return whether all rows (n, 3) are finite with l'_x^2 + l'_y^2 = 1, whose root may be off by the tolerance."""
    length = np.hypot(image_lines[:, 0], image_lines[:, 1])
    return bool((np.abs(length - 1.0) <= tolerance).all() and np.isfinite(image_lines[:, 2]).all())


def have_images_of_numpy(moment: Array, least_depth: float) -> bool:
    """Return whether all lines of these moments in the camera frame, shape (n, 3) [m], have an image.

    A line has none if |(l_x, l_y)| is below least_depth times the larger of 1 m and the moment's largest element.
    """
    depth = np.hypot(moment[:, 0], moment[:, 1])
    return bool((depth >= least_depth * np.maximum(1.0, np.abs(moment).max(axis=1))).all())


def is_rotation_of_numpy(rotation: Array, tolerance: float) -> bool:
    """Return whether a matrix (3, 3) is a rotation, its product with its transpose being off by up to the tolerance."""
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(rotation @ rotation.T - np.eye(3))
    return bool((error <= tolerance).all() and np.linalg.det(rotation) > 0.0)


def interaction_matrix_of_numpy(direction: Array, moment: Array, matrix: Array, least_depth: float) -> bool:
    """Fill the interaction matrix of n lines; return False, with the matrix unfinished, if one has no image.

    Args:
        direction: In the camera frame, shape (n, 3).
        moment: Likewise, shape (n, 3) [m].
        matrix: Filled, shape (3n, 6).
        least_depth: As for have_images.

    Source: features.interaction_matrix.
    """
    if not have_images_of_numpy(moment, least_depth):
        return False
    depth = np.hypot(moment[:, 0], moment[:, 1])
    image = moment / depth[:, np.newaxis]
    moment_rate = matrix.reshape(-1, 3, 6)
    moment_rate[:] = np.concatenate([direction @ _SKEW, moment @ _SKEW], axis=2).transpose(1, 0, 2)
    depth_rate = (image * _IN_PLANE)[:, np.newaxis] @ moment_rate
    moment_rate -= image[:, :, np.newaxis] * depth_rate
    moment_rate /= depth[:, np.newaxis, np.newaxis]
    return True


def svd_of_numpy(matrix: Array, left: Array, singular_values: Array, right: Array) -> bool:
    """Fill the thin singular value decomposition; return False if the matrix or a singular value is not finite.

    The compiled one is a QR decomposition by Householder's reflections and Jacobi's one-sided rotations of its
    triangular factor, as exact as LAPACK's and for six columns two to four times as fast (docs/performance.md).

    Args:
        matrix: Shape (m, k) with k <= 6 and m >= k.
        left: Filled, shape (m, k).
        singular_values: Filled, largest first, shape (k,).
        right: Filled, right singular vectors as rows, shape (k, k).
    """
    # LAPACK does not return from a matrix with infinite elements.
    if not np.isfinite(matrix).all():
        return False
    try:
        left[:], singular_values[:], right[:] = np.linalg.svd(matrix, full_matrices=False)
    except np.linalg.LinAlgError:
        return False
    return bool(np.isfinite(singular_values).all())


# vectors @ _SKEW are the rows of [vector]x: the first of each vector, then the second, then the third.
_SKEW = np.zeros((3, 3, 3))
_SKEW[0, 2, 1], _SKEW[0, 1, 2], _SKEW[1, 2, 0], _SKEW[1, 0, 2], _SKEW[2, 1, 0], _SKEW[2, 0, 1] = -1, 1, 1, -1, -1, 1
_IN_PLANE = np.array([1.0, 1.0, 0.0])

try:
    from plsing_ros import _kernels
except ImportError:
    COMPILED = False
else:
    COMPILED = True

are_image_lines = _kernels.are_image_lines if COMPILED else are_image_lines_of_numpy
are_lines = _kernels.are_lines if COMPILED else are_lines_of_numpy
have_images = _kernels.have_images if COMPILED else have_images_of_numpy
interaction_matrix = _kernels.interaction_matrix if COMPILED else interaction_matrix_of_numpy
is_rotation = _kernels.is_rotation if COMPILED else is_rotation_of_numpy
svd = _kernels.svd if COMPILED else svd_of_numpy
