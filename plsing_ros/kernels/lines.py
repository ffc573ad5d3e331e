"""What lines, image lines and rotations must be, checked over all of them at once: see lines.c."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array


def are_lines(direction: Array, moment: Array, tolerance: float) -> bool:
    """Return whether all rows are finite, directions of unit length, and moments orthogonal to them.

    Args:
        direction: Shape (n, 3).
        moment: Shape (n, 3) [m].
        tolerance: Of the squared length, and of the product relative to 1 m plus the moment's largest element.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        unit_error = np.abs(np.einsum("ij,ij->i", direction, direction) - 1.0)
        skewness = np.abs(np.einsum("ij,ij->i", direction, moment))
        allowed = tolerance * (1.0 + np.abs(moment).max(axis=1))
        return bool(np.isfinite(moment).all() and ((unit_error <= tolerance) & (skewness <= allowed)).all())


def are_image_lines(image_lines: Array, tolerance: float) -> bool:
    """Return whether all rows (n, 3) are finite with l'_x^2 + l'_y^2 = 1, whose root may be off by the tolerance."""
    length = np.hypot(image_lines[:, 0], image_lines[:, 1])
    return bool((np.abs(length - 1.0) <= tolerance).all() and np.isfinite(image_lines[:, 2]).all())


def have_images(moment: Array, least_depth: float) -> bool:
    """Return whether all lines of these moments in the camera frame, shape (n, 3) [m], have an image.

    A line has none if |(l_x, l_y)| is below least_depth times the larger of 1 m and the moment's largest element, or if
    that or l_z is not finite.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        depth = np.hypot(moment[:, 0], moment[:, 1])
        clear = depth >= least_depth * np.maximum(1.0, np.abs(moment).max(axis=1))
    return bool((clear & np.isfinite(depth) & np.isfinite(moment[:, 2])).all())


def is_rotation(rotation: Array, tolerance: float) -> bool:
    """Return whether a matrix (3, 3) is a rotation, its product with its transpose being off by up to the tolerance."""
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(rotation @ rotation.T - np.eye(3))
    return bool((error <= tolerance).all() and np.linalg.det(rotation) > 0.0)
