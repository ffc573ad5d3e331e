"""Small rotations for many poses at once."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array

# v @ SKEW, reshaped to (3, 3), is the matrix of b -> v cross b.
SKEW: Array = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], dtype=float
)
SKEW.setflags(write=False)
_IDENTITY = np.eye(3)


def skew_matrices(vectors: Array) -> Array:
    """Return the matrices of b -> v cross b of vectors (k, 3), shape (k, 3, 3)."""
    return (vectors @ SKEW).reshape(-1, 3, 3)


def rotations_near(vectors: Array) -> Array:
    """Return rotations, shape (k, 3, 3), that agree with exp([v]x) to the second order in v (k, 3) [rad].

    Exact rotations at any length, by the Cayley transform: about v, by 2 atan(|v| / 2).
    """
    half = skew_matrices(0.5 * vectors)
    scale = 2.0 / (1.0 + 0.25 * np.einsum("ki,ki->k", vectors, vectors))
    rotation: Array = _IDENTITY + scale[:, np.newaxis, np.newaxis] * (half + half @ half)
    return rotation
