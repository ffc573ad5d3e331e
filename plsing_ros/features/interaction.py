# SPDX-License-Identifier: Apache-2.0
"""The interaction matrix L of line features: ds/dt = L tau."""

from __future__ import annotations

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.features.conditioning import Conditioning, conditioning, conditioning_of
from plsing_ros.features.decomposition import not_finite
from plsing_ros.features.projection import DEGENERATE_DEPTH, refuse_degenerate
from plsing_ros.geometry import LineSet


def interaction_matrix(lines_camera: LineSet) -> Array:
    """Return L with ds/dt = L @ twist for the image lines of fixed 3-D lines seen by a moving camera.

    Args:
        lines_camera: n lines in the camera's optical frame.

    Returns:
        Shape (3n, 6). Columns 0 to 2 multiply the camera's linear velocity [1/m], columns 3 to 5 its angular
        velocity [1/rad], both in the camera's optical frame. Rank at most 2 for each line.

    Raises:
        DegenerateProjectionError: If a line meets the camera centre or lies in z = 0.

    Source: eq. MPlucker with the opposite sign: the paper's twist is that of the lines relative to the camera, ours
    that of the camera (docs/conventions.md).
    """
    matrix = _core.interaction_matrix(lines_camera.direction, lines_camera.moment, DEGENERATE_DEPTH)
    if matrix is None:
        refuse_degenerate(lines_camera)
        raise not_finite()
    return matrix


def interaction_conditioning(lines_camera: LineSet, characteristic_length: float = 1.0) -> Conditioning:
    """Return conditioning(interaction_matrix(lines_camera), ...) in one call, with the same errors."""
    parts = _core.interaction_conditioning(lines_camera.direction, lines_camera.moment, DEGENERATE_DEPTH)
    if parts is None:
        # What is wrong is said step by step.
        return conditioning(interaction_matrix(lines_camera), characteristic_length)
    return conditioning_of(*parts, characteristic_length)
