# SPDX-License-Identifier: Apache-2.0
"""Displacements as twists over unit time: one after the other, and what is seen after one."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.rotations import exponential, rotation_vector, twist_exponential


def composed(first: Array, second: Array) -> Array:
    """Return the twist that leads straight and about one axis to where two lead, shape (6,).

    Args:
        first: Straight and about one axis, its shift in the frame that it leads to, shape (6,).
        second: Seen from where the first has led, shape (6,).
    """
    turned, moved = twist_exponential(second)
    shift = turned.T @ (first[:3] + moved)
    return np.concatenate([shift, rotation_vector(exponential(first[3:])[0] @ turned)])


def moved_lines(lines: LineSet, twist: Array) -> LineSet:
    """Return lines of the camera frame as they are seen from where a twist leads, shape (6,)."""
    return lines.transformed(Pose(*twist_exponential(twist)).inverse(), lines.frame)
