"""The independent check: how far from rank-deficient the image velocities are at a camera centre."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, BoolArray, cross

# Share of the mean distance below which the distance of a centre to a line is rounding: the centre is on that line.
_ON_LINE = 1e-12
_TINY = np.finfo(float).tiny


def singularity_residuals(point: Array, direction: Array, centers: npt.NDArray[Any]) -> Array:
    """Return the smallest over the largest singular value of the row-normalised xi at camera centres.

    Lengths are measured in the root mean square distance from the centre to the lines, so that the result has no
    unit and does not become small just because the centre is far away. The rows of a line that the centre is on are
    zero.

    Args:
        point: A point on each line, shape (n, 3).
        direction: Unit directions, shape (n, 3).
        centers: Camera centres in the frame and unit of point, real or complex, shape (k, 3).

    Returns:
        Shape (k,), in [0, 1]; 0 at a singularity.

    Source: eq. basiseta with Q = C and the point of each line closest to C, for which CM x f = |f|^2 u.
    """
    return _ratios(normalized_rank_basis(point, direction, centers))


def isolated_residuals(point: Array, direction: Array, centers: npt.NDArray[Any]) -> Array:
    """Return singularity_residuals of centres (k, 3), each with lines (k, n, 3) of its own, shape (k,).

    1 for a centre on an observed line, which is a singularity of another kind than these are asked for.
    """
    xi, on_line = _rows(point, direction, centers)
    residual = _ratios(xi)
    residual[on_line.any(axis=1)] = 1.0
    return residual


def normalized_rank_basis(point: Array, direction: Array, centers: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the row-normalised xi about each centre, shape (k, 2n, 6), in the unit of singularity_residuals.

    First the n rows [f_i, |f_i|^2 u_i], then the n rows [0, m_i]. For a complex centre |f|^2 is f . f, without
    conjugation, so that xi stays polynomial in the centre.

    Args:
        point: A point on each line, shape (n, 3), or (k, n, 3) if each centre has lines of its own.
        direction: Unit directions, of the same shape.
        centers: Shape (k, 3).
    """
    return _rows(point, direction, centers)[0]


def _rows(point: Array, direction: Array, centers: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], BoolArray]:
    """Return normalized_rank_basis, and which lines each centre is on, shape (k, n)."""
    n = point.shape[-2]
    f = cross(direction, point - centers[:, np.newaxis, :])
    dot = (f * f).sum(axis=2)
    square = (f.real**2 + f.imag**2).sum(axis=2) if np.iscomplexobj(f) else dot
    unit_square = square.sum(axis=1, keepdims=True) / n
    # |u x f| = |f|, since f is across u; so both lengths are known before the rows are.
    first = np.sqrt(square * unit_square + dot.real**2 + dot.imag**2)
    second = np.sqrt(square)
    on_line = square <= _ON_LINE**2 * unit_square
    if on_line.any():
        f, dot = np.where(on_line[:, :, np.newaxis], 0.0, f), np.where(on_line, 0.0, dot)
        first[on_line] = second[on_line] = 1.0
    xi = np.zeros((len(centers), 2 * n, 6), dtype=f.dtype)
    xi[:, :n, :3] = f * (np.sqrt(unit_square) / first)[:, :, np.newaxis]
    xi[:, :n, 3:] = direction * (dot / first)[:, :, np.newaxis]
    xi[:, n:, 3:] = cross(direction, f / second[:, :, np.newaxis])
    return xi, on_line


def _ratios(xi: npt.NDArray[Any]) -> Array:
    if len(xi) == 0 or xi.shape[1] < 6:
        return np.zeros(len(xi))
    singular_values = np.linalg.svd(xi, compute_uv=False)
    # 0 / tiny = 0 for a matrix of zeros.
    ratio: Array = singular_values[:, -1] / np.maximum(singular_values[:, 0], _TINY)
    return ratio
