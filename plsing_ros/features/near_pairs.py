# SPDX-License-Identifier: Apache-2.0
"""Two image lines that are nearly the same, each given with the other's 3-D line."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array

# Exchanged explains the two lines so many times better (its logarithm): chance does that to one pair in 250,000.
_LOG_RATIO = 10.0
# Whatever the covariances are, it leaves so little of the square misfit of the two, and of that of all lines: chance
# does that to one harsh frame in 200,000.
_OF_THE_PAIR, OF_ALL = 0.05, 0.1
_NONE = np.empty((0, 3))


def exchanged_pair(
    image: Array, moment: Array, covariances: Array | None, map_std: float, near: float = 0.6
) -> tuple[int, int] | None:
    """Return the rows of two image lines that fit much better with each other's 3-D line, or None.

    What is wrong with the pose moves lines that are near each other alike. So their difference d in angle and offset is
    compared with that of their 3-D lines' images, d0: with the sum S of their covariances, exchanging them is
    exp(-2 d' S^-1 d0) times as likely. The map adds to the ends of a segment in the image what it is wrong there.
    Without covariances, and beside them where the two are off by more than noise, the square misfit tells, if
    exchanging the two leaves hardly any of theirs and little of that of all lines: others show how large errors are.

    Args:
        image: n image lines, shape (n, 3).
        moment: Of their 3-D lines in the camera frame, shape (n, 3) [m].
        covariances: Of angle and offset of each image line, shape (n, 3), if they are known.
        map_std: Of a line in the map [m].
        near: Only image lines that are nearer to each other are looked at [rad].

    Source: the test of two simple hypotheses of Neyman and Pearson; docs/refusals.md.
    """
    known = _NONE if covariances is None else covariances
    return _core.exchanged_pair(image, moment, known, map_std, math.cos(near), _LOG_RATIO, _OF_THE_PAIR, OF_ALL)
