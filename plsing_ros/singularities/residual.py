"""The independent check: how far from rank-deficient the image velocities are at a camera centre."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array

# Share of the mean distance below which the distance of a centre to a line is rounding: the centre is on that line.
_ON_LINE = 1e-12


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


def scene_residuals(point: Array, direction: Array, scene: npt.NDArray[np.intp], centers: npt.NDArray[Any]) -> Array:
    """Return singularity_residuals of centres (k, 3), each in its own of S scenes of lines (S, n, 3), shape (k,).

    1 for a centre on an observed line, which is a singularity of another kind than these are asked for.
    """
    xi = normalized_rank_basis(point[scene], direction[scene], centers)
    on_line = ~np.asarray(xi.any(axis=2)).all(axis=1)
    return np.where(on_line, 1.0, _ratios(xi))


def normalized_rank_basis(point: Array, direction: Array, centers: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the row-normalised xi about each centre, shape (k, 2n, 6), in the unit of singularity_residuals.

    First the n rows [f_i, |f_i|^2 u_i], then the n rows [0, m_i]. For a complex centre |f|^2 is f . f, without
    conjugation, so that xi stays polynomial in the centre.

    Args:
        point: A point on each line, shape (n, 3), or (k, n, 3) if each centre has lines of its own.
        direction: Unit directions, of the same shape.
        centers: Shape (k, 3).
    """
    n = point.shape[-2]
    f = cross(direction, point - centers[:, np.newaxis, :])
    dot = (f * f).sum(axis=2)
    square = (f.real**2 + f.imag**2).sum(axis=2) if np.iscomplexobj(f) else dot
    unit = np.sqrt(square.sum(axis=1, keepdims=True) / n)
    unit = np.where(unit > 0.0, unit, 1.0)
    on_line = square <= (_ON_LINE * unit) ** 2
    if on_line.any():
        f = np.where(on_line[:, :, np.newaxis], 0.0, f)
        dot, square = np.where(on_line, 0.0, dot), np.where(on_line, 0.0, square)
    # |u x f| = |f|, since f is across u; so both lengths are known before the rows are.
    first = np.sqrt(square * unit**2 + dot.real**2 + dot.imag**2)
    first = np.where(first > 0.0, first, 1.0)
    second = np.sqrt(np.where(square > 0.0, square, 1.0))
    xi = np.zeros((len(centers), 2 * n, 6), dtype=f.dtype)
    xi[:, :n, :3] = f * (unit / first)[:, :, np.newaxis]
    xi[:, :n, 3:] = direction * (dot / first)[:, :, np.newaxis]
    xi[:, n:, 3:] = cross(direction, f / second[:, :, np.newaxis])
    return xi


def _ratios(xi: npt.NDArray[Any]) -> Array:
    if len(xi) == 0 or xi.shape[1] < 6:
        return np.zeros(len(xi))
    singular_values = np.linalg.svd(xi, compute_uv=False)
    largest = singular_values[:, 0]
    ratio: Array = singular_values[:, -1] / np.where(largest > 0.0, largest, 1.0)
    return ratio


def cross(first: Array, second: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return first x second along the last axis; numpy's own takes ten times longer on arrays of this size."""
    out = np.empty(np.broadcast_shapes(first.shape, second.shape), dtype=second.dtype)
    x, y, z = first[..., 0], first[..., 1], first[..., 2]
    a, b, c = second[..., 0], second[..., 1], second[..., 2]
    out[..., 0] = y * c - z * b
    out[..., 1] = z * a - x * c
    out[..., 2] = x * b - y * a
    return out
