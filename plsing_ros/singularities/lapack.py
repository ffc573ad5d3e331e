"""Factorisations of stacks of small matrices: for a single one LAPACK itself, whose wrappers in numpy take longer."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.linalg.lapack import dgeev, dgesdd, dgesv

from plsing_ros.arrays import Array


def eigenvectors_up(denominator: Array, numerator: Array) -> tuple[Array, npt.NDArray[np.complex128]]:
    """Return eigenvectors of inv(denominator) numerator, one of each conjugate pair: the upper eigenvalue's.

    Args:
        denominator: Real, shape (S, n, n).
        numerator: Real, shape (S, n, n).

    Returns:
        Imaginary parts of the eigenvalues, shape (S, n), the upper of a pair first; and the vectors of those that are
        not negative as rows in the same order, shape (number of them, n).
    """
    if len(denominator) == 1:
        _, _, quotient, info = dgesv(denominator[0], numerator[0])
        if info == 0:
            _, imaginary, _, packed, info = dgeev(quotient, compute_vl=0, overwrite_a=1)
            if info == 0:
                return imaginary[np.newaxis], _unpacked(imaginary, packed)
    try:
        quotients = np.linalg.solve(denominator, numerator)
    except np.linalg.LinAlgError:
        # One exactly singular matrix fails the whole stack; the pseudo-inverse gives every one its best answer.
        quotients = np.linalg.pinv(denominator) @ numerator
    values, vectors = np.linalg.eig(quotients)
    imaginary = np.ascontiguousarray(values.imag)
    return imaginary, np.ascontiguousarray(vectors.swapaxes(1, 2)[imaginary >= 0.0], dtype=complex)


def _unpacked(imaginary: Array, packed: Array) -> npt.NDArray[np.complex128]:
    """Return what eigenvectors_up does from LAPACK's packing: real and imaginary parts of a pair are two columns."""
    rows, signs = packed.T, imaginary.tolist()
    kept = [i for i, value in enumerate(signs) if value >= 0.0]
    vectors = rows[kept].astype(np.complex128)
    if len(kept) < len(signs):
        upper = [place for place, i in enumerate(kept) if signs[i] > 0.0]
        vectors.imag[upper] = rows[[kept[place] + 1 for place in upper]]
    return vectors


def right_singular_vectors(matrix: Array) -> tuple[Array, Array]:
    """Return the singular values of a matrix (m, n), and all its right singular vectors as rows (n, n)."""
    _, values, right, info = dgesdd(matrix)
    if info != 0:
        _, values, right = np.linalg.svd(matrix)
    return values, right
