# SPDX-License-Identifier: Apache-2.0
"""The independent check: how far from rank-deficient the image velocities are at a camera centre."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros import _core
from plsing_ros.arrays import Array

# Share of the mean distance below which the distance of a centre to a line is rounding: the centre is on that line.
_ON_LINE = 1e-12

# No camera centres at all.
NO_PLACES = np.zeros((0, 3))


def singularity_residuals(point: Array, direction: Array, centers: npt.NDArray[Any]) -> Array:
    """Return the smallest over the largest singular value of the row-normalised xi at camera centres.

    Lengths are measured in the root mean square distance from the centre to the lines, so that the result has no
    unit and does not become small just because the centre is far away. The rows of a line that the centre is on are
    zero.

    Args:
        point: A point on each line, shape (n, 3).
        direction: Unit directions, shape (n, 3).
        centers: Camera centres in the frame and unit of point, real or complex, shape (k, 3).

    Returns:
        Shape (k,), in [0, 1]: 0 at a singularity, 1 for a centre that is not finite.

    Source: eq. basiseta with Q = C and the point of each line closest to C, for which CM x f = |f|^2 u.
    """
    return residuals_and_distances(point[np.newaxis], direction[np.newaxis], centers)[0]


def residuals_and_distances(point: Array, direction: Array, centers: npt.NDArray[Any]) -> tuple[Array, Array]:
    """Return singularity_residuals of centres (k, 3), and the distances of the nearest lines in their unit, (k,) each.

    Lines (k, n, 3) if each centre has its own, else (1, n, 3).
    """
    if point.shape[1] < 3:
        return np.zeros(len(centers)), np.ones(len(centers))
    return _core.singularity_ratios(direction, point, np.ascontiguousarray(centers, dtype=complex), _ON_LINE)
