"""Coordinates centred on the lines of a scene, in units of their mean distance: see scene_frame.c."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array

_IDENTITY = np.eye(3)
# Singular values below this share of the largest leave the centre free: parallel lines, along them.
_FREE = 1e-12


@np.errstate(invalid="ignore", over="ignore")
def scene_coordinates(
    direction: Array, foot: Array, center: Array, length: Array, relative: Array, share: float, smallest: float
) -> bool:
    """Fill centres, lengths and closest points of the scene frames of S scenes of n lines; return whether all finite.

    Args:
        direction: Unit directions, shape (S, n, 3).
        foot: A point on each line, shape (S, n, 3) [m].
        center: Filled, shape (S, 3) [m]: the points with the smallest sum of squared distances to the lines. Where
            parallel lines leave it free along them, the one nearest to the mean of the feet.
        length: Filled, shape (S,) [m]: the mean distance of the lines to it; 0 for concurrent lines.
        relative: Filled, the point of each line closest to the centre, from there and in that unit, shape (S, n, 3);
            in metres for concurrent lines.
        share: Of the centre's distance to the origin, up to which a mean distance is that of concurrent lines,
        smallest: and the same for centres near the origin [m].
    """
    n = direction.shape[1]
    mean = (foot / n).sum(axis=1, keepdims=True)
    offset = _across(foot - mean, direction)
    # The sum of the projections across the lines.
    total = n * _IDENTITY - direction.swapaxes(1, 2) @ direction
    if not (np.isfinite(total).all() and np.isfinite(offset).all()):
        return False
    inverse = np.linalg.pinv(total, rcond=_FREE, hermitian=True)
    to_center = (inverse @ offset.sum(axis=1)[:, :, np.newaxis]).swapaxes(1, 2)
    # Relative to the mean, so that a scene far from the origin loses no digits here; twice, because the first leaves
    # rounding along the line.
    relative[:] = _across(_across(offset - to_center, direction), direction)
    center[:] = (mean + to_center)[:, 0]
    length[:] = np.linalg.norm(relative, axis=2).sum(axis=1) / n
    if not np.isfinite(length).all():
        return False
    concurrent = length <= np.maximum(share * np.linalg.norm(center, axis=1), smallest)
    relative /= np.where(concurrent, 1.0, length)[:, np.newaxis, np.newaxis]
    length[concurrent] = 0.0
    return True


def _across(vectors: Array, direction: Array) -> Array:
    """Return the components across unit directions, all of shape (S, n, 3)."""
    across: Array = vectors - np.einsum("sni,sni->sn", vectors, direction)[..., np.newaxis] * direction
    return across
