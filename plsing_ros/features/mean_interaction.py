# SPDX-License-Identifier: Apache-2.0
"""The mean of two interaction matrices of the same lines."""

from __future__ import annotations

from plsing_ros.arrays import Array


def mean_interaction(current: Array, image: Array, target: Array, target_image: Array) -> Array:
    """Return half the sum of L and L*, each taken in the polar coordinates of its own image lines, shape (3n, m).

    An image line (cos a, sin a, r) changes only along (-sin a, cos a, 0) and (0, 0, 1), so the rows of L* belong to
    other directions than those of L. Before they are added, those of L* are turned to the image lines of L: then a
    change of angle is added to a change of angle.

    Args:
        current: L, shape (3n, m).
        image: The image lines that L belongs to, shape (3n,).
        target: L*, shape (3n, m).
        target_image: The image lines that L* belongs to, shape (3n,).

    Source: the mean of ViSP, which has the features (r, a); in three coordinates new, docs/controller.md.
    """
    a, b = image.reshape(-1, 3), target_image.reshape(-1, 3)
    rows = target.reshape(len(b), 3, -1)
    turned = rows.copy()
    change_of_angle = b[:, :1] * rows[:, 1] - b[:, 1:2] * rows[:, 0]
    turned[:, 0], turned[:, 1] = -a[:, 1:2] * change_of_angle, a[:, :1] * change_of_angle
    mean: Array = 0.5 * (current + turned.reshape(target.shape))
    return mean
