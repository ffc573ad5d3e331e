"""How near a matrix of image velocities is to losing rank, and which motion it loses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import GeometryError


@dataclass(frozen=True, eq=False)
class Conditioning:
    """Conditioning of an interaction matrix at one camera pose.

    Attributes:
        singular_values: Of the raw matrix, largest first, shape (6,), mixed units.
        inverse_condition_number: Smallest over largest of them, in [0, 1]; the number the literature reports.
        scaled_inverse_condition_number: The same with the translation columns multiplied by characteristic_length,
            which makes it free of units, in [0, 1].
        characteristic_length: [m].
        weakest_motion: Unit twist (v [m/s], omega [rad/s]) of the camera that changes the image least, in its optical
            frame, shape (6,); at a singularity the lost motion. Its sign makes its largest entry positive.
    """

    singular_values: Array
    inverse_condition_number: float
    scaled_inverse_condition_number: float
    characteristic_length: float
    weakest_motion: Array

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

    Source: section 7 of docs/conventions.md ("The condition number").
    """
    values = checked_array("matrix", matrix, (None, 6))
    if not (np.isfinite(characteristic_length) and characteristic_length > 0.0):
        raise GeometryError(f"characteristic_length is {characteristic_length} m; it must be positive and finite")
    singular_values, right = _svd_of_columns(values)
    scaled = values * np.array([characteristic_length] * 3 + [1.0] * 3)
    scaled_singular_values = singular_values if characteristic_length == 1.0 else _svd_of_columns(scaled)[0]
    weakest = right[-1]
    return Conditioning(
        singular_values,
        _ratio(singular_values),
        _ratio(scaled_singular_values),
        float(characteristic_length),
        weakest * np.sign(weakest[np.argmax(np.abs(weakest))]),
    )


def inverse_condition_number(matrix: npt.ArrayLike) -> float:
    """Return the smallest over the largest singular value of a matrix (m, 6), in [0, 1]; never infinite."""
    return conditioning(matrix).inverse_condition_number


def _svd_of_columns(matrix: Array) -> tuple[Array, Array]:
    """Return six singular values and the six right singular vectors as rows, for any number of rows."""
    rows = np.vstack([matrix, np.zeros((6 - len(matrix), 6))]) if len(matrix) < 6 else matrix
    _, singular_values, right = np.linalg.svd(rows, full_matrices=False)
    return singular_values, right


def _ratio(singular_values: Array) -> float:
    largest = float(singular_values[0])
    return float(singular_values[-1]) / largest if largest > 0.0 else 0.0
