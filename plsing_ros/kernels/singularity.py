"""How far from rank-deficient the image velocities are at many camera centres: see singularity.c."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, BoolArray, cross

_TINY = np.finfo(float).tiny


def singularity_ratios(
    direction: Array, point: Array, centers: npt.NDArray[Any], ratio: Array, distance: Array, on_line: float
) -> None:
    """Fill the smallest over the largest singular value of normalized_rank_basis.

    The compiled one makes the matrix bidiagonal by Householder's reflections and that diagonal by Golub and Kahan's
    steps, the algorithm of LAPACK's zgesvd, and as exact.

    Args:
        direction: Unit directions, shape (1, n, 3), or (k, n, 3) if each centre has lines of its own; n >= 3.
        point: A point on each line, of the same shape.
        centers: Camera centres, complex, shape (k, 3).
        ratio: Filled, shape (k,); 1 for a centre that is not finite or so far that products of lengths overflow.
        distance: Filled, shape (k,): of the nearest line, in the root mean square distance; infinite for those.
        on_line: That distance up to which a centre is on a line, whose rows are zero then.

    Raises:
        ValueError: If the iteration for singular values does not converge, which has not been seen.
    """
    ratio[:], distance[:] = 1.0, np.inf
    with np.errstate(over="ignore", invalid="ignore"):
        xi, nearest = normalized_rank_basis(direction, point, centers, on_line)
    good = np.isfinite(xi).all(axis=(1, 2)) & np.isfinite(nearest)
    singular_values = np.linalg.svd(xi[good], compute_uv=False)
    # 0 / tiny = 0 for a matrix of zeros.
    ratio[good] = singular_values[:, -1] / np.maximum(singular_values[:, 0], _TINY)
    distance[good] = nearest[good]


def normalized_rank_basis(
    direction: Array, point: Array, centers: npt.NDArray[Any], on_line: float
) -> tuple[npt.NDArray[Any], Array]:
    """Return the row-normalised xi about each centre, shape (k, 2n, 6), and the distances of the nearest lines, (k,).

    First the n rows [f_i, |f_i|^2 u_i], then the n rows [0, m_i], lengths in the root mean square distance from the
    centre to the lines. For a complex centre |f|^2 is f . f, without conjugation, so that xi stays polynomial in the
    centre. Arguments as for singularity_ratios; a real centre gives a real matrix.
    """
    n = point.shape[-2]
    f = cross(direction, point - centers[:, np.newaxis, :])
    size = np.einsum("kni,kni->kn", f, f.conj()).real
    unit_square = size.sum(axis=1) / n
    nearest: Array = np.sqrt(size.min(axis=1) / np.maximum(unit_square, _TINY))
    # In units of length before anything of fourth order is formed, which could over- or underflow.
    unit = np.sqrt(np.where(np.isfinite(unit_square), np.where(unit_square > 0.0, unit_square, 1.0), np.nan))
    f /= unit[:, np.newaxis, np.newaxis]
    dot = np.einsum("kni,kni->kn", f, f)
    size = np.einsum("kni,kni->kn", f, f.conj()).real
    merged: BoolArray = size <= on_line**2
    length: Array = np.empty((len(centers), 2 * n))
    # |u x f| = |f|, since f is across u; so the lengths of both kinds of rows are known before the rows are.
    length[:, :n] = size + np.abs(dot) ** 2
    length[:, n:] = size
    f, dot = np.where(merged[:, :, np.newaxis], 0.0, f), np.where(merged, 0.0, dot)
    length[np.concatenate([merged, merged], axis=1)] = 1.0
    length = np.sqrt(length)
    xi = np.zeros((len(centers), 2 * n, 6), dtype=f.dtype)
    xi[:, :n, :3] = f
    xi[:, :n, 3:] = direction * dot[:, :, np.newaxis]
    xi[:, n:, 3:] = cross(direction, f)
    xi /= length[:, :, np.newaxis]
    return xi, nearest
