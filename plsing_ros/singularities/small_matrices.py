"""Factorisations of stacks of small matrices: for a single one LAPACK itself, whose wrappers in numpy take longer."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg.lapack import dgeev, dgeqrf, dgesdd, dgesv, dormqr

from plsing_ros.arrays import Array, BoolArray

_WORK = 1024


def orthogonal_complements(matrices: Array) -> tuple[Array, Array]:
    """Return orthonormal bases of what is orthogonal to the columns of matrices, and the diagonals of their R.

    Args:
        matrices: Shape (S, m, n), m > n.

    Returns:
        Bases as columns, shape (S, m, m - n), and absolute values of the diagonals of R in A = Q R, shape (S, n).
    """
    scenes, m, n = matrices.shape
    if scenes == 1:
        factors, tau, _, _ = dgeqrf(matrices[0], _WORK)
        basis, _, _ = dormqr("L", "N", factors, tau, _last_columns(m, m - n), _WORK)
        return basis[np.newaxis], np.abs(factors.diagonal())[np.newaxis]
    orthogonal, triangular = np.linalg.qr(matrices, mode="complete")
    return orthogonal[:, :, n:], np.abs(triangular.diagonal(axis1=1, axis2=2))


def eigenvectors_up(denominator: Array, numerator: Array) -> tuple[BoolArray, npt.NDArray[Any]]:
    """Return eigenvectors of inv(denominator) numerator, one of each conjugate pair: the upper eigenvalue's.

    Args:
        denominator: Real, shape (S, n, n).
        numerator: Real, shape (S, n, n).

    Returns:
        For which of the n eigenvalues of each problem there is a vector, shape (S, n): for the real ones and the first
        of each pair, and these vectors as rows in the same order, shape (number of them, n).
    """
    if len(denominator) == 1:
        _, _, quotient, info = dgesv(denominator[0], numerator[0])
        if info == 0:
            _, imaginary, _, vectors, info = dgeev(quotient, compute_vl=0)
            if info == 0:
                return _unpacked(imaginary, vectors)
    try:
        quotients = np.linalg.solve(denominator, numerator)
    except np.linalg.LinAlgError:
        # Exactly singular in at least one; a perturbation of rounding size makes it solvable.
        quotients = np.linalg.solve(denominator + 1e-15 * np.eye(denominator.shape[-1]), numerator)
    values, vectors = np.linalg.eig(quotients)
    kept = values.imag >= 0.0
    return kept, vectors.swapaxes(1, 2)[kept]


def _unpacked(imaginary: Array, vectors: Array) -> tuple[BoolArray, npt.NDArray[Any]]:
    """Return what eigenvectors_up does from LAPACK's packing: real and imaginary parts of a pair are two columns."""
    kept = imaginary >= 0.0
    rows = vectors.T
    if kept.all():
        return kept[np.newaxis], rows
    found = rows[kept].astype(np.complex128)
    found.imag[imaginary[kept] > 0.0] = rows[~kept]
    return kept[np.newaxis], found


def right_singular_vectors(matrix: Array) -> tuple[Array, Array]:
    """Return the singular values of a matrix (m, n), and all its right singular vectors as rows (n, n)."""
    _, values, right, info = dgesdd(matrix)
    if info != 0:
        _, values, right = np.linalg.svd(matrix)
    return values, right


@cache
def _last_columns(size: int, count: int) -> Array:
    columns = np.asfortranarray(np.eye(size)[:, size - count :])
    columns.setflags(write=False)
    return columns
