# SPDX-License-Identifier: Apache-2.0
"""The motion that changes the image as asked for, as far as least squares goes, and what its laws are made from."""

from __future__ import annotations

from typing import NamedTuple

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.errors import GeometryError
from plsing_ros.features.decomposition import not_finite, rows_of


class LeastSquaresSolution(NamedTuple):
    """Least squares by the singular value decomposition L = U diag(s) V'.

    Attributes:
        singular_values: s, largest first, shape (k,), mixed units.
        right: V', right singular vectors as rows, shape (k, k).
        components: Of the right side along the columns of U, shape (k,); another inverse than the pseudo-inverse gives
            (components * its factors) @ right.
        solution: pinv(L) @ right side, shape (k,).
    """

    singular_values: Array
    right: Array
    components: Array
    solution: Array


def feature_error(image: Array, target_image: Array) -> tuple[Array, float]:
    """Return s - s*, shape (m,), and its norm; what overflows ends as infinite.

    Args:
        image: s, shape (m,).
        target_image: s*, shape (m,).

    Raises:
        GeometryError: If the lengths differ.
    """
    if len(image) != len(target_image):
        raise GeometryError(f"s has {len(image)} values and s* has {len(target_image)}; they must be as many")
    return _core.subtract(image, target_image)


def solve_least_squares(
    matrix: Array, right_side: Array, factor: float = 1.0, threshold: float = 0.0
) -> LeastSquaresSolution:
    """Return the least-squares solution of matrix @ x = factor * right_side, of all such ones the shortest.

    Args:
        matrix: Shape (m, k), k from 1 to 6.
        right_side: Shape (m,). What overflows ends as a solution that is not finite.
        factor: See above.
        threshold: Singular values up to this times the largest are taken as zero.

    Raises:
        GeometryError: If the matrix has another shape or is not finite, or the right side is of another length.
    """
    rows = rows_of(matrix)
    given = len(right_side)
    if given != len(matrix):
        raise GeometryError(f"the right side has {given} values for an interaction matrix of {len(matrix)} rows")
    parts = _core.solve(rows, right_side, factor, threshold)
    if parts is None:
        raise not_finite()
    return LeastSquaresSolution(*parts)
