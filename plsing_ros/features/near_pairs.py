# SPDX-License-Identifier: Apache-2.0
"""Two image lines that are nearly the same, each given with the other's 3-D line."""

from __future__ import annotations

import math

from plsing_ros import _core
from plsing_ros.arrays import Array

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
    return _core.exchanged_pair(image, moment, covariances, map_std, math.cos(_NEAR), _LOG_RATIO)
