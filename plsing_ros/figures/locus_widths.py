# SPDX-License-Identifier: Apache-2.0
"""How wide the trouble beside a locus is, as triangles: tubes about lines and curves, balls, shells beside surfaces."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.singularities import Locus, Surface

_SIDES, _RINGS = 12, 7


def width_triangles(locus: Locus, middle: Array, radius: float, surface_radius: float) -> Array:
    """Return triangles round the centres within the half width of a locus, shape (k, 3, 3) [m].

    Args:
        locus: A part of a singular set.
        middle: Of the ball in which it is drawn, shape (3,) [m].
        radius: Of that ball for points, lines and curves [m].
        surface_radius: Likewise for surfaces [m].
    """
    width = locus.half_width
    if not 0.0 < width < radius:
        return np.zeros((0, 3, 3))
    if isinstance(locus.part, Surface):
        triangles = locus.mesh(middle, surface_radius)
        if not len(triangles):
            return triangles
        gradient = locus.part.gradient(triangles.reshape(-1, 3))
        size = np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-300)
        shift = (width * gradient / size).reshape(triangles.shape)
        return np.concatenate([triangles + shift, triangles - shift])
    points = locus.polyline(middle, radius)
    if len(points) == 1:
        return _ball(points[0], width)
    tubes = [
        _tube(points[i], points[i + 1], width)
        for i in range(len(points) - 1)
        if np.isfinite(points[i : i + 2]).all() and (points[i] != points[i + 1]).any()
    ]
    return np.concatenate(tubes) if tubes else np.zeros((0, 3, 3))


def _tube(first: Array, second: Array, width: float) -> Array:
    along = (second - first) / np.linalg.norm(second - first)
    across = cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    angle = 2.0 * np.pi * np.arange(_SIDES + 1) / _SIDES
    ring = width * (np.cos(angle)[:, np.newaxis] * across + np.sin(angle)[:, np.newaxis] * cross(along, across))
    a, b, c, d = first + ring[:-1], first + ring[1:], second + ring[:-1], second + ring[1:]
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])


def _ball(center: Array, width: float) -> Array:
    height, turn = np.meshgrid(
        np.linspace(-0.5 * np.pi, 0.5 * np.pi, _RINGS), np.linspace(0.0, 2.0 * np.pi, _SIDES + 1), indexing="ij"
    )
    grid = center + width * np.stack(
        [np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)], axis=-1
    )
    a, b, c, d = (grid[i : i - 1 or None, j : j - 1 or None].reshape(-1, 3) for i in (0, 1) for j in (0, 1))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
