"""Differences of features, and the motion that makes up for them best: see least_squares.c."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.kernels.interaction import interaction_matrix
from plsing_ros.kernels.singular_values import svd


def subtract(a: Array, b: Array, difference: Array) -> float:
    """Fill a - b and return its norm: infinite only if an element is, or if the norm itself is too large.

    Args:
        a: Of any shape.
        b: Of the same.
        difference: Filled, of the same.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        np.subtract(a, b, out=difference)
    return math.hypot(*difference.ravel().tolist())


def solve(
    matrix: Array,
    right_side: Array,
    singular_values: Array,
    right: Array,
    components: Array,
    solution: Array,
    factor: float,
    threshold: float,
) -> bool:
    """Fill the solution of least squares, by the singular value decomposition; return False if that of svd would.

    Args:
        matrix: Shape (m, k) with k <= 6 and m >= k.
        right_side: Shape (m,).
        singular_values: Filled as by svd, shape (k,).
        right: Likewise, shape (k, k).
        components: Filled with factor times those of the right side along the left singular vectors, shape (k,).
        solution: Filled with factor times pinv(matrix) @ right_side, shape (k,).
        factor: See above.
        threshold: Singular values up to this times the largest are taken as zero.
    """
    left = np.empty(matrix.shape)
    if not svd(matrix, left, singular_values, right):
        return False
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        components[:] = factor * (right_side @ left)
        kept = singular_values > threshold * singular_values[0]
        solution[:] = np.divide(components, singular_values, where=kept, out=np.zeros_like(components)) @ right
    return True


def plain_law(
    direction: Array,
    moment: Array,
    image: Array,
    desired: Array,
    singular_values: Array,
    twist: Array,
    least_depth: float,
    gain: float,
    threshold: float,
) -> float | None:
    """Fill the twist -gain pinv(L) (s - s*) and return |s - s*|, all in one call; None where a step would be refused.

    Args:
        direction: Of n lines in the camera frame, shape (n, 3), n from 2 on.
        moment: Likewise, shape (n, 3) [m].
        image: s, shape (3n,).
        desired: s*, shape (3n,).
        singular_values: Filled with those of L, shape (6,).
        twist: Filled, shape (6,).
        least_depth: As for interaction_matrix.
        gain: See above [1/s].
        threshold: As for solve.
    """
    matrix, error = np.empty((3 * len(direction), 6)), np.empty(len(image))
    if not interaction_matrix(direction, moment, matrix, least_depth):
        return None
    norm = subtract(image, desired, error)
    right, components = np.empty((6, 6)), np.empty(6)
    good = solve(matrix, error, singular_values, right, components, twist, -gain, threshold)
    return norm if good else None
