# SPDX-License-Identifier: Apache-2.0
"""How near a matrix of image velocities is to losing rank, and which motion it loses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import GeometryError
from plsing_ros.features.decomposition import decompose, smallest_over_largest


class Conditioning(NamedTuple):
    """Conditioning of an interaction matrix at one camera pose.

    Attributes:
        singular_values: Of the raw matrix, largest first, shape (6,), mixed units.
        inverse_condition_number: Smallest over largest of them, in [0, 1]; the number the literature reports.
        scaled_inverse_condition_number: The same with the translation columns multiplied by characteristic_length,
            which makes it free of units, in [0, 1].
        characteristic_length: [m].
        right: Right singular vectors as rows, each of either sign, shape (6, 6).
    """

    singular_values: Array
    inverse_condition_number: float
    scaled_inverse_condition_number: float
    characteristic_length: float
    right: Array

    @property
    def least_observable_direction(self) -> Array:
        """Unit twist (v [m/s], omega [rad/s]) of the camera that changes the image least, shape (6,).

        It is in the optical frame, and its sign makes its largest entry positive; at a singularity it is the
        unobservable motion.
        """
        vector: Array = self.right[len(self.singular_values) - 1]
        return vector if max(vector.tolist(), key=abs) > 0.0 else -vector

    @property
    def smallest_singular_value(self) -> float:
        """The last of singular_values."""
        return float(self.singular_values[-1])


def conditioning(matrix: npt.ArrayLike, characteristic_length: float = 1.0) -> Conditioning:
    """Return the conditioning of an interaction matrix.

    Args:
        matrix: Interaction matrix, shape (m, 6), any m; with m < 6 the rank is deficient and the inverse condition
            number is 0.
        characteristic_length: Length that makes translation and rotation columns comparable [m], > 0.

    Raises:
        GeometryError: If the matrix is not finite or has another shape, or the length is not positive.

    Source: docs/conventions.md section "The condition number".
    """
    _, values, right = decompose(checked_array("matrix", matrix, (None, 6)))
    return conditioning_of(values, right, characteristic_length)


def conditioning_of(singular_values: Array, right: Array, characteristic_length: float) -> Conditioning:
    """Return the conditioning of a matrix with these singular values (6,) and right singular vectors, rows (6, 6)."""
    if not 0.0 < characteristic_length < math.inf:
        raise GeometryError(f"characteristic_length is {characteristic_length} m; it must be positive and finite")
    inverse = scaled_inverse = smallest_over_largest(singular_values.tolist())
    if characteristic_length != 1.0:
        # The left singular vectors do not change the singular values of the product.
        scale = np.array([characteristic_length] * 3 + [1.0] * 3)
        scaled_inverse = decompose(singular_values[:, np.newaxis] * right * scale).inverse_condition_number
    return Conditioning(singular_values, inverse, scaled_inverse, float(characteristic_length), right)


def inverse_condition_number(matrix: npt.ArrayLike) -> float:
    """Return the smallest over the largest singular value of a matrix (m, 6), in [0, 1]; never infinite."""
    return conditioning(matrix).inverse_condition_number
