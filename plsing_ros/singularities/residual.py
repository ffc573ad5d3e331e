"""The independent check: how far from rank-deficient the image velocities are at a camera centre."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, BoolArray, cross

# Share of the mean distance below which the distance of a centre to a line is rounding: the centre is on that line.
_ON_LINE = 1e-12
_TINY = np.finfo(float).tiny

# No camera centres at all.
NO_PLACES = np.zeros((0, 3))


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


def residuals_and_incidence(point: Array, direction: Array, centers: npt.NDArray[Any]) -> tuple[Array, BoolArray]:
    """Return singularity_residuals of centres (k, 3), and which of them are on an observed line, each of shape (k,).

    Lines (k, n, 3) if each centre has its own, else (1, n, 3).
    """
    xi, on_line = _rows(point, direction, centers)
    return _ratios(xi), np.logical_or.reduce(on_line, axis=1)


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
    dot = np.einsum("kni,kni->kn", f, f)
    size = _squares(f) if np.iscomplexobj(f) else dot
    unit_square = size.sum(axis=1, keepdims=True) / n
    on_line = size <= _ON_LINE**2 * unit_square
    length: Array = np.empty((len(centers), 2 * n))
    # |u x f| = |f|, since f is across u; so the lengths of both kinds of rows are known before the rows are.
    length[:, :n] = size * unit_square + np.abs(dot) ** 2
    length[:, n:] = size
    if on_line.any():
        f, dot = np.where(on_line[:, :, np.newaxis], 0.0, f), np.where(on_line, 0.0, dot)
        length[np.concatenate([on_line, on_line], axis=1)] = 1.0
    length = np.sqrt(length)
    xi = np.zeros((len(centers), 2 * n, 6), dtype=f.dtype)
    xi[:, :n, :3] = f * np.sqrt(unit_square)[:, :, np.newaxis]
    xi[:, :n, 3:] = direction * dot[:, :, np.newaxis]
    xi[:, n:, 3:] = cross(direction, f)
    xi /= length[:, :, np.newaxis]
    return xi, on_line


def _squares(vectors: npt.NDArray[Any]) -> Array:
    """Return the squared absolute values of contiguous complex vectors, summed along the last axis."""
    parts = vectors.view(np.float64)
    squares: Array = np.einsum("...i,...i", parts, parts)
    return squares


def _ratios(xi: npt.NDArray[Any]) -> Array:
    if len(xi) == 0 or xi.shape[1] < 6:
        return np.zeros(len(xi))
    singular_values = np.linalg.svd(xi, compute_uv=False)
    # 0 / tiny = 0 for a matrix of zeros.
    ratio: Array = singular_values[:, -1] / np.maximum(singular_values[:, 0], _TINY)
    return ratio
