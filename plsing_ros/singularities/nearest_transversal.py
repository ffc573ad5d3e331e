# SPDX-License-Identifier: Apache-2.0
"""The straight line that comes nearest to meeting all n observed lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.transversals import TOLERANCE, places_along, transversals_of_pencil

# The quadratic form t . _KLEIN t / 2 = d . m of t = (d, m).
_KLEIN = np.eye(6)[[3, 4, 5, 0, 1, 2]]


@dataclass(frozen=True, eq=False)
class NearestTransversal:
    """The finite line that comes nearest to meeting all observed lines.

    Attributes:
        point: Its point closest to the scene's centre, in the frame of the lines, shape (3,) [m].
        direction: Unit direction, shape (3,).
        residual: The largest of the independent residuals (singularity_residuals) at two of its points.
        miss: How far it passes from each observed line, shape (n,) [m].
    """

    point: Array
    direction: Array
    residual: float
    miss: Array


def nearest_transversal(frame: SceneFrame) -> NearestTransversal:
    """Return the line that comes nearest to meeting all observed lines, whether or not one meets them all.

    It minimises the sum of squares of l_i . d + u_i . m over unit directions d and moments m with d . m = 0: of the
    distances to the observed lines, each times the sine of the angle with it.

    Args:
        frame: The scene.

    Source: new, docs/theory.md section "The nearest transversal".
    """
    rows = frame.plucker_matrix
    _, _, right = np.linalg.svd(rows)
    starts = [*transversals_of_pencil(right[-2:]).lines, *right[::-1]]
    line = min((_descended(rows, start) for start in starts), key=lambda t: float(np.linalg.norm(rows @ t)))
    direction = line[:3]
    foot = cross(direction, line[3:])
    crossing = cross(direction, frame.direction)
    sine = np.linalg.norm(crossing, axis=1)
    parallel = sine <= TOLERANCE
    apart = np.linalg.norm(cross(frame.point - foot, direction), axis=1)
    miss = np.where(parallel, apart, np.abs(rows @ line) / np.where(parallel, 1.0, sine))
    places = places_along(foot[np.newaxis], direction[np.newaxis])
    residual = float(singularity_residuals(frame.point, frame.direction, places).max())
    return NearestTransversal(frame.from_scene(foot), direction, residual, miss * frame.length)


def _descended(rows: Array, start: Array) -> Array:
    """Return the local minimum of |rows @ t| over finite lines t = (d, m), |d| = 1, from a start.

    Newton's method on the Lagrangian, with the absolute values of the curvatures so that every step goes down. Without
    the curvature of the constraints it would creep where no line comes near to meeting all observed ones.
    """
    line = _as_line(start)
    value = float(np.linalg.norm(rows @ line))
    square = rows.T @ rows
    for _ in range(50):
        d, m = line[:3], line[3:]
        constraints = np.array([[*d, 0.0, 0.0, 0.0], [*m, *d]])
        slope = rows.T @ (rows @ line)
        of_length, of_product = np.linalg.lstsq(constraints.T, slope, rcond=None)[0]
        hessian = square - of_product * _KLEIN
        hessian[:3, :3] -= of_length * np.eye(3)
        tangent = np.linalg.svd(constraints)[2][2:].T
        curvature, way = np.linalg.eigh(tangent.T @ hessian @ tangent)
        way = tangent @ way
        size = np.abs(curvature)
        step = -way @ ((way.T @ slope) / np.maximum(size, 1e-12 * max(float(size.max()), 1e-300)))
        scale = 1.0
        while scale > 1e-4:
            trial = _as_line(line + scale * step)
            smaller = float(np.linalg.norm(rows @ trial))
            if smaller < value:
                break
            scale *= 0.5
        else:
            return line
        finished = value - smaller <= 1e-15 * (1.0 + value)
        line, value = trial, smaller
        if finished:
            break
    return line


def _as_line(vector: Array) -> Array:
    """Return the line (d, m), |d| = 1, d . m = 0, near a vector."""
    d, m = vector[:3], vector[3:]
    length = float(np.linalg.norm(d))
    if length <= TOLERANCE:
        d, length = np.array([0.0, 0.0, 1.0]), 1.0
    d, m = d / length, m / length
    return np.concatenate([d, m - (m @ d) * d])
