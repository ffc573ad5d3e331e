# SPDX-License-Identifier: Apache-2.0
"""Two image lines that are nearly the same, each given with the other's 3-D line."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array, IntArray

# Only image lines nearer to each other are looked at: others are far off when they are exchanged [rad].
_NEAR = 0.35
# Exchanged explains the two lines so many times better (its logarithm): chance does that to one pair in 250,000.
_LOG_RATIO = 10.0


def exchanged_pair(image: Array, moment: Array, covariances: Array, map_std: float) -> tuple[int, int] | None:
    """Return the rows of two image lines that fit much better with each other's 3-D line, or None.

    What is wrong with the pose moves lines that are near each other alike. So their difference d in angle and offset is
    compared with that of their 3-D lines' images, d0: with the sum S of their covariances, exchanging them is
    exp(-2 d' S^-1 d0) times as likely. The map adds to the ends of a segment in the image what it is wrong there.

    Args:
        image: n image lines, shape (n, 3).
        moment: Of their 3-D lines in the camera frame, shape (n, 3) [m].
        covariances: Of angle and offset of each image line, shape (n, 3).
        map_std: Of a line in the map [m].

    Source: the test of two simple hypotheses of Neyman and Pearson; docs/refusals.md.
    """
    size = np.sqrt(np.einsum("ij,ij->i", moment, moment))
    normal = moment / size[:, np.newaxis]
    first, second = np.nonzero(np.triu(normal @ normal.T > math.cos(_NEAR), 1))
    if not len(first):
        return None
    depth = np.hypot(moment[:, 0], moment[:, 1])
    seen = _differences(image, first, second)
    expected = _differences(moment / depth[:, np.newaxis], first, second)
    # Of the ends of the piece that is seen, which the image has with this variance.
    variance = 2.0 * (covariances[:, 2] - np.square(covariances[:, 1]) / covariances[:, 0])
    total = covariances * (1.0 + np.square(map_std / depth) / variance)[:, np.newaxis]
    a, b, c = (total[first] + total[second]).T
    # d' S^-1 d0 for S = (a b; b c).
    (x, y), (x0, y0) = seen.T, expected.T
    product = (c * x * x0 - b * (x * y0 + y * x0) + a * y * y0) / (a * c - b * b)
    worst = int(np.argmin(product))
    return (int(first[worst]), int(second[worst])) if -2.0 * product[worst] > _LOG_RATIO else None


def _differences(lines: Array, first: IntArray, second: IntArray) -> Array:
    """Return the differences of angle and offset of pairs of image lines, shape (k, 2)."""
    (x, y, z), (x0, y0, z0) = lines[first].T, lines[second].T
    return np.stack([np.arctan2(x0 * y - y0 * x, x0 * x + y0 * y), z - z0], axis=1)
