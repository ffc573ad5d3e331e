# SPDX-License-Identifier: Apache-2.0
"""The straight lines and curves in a singular set that do not meet all lines: conics, and curves known by points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, cross, vector_text
from plsing_ros.singularities.loci import Kind
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.screw_axes import FlatSet

# Relative difference of the axes of an ellipse up to which it is a circle.
_ROUND = 1e-9


@dataclass(frozen=True, eq=False)
class Curve:
    """A straight line or a conic.

    Attributes:
        kind: Kind.STRAIGHT_LINE or Kind.CONIC.
        name: As in SingularSet.locus_names.
        frame: The scene the coordinates of flat belong to.
        flat: Its points, in scene coordinates.
    """

    kind: Kind
    name: str
    frame: SceneFrame
    flat: FlatSet

    def __str__(self) -> str:
        where = f"through {vector_text(self.point)} m"
        if self.kind is Kind.STRAIGHT_LINE:
            return f"{self.name}: {where} along {vector_text(self.axes[0])}"
        first, second = self.axes
        if self.name.startswith("circle"):
            square = self.conic[1, 1]
            middle = -self.conic[1:, 0] / square
            radius = np.sqrt(max(middle @ middle - self.conic[0, 0] / square, 0.0))
            center, normal = self.point + middle @ self.axes, cross(first, second)
            return f"{self.name}: centre {vector_text(center)} m, radius {radius:.6g} m, across {vector_text(normal)}"
        return f"{self.name}: in the plane {where} spanned by {vector_text(first)} and {vector_text(second)}"

    @property
    def point(self) -> Array:
        """A point of a straight line, or a point of a conic's plane, in the frame of the lines, shape (3,) [m]."""
        return self.frame.from_scene(self.flat.origin)

    @property
    def axes(self) -> Array:
        """Orthonormal directions of a straight line, shape (1, 3), or of a conic's plane, shape (2, 3)."""
        return self.flat.axes

    @cached_property
    def conic(self) -> Array:
        """Symmetric Q of the equation (1, z) Q (1, z) = 0 of C = point + axes^T z, z in metres, shape (3, 3)."""
        scale = np.array([1.0, *[1.0 / self.frame.length] * len(self.axes)])
        return self.flat.quadric * np.outer(scale, scale)

    def closest_point(self, center: npt.ArrayLike) -> Array:
        """Return the point of the curve closest to a camera centre (3,), in the frame of the lines, shape (3,) [m]."""
        flat = self.flat
        place = flat.axes @ (self.frame.to_scene(np.asarray(center, dtype=float)) - flat.origin)
        if self.kind is Kind.CONIC:
            place = _closest_on_conic(flat.quadric, place)
        return self.frame.from_scene(flat.origin + place @ flat.axes)

    def segments(self, middle: Array, radius: float) -> Array:
        """Return short segments along the part of the curve in a ball, shape (k, 2, 3) [m]."""
        points = self.polyline(middle, radius)
        pairs = np.stack([points[:-1], points[1:]], axis=1)
        whole: Array = pairs[np.isfinite(pairs).all(axis=(1, 2))]
        return whole

    def polyline(self, middle: Array, radius: float, count: int = 96) -> Array:
        """Return points along the part of the curve in a ball, shape (k, 3) [m]; NaN between two branches."""
        flat = self.flat
        if self.kind is Kind.STRAIGHT_LINE:
            offset = self.frame.to_scene(middle) - flat.origin
            along = flat.axes @ offset
            square = (radius / self.frame.length) ** 2 - float(offset @ offset - along @ along)
            half = np.sqrt(square) if square > 0.0 else np.nan
            places = along + half * np.array([[-1.0], [1.0]])
        else:
            places = _along_conic(flat.quadric, count)
        points = self.frame.from_scene(flat.origin + places @ flat.axes)
        outside = ~(np.linalg.norm(points - middle, axis=1) <= radius * (1.0 + 1e-9))
        kept: Array = np.where(outside[:, np.newaxis], np.nan, points)
        return kept


def conic_name(quadric: Array) -> str:
    """Return what a conic (1, z) Q (1, z) = 0 with real points is, for Q of shape (3, 3)."""
    first, second = np.linalg.eigvalsh(quadric[1:, 1:])
    largest = max(abs(first), abs(second))
    if abs(first - second) <= _ROUND * largest:
        return "circle"
    if min(abs(first), abs(second)) <= _ROUND * largest:
        return "parabola"
    return "ellipse" if first * second > 0.0 else "hyperbola"


def _closest_on_conic(quadric: Array, place: Array) -> Array:
    """Return the point of a conic that is closest to a place of its plane, shape (2,).

    A critical point of the distance is z = (I + t A)^-1 (z_0 - t b), a quartic in t.
    """
    value, vector = np.linalg.eigh(quadric[1:, 1:])
    linear, start = vector.T @ quadric[1:, 0], vector.T @ place
    if abs(value[1] - value[0]) <= _ROUND * abs(value).max():
        middle = -linear / value.mean()
        radius = np.sqrt(max(middle @ middle - quadric[0, 0] / value.mean(), 0.0))
        offset = start - middle
        length = float(np.linalg.norm(offset))
        way = offset / length if length > 0.0 else np.array([1.0, 0.0])
        return np.asarray(vector @ (middle + radius * way))
    steps = [np.array([value[i], 1.0]) for i in (0, 1)]
    moved = [np.array([-linear[i], start[i]]) for i in (0, 1)]
    total = quadric[0, 0] * np.polymul(np.polymul(steps[0], steps[0]), np.polymul(steps[1], steps[1]))
    for i, other in ((0, 1), (1, 0)):
        square = np.polymul(steps[other], steps[other])
        own = value[i] * np.polymul(moved[i], moved[i]) + 2.0 * linear[i] * np.polymul(moved[i], steps[i])
        total = np.polyadd(total, np.polymul(own, square))
    roots = np.roots(total)
    real = roots[np.abs(roots.imag) <= 1e-7 * (1.0 + np.abs(roots))].real
    with np.errstate(divide="ignore", invalid="ignore"):
        critical = (start - real[:, np.newaxis] * linear) / (1.0 + real[:, np.newaxis] * value)
    # In the middle of an ellipse the critical points are at the poles of that formula: the vertices are among these.
    candidates = np.concatenate([critical, _along_conic(quadric, 96) @ vector])
    h = np.concatenate([np.ones((len(candidates), 1)), candidates], axis=1)
    turned = np.block([[quadric[0, 0], linear], [linear[:, np.newaxis], np.diag(value)]])
    on = np.abs(np.einsum("ki,ij,kj->k", h, turned, h)) <= 1e-9 * (1.0 + (h * h).sum(axis=1))
    candidates = candidates[on]
    best = candidates[np.linalg.norm(candidates - start, axis=1).argmin()]
    return np.asarray(vector @ best)


def _along_conic(quadric: Array, count: int) -> Array:
    """Return points along a conic with real points, shape (count, 2); the branches of a hyperbola one after the other.

    A conic is the image of the circle under the linear map that makes its matrix diag(1, 1, -1).
    """
    value, vector = np.linalg.eigh(quadric)
    if (value < 0.0).sum() == 2:
        value, vector = -value[::-1], vector[:, ::-1]
    angle = np.linspace(0.0, 2.0 * np.pi, count)
    circle = np.stack([np.ones(count), np.cos(angle), np.sin(angle)], axis=1)
    h = circle / np.sqrt(np.abs(value)) @ vector.T
    with np.errstate(divide="ignore", invalid="ignore"):
        places: Array = h[:, 1:] / h[:, :1]
    return places
