# SPDX-License-Identifier: Apache-2.0
"""Singular camera centres by a search from random starts that shares nothing with plsing_ros.singularities."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array

# Damping of the steps, relative to the largest slope; a start that leaves this many scene lengths is given up.
_DAMPING, _FARTHEST = 1e-10, 1e3


def normalized_rows(direction: Array, point: Array, centers: Array) -> tuple[Array, Array, Array]:
    """Return the row-normalised xi, shape (k, 2n, 6), the f (k, n, 3), and the lengths of the rows, (k, 2n, 1)."""
    f = np.cross(direction, point - centers[:, np.newaxis])
    square = (f * f).sum(axis=2, keepdims=True)
    first = np.concatenate([f, square * direction], axis=2)
    second = np.concatenate([np.zeros_like(f), np.cross(direction, f)], axis=2)
    rows = np.concatenate([first, second], axis=1)
    length = np.maximum(np.linalg.norm(rows, axis=2, keepdims=True), 1e-200)
    return rows / length, f, length


def condition(direction: Array, point: Array, centers: Array) -> Array:
    """Return the smallest over the largest singular value of the row-normalised xi, in the unit given, shape (k,)."""
    values = np.linalg.svd(normalized_rows(direction, point, centers)[0], compute_uv=False)
    ratio: Array = values[:, -1] / values[:, 0]
    return ratio


def singular_centers(
    direction: Array, point: Array, starts: int, generator: np.random.Generator, steps: int = 30
) -> Array:
    """Return centres on no line at which a motion is lost, shape (k, 3), by Gauss and Newton's method from anywhere.

    Args:
        direction: Unit directions, shape (n, 3), n >= 3.
        point: A point on each line, shape (n, 3), with lengths and distances to the origin of the order of one.
        starts: Number of random starts.
        generator: Of the starts.
        steps: Steps of each start.
    """
    centers = generator.normal(size=(starts, 3)) * np.exp(generator.uniform(-1.0, 1.5, size=(starts, 1)))
    for _ in range(steps):
        rows, f, length = normalized_rows(direction, point, centers)
        left, values, right = np.linalg.svd(rows)
        motion = right[:, -1]
        slopes = []
        for axis in np.eye(3):
            df = -np.cross(direction, axis)
            first = np.concatenate([df + 0.0 * f, 2.0 * (f * df).sum(axis=2, keepdims=True) * direction], axis=2)
            second = np.concatenate([0.0 * f, np.cross(direction, df) + 0.0 * f], axis=2)
            change = np.concatenate([first, second], axis=1) / length
            change -= (change * rows).sum(axis=2, keepdims=True) * rows
            slopes.append(np.einsum("krj,kj->kr", change, motion))
        # Only what the left null vectors see: the better observed motions follow by themselves.
        slope = np.einsum("krp,kra->kpa", left[:, :, 5:], np.stack(slopes, axis=2))
        square = np.einsum("kpa,kpb->kab", slope, slope)
        damping = _DAMPING * np.trace(square, axis1=1, axis2=2) + 1e-200
        square[:, np.arange(3), np.arange(3)] += damping[:, np.newaxis]
        step = -np.linalg.solve(square, (slope[:, 0] * values[:, -1:])[:, :, np.newaxis])[:, :, 0]
        size = np.linalg.norm(step, axis=1, keepdims=True)
        longest = 0.5 * (1.0 + np.linalg.norm(centers, axis=1, keepdims=True))
        centers = centers + step * np.minimum(1.0, longest / np.maximum(size, 1e-200))
        centers = centers[np.linalg.norm(centers, axis=1) < _FARTHEST]
    f = np.cross(direction, point - centers[:, np.newaxis])
    away = np.linalg.norm(f, axis=2).min(axis=1)
    far = np.linalg.norm(centers, axis=1)
    good = (condition(direction, point, centers) < 1e-10) & (away > 1e-2 * (1.0 + far)) & (far < 50.0)
    return centers[good]
