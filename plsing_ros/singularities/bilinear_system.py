# SPDX-License-Identifier: Apache-2.0
"""A(C) k = 0: the rank basis as a matrix linear in the camera centre, and Newton's method on it.

About the scene's centre (the point Q of eq. basiseta) the rows of xi are [f_i, M_i x f_i] and [0, m_i], and f_i and
m_i are linear in C. So the singular centres with their unobservable motions k = (v, w) are the zeros of 2n bilinear
equations A(C) k = 0, in homogeneous coordinates h = (C_0, C) of the centre. For four lines these are as many as
the unknowns.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, cross, minus_skew

_IDENTITY = np.eye(3)
_STEPS = 12
# Newton's error after a step of relative length s is of the order of s squared.
_SMALL_STEP = 1e-8
_LONGEST_STEP = 3.0


def bilinear_tensor(direction: npt.NDArray[Any], point: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return A, shape (S, 4, 2n, 6): A(h) = sum h_a A[a] for h = (C_0, C), for S scenes of n lines.

    Args:
        direction: Unit directions, shape (S, n, 3); complex ones with u . u = 1.
        point: A point on each line, scene coordinates, shape (S, n, 3); the one closest to the origin.
    """
    scenes, n = direction.shape[:2]
    # f = u x M C_0 - u x C, and the moment M x f; columns are the coefficients of h.
    f = np.empty((scenes, n, 3, 4), dtype=direction.dtype)
    f[..., 0] = cross(direction, point)
    f[..., 1:] = minus_skew(direction)
    moment = minus_skew(point) @ -f
    tensor = np.zeros((scenes, 4, 2 * n, 6), dtype=direction.dtype)
    tensor[:, :, :n, :3] = f.transpose(0, 3, 1, 2)
    tensor[:, :, :n, 3:] = moment.transpose(0, 3, 1, 2)
    # m = P C - M C_0, with P the projection across u.
    tensor[:, 0, n:, 3:] = -point
    across = _IDENTITY - direction[..., np.newaxis] * direction[..., np.newaxis, :]
    tensor[:, 1:, n:, 3:] = across.transpose(0, 2, 1, 3)
    return tensor


def motions_from_centers(tensor: Array, h: npt.NDArray[Any], w: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the motions k = (v, w) (k, 6), unit length, that four lines lose at homogeneous centres with axes w.

    Args:
        tensor: Of bilinear_tensor for the scene of each centre, shape (k, 4, 8, 6).
        h: Homogeneous centres, shape (k, 4).
        w: Axis directions, shape (k, 3).
    """
    rows = (h[:, np.newaxis, :] @ tensor[:, :, :4].reshape(len(h), 4, 24)).reshape(len(h), 4, 6)
    f = rows[:, :, :3]
    adjoint = f.conj().swapaxes(1, 2)
    v = _solved(adjoint @ f, adjoint @ (rows[:, :, 3:] @ -w[:, :, np.newaxis]))[..., 0]
    return _unit(np.concatenate([v, w], axis=1))


def newton(
    tensor: npt.NDArray[Any],
    scene: npt.NDArray[np.intp],
    h: npt.NDArray[Any],
    k: npt.NDArray[Any],
    enough: float = 0.0,
    steps: int = _STEPS,
    small: float = _SMALL_STEP,
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Return zeros (h, k) of A(h) k = 0 near the given ones.

    For more than four lines, Gauss-Newton on the overdetermined equations.

    Args:
        tensor: Of bilinear_tensor for S scenes of n >= 4 lines, shape (S, 4, 2n, 6).
        scene: The scene of each start, shape (k,).
        h: Homogeneous centres, shape (k, 4).
        k: Motions, shape (k, 6).
        enough: |A(h) k| before a step that makes it the last.
        steps: At most so many.
        small: Length of a step that makes it the last.
    """
    x, y = np.array(h, dtype=complex), np.array(k, dtype=complex)
    active = np.arange(len(x))
    for _ in range(steps):
        jacobian, value = _equations(tensor[scene[active]], x[active], y[active])
        change = _solved(jacobian, value)[..., 0]
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.sqrt((change.real**2 + change.imag**2).sum(axis=1))
        # A longer step says nothing: the Jacobian is numerically singular.
        taken = length < _LONGEST_STEP
        change[~taken] = 0.0
        x[active], y[active] = _unit(x[active] - change[:, :4]), _unit(y[active] - change[:, 4:])
        left = np.sqrt(np.einsum("kij,kij->k", value, value.conj()).real)
        active = active[taken & (length > small) & (left > enough)]
        if len(active) == 0:
            break
    return x, y


def jacobians(tensor: Array, scene: npt.NDArray[np.intp], h: npt.NDArray[Any], k: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the derivatives of (A(h) k, |h|^2 / 2, |k|^2 / 2) by (h, k), shape (count, 2n + 2, 10)."""
    return _equations(tensor[scene], h, k)[0]


def _equations(
    a: npt.NDArray[Any], h: npt.NDArray[Any], k: npt.NDArray[Any]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Return the Jacobians of A(h) k by (h, k), with the two scales fixed, and the values with two zeros below.

    Shapes (k, 2n + 2, 10) and (k, 2n + 2, 1).
    """
    count, _, rows, _ = a.shape
    of_h = np.matmul(a, k[:, np.newaxis, :, np.newaxis])[..., 0]
    jacobian = np.zeros((count, rows + 2, 10), dtype=h.dtype)
    jacobian[:, :rows, :4] = of_h.swapaxes(1, 2)
    jacobian[:, :rows, 4:] = np.matmul(h[:, np.newaxis, :], a.reshape(count, 4, rows * 6)).reshape(count, rows, 6)
    jacobian[:, rows, :4] = h.conj()
    jacobian[:, rows + 1, 4:] = k.conj()
    value = np.zeros((count, rows + 2, 1), dtype=h.dtype)
    value[:, :rows] = np.matmul(h[:, np.newaxis, :], of_h).swapaxes(1, 2)
    return jacobian, value


def _solved(matrix: npt.NDArray[Any], right: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the solutions of stacked systems (k, m, n) x = (k, m, 1), in the sense of least squares for m > n."""
    if matrix.shape[1] != matrix.shape[2]:
        return np.asarray(np.linalg.pinv(matrix) @ right)
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        # One exactly singular matrix fails the whole stack; the pseudo-inverse gives every one its best answer.
        return np.asarray(np.linalg.pinv(matrix) @ right)


def _unit(vectors: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return vectors (k, n) of unit length; a zero vector stays zero."""
    length = np.sqrt(np.einsum("ki,ki->k", vectors, vectors.conj()).real)[:, np.newaxis]
    return np.asarray(vectors / np.maximum(length, np.finfo(float).tiny))
