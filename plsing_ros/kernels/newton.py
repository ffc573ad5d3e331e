"""Newton's method on A(h) k = 0, the rank basis as a matrix linear in the camera centre: see newton.c."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def bilinear_newton(
    tensor: npt.NDArray[Any],
    h: npt.NDArray[Any],
    k: npt.NDArray[Any],
    steps: int,
    enough: float,
    small: float,
    longest: float,
) -> bool:
    """Move homogeneous centres and motions towards zeros of sum h_a A_a k = 0 near them.

    The compiled one is for four lines, n = 4, only, and returns False, with some of them moved, where a Jacobian is
    exactly singular. This one goes on with pseudo-inverses, and for more lines it is Gauss and Newton's method.

    Args:
        tensor: A of each start, complex, shape (k, 4, 2n, 6).
        h: Changed, unit length, complex, shape (k, 4).
        k: Changed, unit length, complex, shape (k, 6).
        steps: At most so many.
        enough: |A(h) k| before a step that makes it the last.
        small: Length of a step that makes it the last.
        longest: Length of a step that is not taken: the Jacobian is numerically singular there.
    """
    active: Any = slice(None)
    rows = np.arange(len(h))
    for _ in range(steps):
        x, y = h[active], k[active]
        jacobian, value = equations(tensor[active], x, y)
        change = solve(jacobian, value)[..., 0]
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.sqrt((change.real**2 + change.imag**2).sum(axis=1))
        taken = length < longest
        change[~taken] = 0.0
        h[active] = unit(x - change[:, :4])
        k[active] = unit(y - change[:, 4:])
        left = np.sqrt(np.einsum("kij,kij->k", value, value.conj()).real)
        active = rows[active][taken & (length > small) & (left > enough)]
        if len(active) == 0:
            break
    return True


def equations(
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


def solve(matrix: npt.NDArray[Any], right: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the solutions of stacked systems (k, m, n) x = (k, m, 1), in the sense of least squares for m > n."""
    if matrix.shape[1] != matrix.shape[2]:
        return np.asarray(np.linalg.pinv(matrix) @ right)
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        # One exactly singular matrix fails the whole stack; the pseudo-inverse gives every one its best answer.
        return np.asarray(np.linalg.pinv(matrix) @ right)


def unit(vectors: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return vectors (k, n) of unit length; a zero vector stays zero."""
    length = np.sqrt(np.einsum("ki,ki->k", vectors, vectors.conj()).real)[:, np.newaxis]
    return np.asarray(vectors / np.maximum(length, np.finfo(float).tiny))
