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
    xi: Array = rank_bases(lines.direction, lines.point, center[np.newaxis], normalized)[0]
    return xi


def rank_bases(direction: Array, point: Array, centers: Array, normalized: bool = False, on_line: float = 0.0) -> Array:
    """Return rank_basis of n lines at k camera centres, shape (k, 2n, 6), without its checks.

    Args:
        direction: Unit directions, shape (n, 3).
        point: A point on each line, shape (n, 3).
        centers: Shape (k, 3).
        normalized: As for rank_basis.
        on_line: The rows of a line that is no farther from the centre are zero then.
    """
    f = cross(direction, point - centers[:, np.newaxis])
    square = (f * f).sum(axis=2, keepdims=True)
    rows = np.zeros((*f.shape[:2], 2, 6))
    rows[:, :, 0, :3] = f
    # With M_i closest to C: CM_i x f_i = |f_i|^2 u_i.
    rows[:, :, 0, 3:] = square * direction
    rows[:, :, 1, 3:] = cross(direction, f)
    if normalized:
        distance = np.sqrt(square)
        size = np.stack([distance * np.sqrt(1.0 + square), distance], axis=2)
        rows = np.divide(rows, size, out=np.zeros_like(rows), where=size > on_line)
    xi: Array = rows.reshape(len(centers), -1, 6)
    return xi
