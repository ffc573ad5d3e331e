"""The five plane quartics whose common zeros are the axis directions of the ten points: see quartics.c."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np

from plsing_ros.arrays import Array, cross

_TINY = np.finfo(float).tiny
_IDENTITY = np.eye(3)
# Row i of the line's coordinates belongs to column i of its own constraint.
_OWN_COLUMN = np.eye(4)[:, np.newaxis, :]
_PAIRS = list(combinations(range(5), 2))


def quartic_functionals(
    direction: Array, point: Array, samples: Array, interpolate: Array, functionals: Array, margin: Array
) -> None:
    """Fill bases of the functionals on plane quartics that vanish on the five quartics of each of S scenes.

    The quartics are the 4 x 4 minors of the force matrix (singularities/isolated_points.py).

    Args:
        direction: Unit directions, shape (S, 4, 3).
        point: The point of each line closest to the scene's centre, scene coordinates, shape (S, 4, 3).
        samples: Axis directions at which the quartics are evaluated, shape (15, 3).
        interpolate: From values there to coefficients, shape (15, 15).
        functionals: Filled, orthonormal rows, shape (S, 10, 15).
        margin: Filled, shape (S,): how far the five are from being dependent, in [0, 1]; NaN if not finite.
    """
    scenes = len(direction)
    matrix = _force_matrix(direction, point).swapaxes(1, 2).reshape(scenes, 20, 3)
    columns = (samples @ matrix.swapaxes(1, 2)).reshape(scenes, 15, 4, 5)
    outer = columns[:, :, ::2, :, np.newaxis] * columns[:, :, 1::2, np.newaxis, :]
    pairs = outer.reshape(scenes, 15, 2, 25) @ _WEDGE
    minors = (pairs[:, :, 0, :, np.newaxis] * pairs[:, :, 1, np.newaxis, :]).reshape(scenes, 15, 100) @ _LAPLACE
    orthogonal, triangular = np.linalg.qr(interpolate @ minors, mode="complete")
    functionals[:] = orthogonal[:, :, 5:].swapaxes(1, 2)
    size = np.abs(triangular.diagonal(axis1=1, axis2=2))
    # 0 / tiny = 0 for a matrix of zeros.
    margin[:] = size.min(axis=1) / np.maximum(size.max(axis=1), _TINY)


def _force_matrix(direction: Array, point: Array) -> Array:
    """Return the five equations as bilinear forms in a basis of the forces and w, shape (S, 5, 4, 3)."""
    scenes = len(direction)
    constraints = np.empty((scenes, 4, 3, 8))
    constraints[:, :, :, :4] = direction[..., np.newaxis] * _OWN_COLUMN
    constraints[:, :, :, 4:7] = _IDENTITY
    constraints[:, :, :, 7] = point
    forces = np.linalg.qr(constraints.reshape(scenes, 12, 8), mode="complete")[0][:, :, 8:]
    forces = forces.swapaxes(1, 2).reshape(scenes, 4, 4, 3)
    equations = np.empty((scenes, 5, 4, 3))
    equations[:, :4] = cross(direction[:, np.newaxis], forces).swapaxes(1, 2)
    equations[:, 4] = np.einsum("sfni,sni->sfn", forces, cross(direction, point)) @ direction
    return equations


def _wedge_signs() -> Array:
    """Return W (25, 10): (outer product of two columns of five) @ W = their 2 x 2 minors."""
    signs = np.zeros((5, 5, 10))
    for pair, (i, j) in enumerate(_PAIRS):
        signs[i, j, pair], signs[j, i, pair] = 1.0, -1.0
    return signs.reshape(25, 10)


def _laplace_signs() -> Array:
    """Return E (100, 5): (2 x 2 minors of the first two columns, outer, those of the last two) @ E = 4 x 4 minors."""
    signs = np.zeros((10, 10, 5))
    for first, second in permutations(range(10), 2):
        rows = _PAIRS[first] + _PAIRS[second]
        if len(set(rows)) == 4:
            left_out = (set(range(5)) - set(rows)).pop()
            inversions = sum(x > y for x, y in combinations(rows, 2))
            signs[first, second, left_out] = (-1.0) ** inversions
    return signs.reshape(100, 5)


_WEDGE = _wedge_signs()
_LAPLACE = _laplace_signs()
