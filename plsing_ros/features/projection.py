# SPDX-License-Identifier: Apache-2.0
"""Image lines: the projection l' of 3-D lines."""

from __future__ import annotations

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array, BoolArray
from plsing_ros.errors import DegenerateProjectionError
from plsing_ros.geometry import LineSet

# A line whose |(l_x, l_y)| is below this times the larger of 1 m and the largest component of l has no usable image:
# rounding of coordinates of that size already moves it by a visible part.
DEGENERATE_DEPTH = 1e-9


def image_depth(lines_camera: LineSet) -> Array:
    """Return delta = sqrt(l_x^2 + l_y^2) of each line, shape (n,) [m].

    Args:
        lines_camera: n lines in the camera's optical frame.

    Source: the depth factor of eq. plucker2dline.
    """
    return np.hypot(lines_camera.moment[:, 0], lines_camera.moment[:, 1])


def degenerate_projections(lines_camera: LineSet) -> BoolArray:
    """Return which lines have no image line, shape (n,): they meet the camera centre or lie in the plane z = 0."""
    size = np.maximum(1.0, np.abs(lines_camera.moment).max(axis=1))
    degenerate: BoolArray = image_depth(lines_camera) < DEGENERATE_DEPTH * size
    return degenerate


def project_lines(lines_camera: LineSet) -> Array:
    """Return the stacked image lines s.

    Args:
        lines_camera: n lines in the camera's optical frame.

    Returns:
        l'_1, ..., l'_n stacked, shape (3n,), no unit; each with l'_x^2 + l'_y^2 = 1.

    Raises:
        DegenerateProjectionError: If a line meets the camera centre or lies in z = 0.

    Source: eq. plucker2dline.
    """
    if not have_images(lines_camera):
        refuse_degenerate(lines_camera)
    return (lines_camera.moment / image_depth(lines_camera)[:, np.newaxis]).ravel()


def have_images(lines_camera: LineSet) -> bool:
    """Return whether none of the lines is degenerate; much faster than to ask for each."""
    return _core.have_images(lines_camera.moment, DEGENERATE_DEPTH)


def refuse_degenerate(lines_camera: LineSet) -> None:
    """Raise the DegenerateProjectionError that names the lines without an image, if there are any."""
    degenerate = degenerate_projections(lines_camera)
    if degenerate.any():
        ids = tuple(lines_camera.ids[row] for row in np.flatnonzero(degenerate))
        raise DegenerateProjectionError(
            f"no image of line{'s' if len(ids) > 1 else ''} {', '.join(map(str, ids))}: through the camera centre or "
            "in its focal plane z = 0; move the camera or leave the line out",
            ids,
        )
