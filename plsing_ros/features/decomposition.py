# SPDX-License-Identifier: Apache-2.0
"""The singular value decomposition of an interaction matrix, made once and used for everything."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.errors import GeometryError


class Decomposition(NamedTuple):
    """L = left @ diag(singular_values) @ right, the thin SVD.

    Attributes:
        left: Orthonormal columns, shape (m, k).
        singular_values: Largest first, shape (k,), mixed units.
        right: Right singular vectors as rows, unit twists (v [m/s], omega [rad/s]) where k is 6, shape (k, k). The
            last one is the motion that changes the image least.
    """

    left: Array
    singular_values: Array
    right: Array

    @property
    def inverse_condition_number(self) -> float:
        """Smallest over largest singular value, in [0, 1]; never infinite."""
        return smallest_over_largest(self.singular_values.tolist())

    def solve(self, values: Array) -> Array:
        """Return pinv(L) @ values, shape (k,), of values (m,), without forming the pseudo-inverse."""
        s = self.singular_values
        solution: Array = np.divide(values @ self.left, s, out=np.zeros(len(s)), where=s > 0.0) @ self.right
        return solution


def decompose(matrix: Array) -> Decomposition:
    """Return the thin singular value decomposition of an interaction matrix, or of some columns of it.

    Args:
        matrix: Shape (m, k), k from 1 to 6; with m < k the missing singular values are zero.

    Raises:
        GeometryError: If it has another shape or is not finite.
    """
    rows = rows_of(matrix)
    parts = _core.svd(rows)
    if parts is None:
        raise not_finite()
    return Decomposition(*parts)


def smallest_over_largest(singular_values: Sequence[float]) -> float:
    """Return the inverse condition number, in [0, 1] and never infinite, of singular values, largest first."""
    largest = singular_values[0]
    return singular_values[-1] / largest if largest > 0.0 else 0.0


def rows_of(matrix: Array) -> Array:
    """Return an interaction matrix, or some columns of it, row after row as the native core wants it.

    Raises:
        GeometryError: If it has another shape than (m, k), k from 1 to 6.
    """
    if matrix.ndim != 2 or not 1 <= matrix.shape[1] <= 6:
        raise GeometryError(f"the interaction matrix has shape {matrix.shape}, expected (m, 6) or some columns of it")
    return np.ascontiguousarray(matrix, dtype=np.float64)


def not_finite() -> GeometryError:
    """Return the error for a matrix that cannot be decomposed."""
    return GeometryError("the interaction matrix holds values that are not finite")
