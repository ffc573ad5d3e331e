# SPDX-License-Identifier: Apache-2.0
"""The rank basis xi: the rows that decide whether the interaction matrix is singular, orientation-free."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, cross
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.pose import checked_center


def rank_basis(lines: LineSet, pose_or_center: Pose | npt.ArrayLike, normalized: bool = False) -> Array:
    """Return xi, whose rank is that of the interaction matrix for any camera orientation.

    Args:
        lines: n lines in some frame.
        pose_or_center: Camera centre C in the same frame, shape (3,) [m], or the camera's pose in it.
        normalized: Scale every row to unit length; a zero row (C on the line) stays zero.

    Returns:
        Shape (2n, 6), rows [f_i, CM_i x f_i] and [0, m_i] of line i next to each other, where M_i is the point of
        line i closest to C, f_i = u_i x CM_i and m_i = u_i x f_i. xi @ (v, omega) = 0 for the twists, in the frame of
        the lines and about C, that move no image line.

    Raises:
        GeometryError: If the centre is not three finite numbers, or beyond 1e50 m.

    Source: eq. basiseta and eq. fandmdirections with Q = C.
    """
    center = checked_center("pose_or_center", pose_or_center)
    direction = lines.direction
    # The moment about C is CM x u = -f.
    f = cross(center, direction) - lines.moment
    m = cross(direction, f)
    rows = np.zeros((len(lines), 2, 6))
    rows[:, 0, :3] = f
    # With M_i closest to C: CM_i = f x u = -m.
    rows[:, 0, 3:] = cross(f, m)
    rows[:, 1, 3:] = m
    xi: Array = rows.reshape(-1, 6)
    if normalized:
        length = np.linalg.norm(xi, axis=1, keepdims=True)
        xi = np.divide(xi, length, out=np.zeros_like(xi), where=length > 0.0)
    return xi
