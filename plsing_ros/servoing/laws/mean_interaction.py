"""The mean of two interaction matrices of the same lines."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array


def mean_interaction(current: Array, image: Array, desired: Array, desired_image: Array) -> Array:
    """Return half the sum of L and L*, each taken in the polar coordinates of its own image lines, shape (3n, m).

    An image line (cos a, sin a, r) changes only along (-sin a, cos a, 0) and (0, 0, 1), so the rows of L* belong to
    other directions than those of L. Before they are added, those of L* are turned to the image lines of L: then a
    change of angle is added to a change of angle.

    Args:
        current: L, shape (3n, m).
        image: The image lines that L belongs to, shape (3n,).
        desired: L*, shape (3n, m).
        desired_image: The image lines that L* belongs to, shape (3n,).

    Source: the mean of ViSP, which has the features (r, a); in three coordinates new, docs/controller.md.
    """
    across, across_desired = _across(image), _across(desired_image)
    rows = desired.reshape(len(across), 3, -1)
    turned = rows.copy()
    turned[:, :2] = across[:, :, np.newaxis] * np.einsum("ij,ijk->ik", across_desired, rows[:, :2])[:, np.newaxis]
    mean: Array = 0.5 * (current + turned.reshape(desired.shape))
    return mean


def _across(image: Array) -> Array:
    """Return (-sin a, cos a) of each image line, shape (n, 2)."""
    lines = image.reshape(-1, 3)
    return np.column_stack([-lines[:, 1], lines[:, 0]])
