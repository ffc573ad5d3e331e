"""From eigenvectors to the ten isolated points of four lines: see ten_points.c."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array

_TINY = np.finfo(float).tiny
# Last singular value of the equations of a centre, relative to the one before, from which they leave it free along a
# line: the axis direction is that of a curve of singular centres.
_AMBIGUOUS = 1e-3


def axis_centers(
    imaginary: Array,
    functionals: Array,
    multiply: Array,
    direction: Array,
    point: Array,
    vectors: npt.NDArray[Any],
    w: npt.NDArray[Any],
    h: npt.NDArray[Any],
    center: npt.NDArray[Any],
    at_infinity: float,
) -> None:
    """Fill axis directions and camera centres with P_i w . (M_i - C) = 0 from eigenvectors of S scenes.

    Args:
        imaginary: Imaginary parts of the eigenvalues, shape (S, 10); a vector is given for those that are not negative.
        functionals: Of quartic_functionals, shape (S, 10, 15).
        multiply: From the coefficients of a functional on quartics to its values at x, y and z times each of the ten
            cubic monomials, shape (3, 10, 15).
        direction: Unit directions, shape (S, 4, 3).
        point: The point of each line closest to the scene's centre, scene coordinates, shape (S, 4, 3).
        vectors: In the basis of the functionals, complex, shape (k, 10).
        w: Filled, complex, shape (k, 3).
        h: Filled, homogeneous centres (C_0, C), complex, unit length, shape (k, 4); zero where there is not only one.
        center: Filled, C / C_0, complex, shape (k, 3); NaN at infinity and where there is not only one.
        at_infinity: |C_0| up to which a centre is at infinity.
    """
    scene = (imaginary >= 0.0).nonzero()[0]
    products = ((vectors[:, np.newaxis] @ functionals[scene])[:, 0] @ multiply.reshape(30, 15).T).reshape(-1, 3, 10)
    largest = np.abs(products).max(axis=1).argmax(axis=1)
    w[:] = products[np.arange(len(scene)), :, largest]
    w /= np.maximum(np.abs(w).max(axis=1, keepdims=True), _TINY)
    across = w[:, np.newaxis, :] - (direction[scene] @ w[:, :, np.newaxis]) * direction[scene]
    rows = np.empty((len(w), 4, 4), dtype=complex)
    rows[:, :, 0] = -np.einsum("kni,kni->kn", across, point[scene])
    rows[:, :, 1:] = across
    # Singular at the right w: the weakest right singular vector.
    _, size, right = np.linalg.svd(rows)
    h[:] = right[:, -1].conj()
    h[size[:, 3] >= _AMBIGUOUS * size[:, 2]] = 0.0
    finite = np.abs(h[:, 0]) > at_infinity
    center[:] = np.nan
    center[finite] = h[finite, 1:] / h[finite, :1]


def with_conjugates(
    imaginary: Array,
    h: npt.NDArray[Any],
    center: npt.NDArray[Any],
    residual: Array,
    ten: npt.NDArray[Any],
    residuals: Array,
    real: Array,
    overlap: Array,
    is_real: float,
) -> None:
    """Fill the ten points of each of S scenes from those that were computed, one of each conjugate pair.

    Args:
        imaginary: Imaginary parts of the eigenvalues, shape (S, 10); negative for what follows its conjugate.
        h: Homogeneous centres, complex, unit length, shape (k, 4).
        center: Centres, complex, shape (k, 3); NaN at infinity.
        residual: Shape (k,).
        ten: Filled, complex, shape (S, 10, 3).
        residuals: Filled, shape (S, 10).
        real: Filled with 1 for real points, else 0, shape (S, 10).
        overlap: Filled, shape (S,): the largest modulus of the inner product of the h of two of the ten.
        is_real: Imaginary part of a real point's centre, relative to 1 plus its largest component.
    """
    kept = imaginary >= 0.0
    # A slot that was left out follows the one with its conjugate.
    source = kept.cumsum() - 1
    both = np.concatenate([h, center], axis=1)[source]
    np.conjugate(both, out=both, where=~kept.reshape(-1, 1))
    both = both.reshape(len(kept), 10, 7)
    ten[:] = both[:, :, 4:]
    residuals[:] = residual[source].reshape(-1, 10)
    real[:] = np.abs(ten.imag).max(axis=2) <= is_real * (1.0 + np.abs(ten).max(axis=2))
    products = np.abs(both[:, :, :4] @ both[:, :, :4].conj().swapaxes(1, 2))
    products[:, np.arange(10), np.arange(10)] = 0.0
    overlap[:] = products.max(axis=(1, 2))
