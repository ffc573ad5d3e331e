# SPDX-License-Identifier: Apache-2.0
"""The parts of lines that are worth drawing."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array


def segments_in_ball(points: Array, directions: Array, center: Array, radius: float) -> Array:
    """Return the chords that lines cut out of a ball.

    Args:
        points: A point on each line, shape (n, 3) [m].
        directions: Unit directions, shape (n, 3).
        center: Centre of the ball, shape (3,) [m].
        radius: Its radius [m].

    Returns:
        End points, shape (k, 2, 3) [m]; lines that miss the ball are left out.
    """
    along = np.einsum("ij,ij->i", center - points, directions)
    middle = points + along[:, np.newaxis] * directions
    square = radius**2 - np.einsum("ij,ij->i", middle - center, middle - center)
    hit = square > 0.0
    half = np.sqrt(square[hit])[:, np.newaxis] * directions[hit]
    return np.stack([middle[hit] - half, middle[hit] + half], axis=1)
