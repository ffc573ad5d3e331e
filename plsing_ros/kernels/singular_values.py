"""The singular value decomposition of a matrix of few columns: see singular_values.c."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.kernels.interaction import interaction_matrix


def svd(matrix: Array, left: Array, singular_values: Array, right: Array) -> bool:
    """Fill the thin singular value decomposition; return False if the matrix or a singular value is not finite.

    The compiled one is a QR decomposition by Householder's reflections with pivots and Jacobi's one-sided rotations of
    its triangular factor, as exact as LAPACK's and for a few lines twice as fast (docs/results/performance.md).

    Args:
        matrix: Shape (m, k) with k <= 6; with m < k it is refused likewise.
        left: Filled, shape (m, k).
        singular_values: Filled, largest first, shape (k,).
        right: Filled, right singular vectors as rows, shape (k, k).
    """
    # LAPACK does not return from a matrix with infinite elements.
    if len(matrix) < len(singular_values) or not np.isfinite(matrix).all():
        return False
    try:
        left[:], singular_values[:], right[:] = np.linalg.svd(matrix, full_matrices=False)
    except np.linalg.LinAlgError:
        return False
    return bool(np.isfinite(singular_values).all())


def interaction_svd(
    direction: Array, moment: Array, left: Array, singular_values: Array, right: Array, least_depth: float
) -> bool:
    """Fill the decomposition of the interaction matrix; return False if interaction_matrix or svd would.

    Args:
        direction: Of n lines in the camera frame, shape (n, 3); fewer than two are refused.
        moment: Likewise, shape (n, 3) [m].
        left: Filled as by svd, shape (3n, 6).
        singular_values: Likewise, shape (6,).
        right: Likewise, shape (6, 6).
        least_depth: As for interaction_matrix.
    """
    matrix = np.empty(left.shape)
    return interaction_matrix(direction, moment, matrix, least_depth) and svd(matrix, left, singular_values, right)
