# SPDX-License-Identifier: Apache-2.0
"""The surfaces in a singular set: plane, quadric and cubic, as polynomials in the camera centre."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, checked_array, cross, minus_skew, vector_text
from plsing_ros.geometry.pose import checked_position
from plsing_ros.singularities.loci import Kind
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.transversals import TransversalAnalysis, TransversalFamily

_LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _LEVI_CIVITA[_i, _j, _k] = 1.0
    _LEVI_CIVITA[_i, _k, _j] = -1.0

# Starts of the search for the nearest point, in scene lengths around the camera centre.
_START_RADII = (0.3, 1.0, 3.0)
_START_DIRECTIONS = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float
)


@dataclass(frozen=True, eq=False)
class Surface:
    """The zeros F(C) = 0 of a polynomial of degree one, two or three.

    Attributes:
        kind: Kind.PLANE, Kind.QUADRIC or Kind.CUBIC.
        name: As in SingularSet.locus_names.
        frame: The scene the coefficients belong to.
        tensor: Symmetric, shape (4, 4, 4): F = sum T_abc h_a h_b h_c for h = (1, C) in scene coordinates; its largest
            entry is 1.
    """

    kind: Kind
    name: str
    frame: SceneFrame
    tensor: Array

    def __str__(self) -> str:
        if self.kind is not Kind.PLANE:
            return f"{self.name}: degree {self.degree}"
        constant, *normal = self.coefficients / np.linalg.norm(self.coefficients[1:])
        return f"{self.name}: {vector_text(normal)} . C = {-constant:.6g} m"

    @property
    def degree(self) -> int:
        """Degree of F."""
        return {Kind.PLANE: 1, Kind.QUADRIC: 2, Kind.CUBIC: 3}[self.kind]

    @cached_property
    def exponents(self) -> tuple[tuple[int, int, int], ...]:
        """Exponents of (X, Y, Z) of each coefficient, by degree, then X before Y before Z."""
        found = []
        for degree in range(self.degree + 1):
            for factors in combinations_with_replacement(range(3), degree):
                found.append((factors.count(0), factors.count(1), factors.count(2)))
        return tuple(found)

    @cached_property
    def coefficients(self) -> Array:
        """Coefficients of F in the frame and unit of the lines, in the order of exponents: 4, 10 or 20 numbers."""
        to_scene = np.zeros((4, 4))
        to_scene[0, 0] = 1.0
        to_scene[1:, 0] = -self.frame.center / self.frame.length
        to_scene[1:, 1:] = np.eye(3) / self.frame.length
        tensor = np.einsum("abc,ai,bj,ck->ijk", self.tensor, to_scene, to_scene, to_scene)
        values = dict.fromkeys(self.exponents, 0.0)
        for index in np.ndindex(4, 4, 4):
            key = (index.count(1), index.count(2), index.count(3))
            if key in values:
                values[key] += float(tensor[index])
        return np.array([values[exponents] for exponents in self.exponents])

    def value(self, centers: npt.ArrayLike) -> Array:
        """Return F at camera centres (k, 3) [m], shape (k,)."""
        h = self._homogeneous(centers)
        value: Array = np.einsum("abc,ka,kb,kc->k", self.tensor, h, h, h)
        return value

    def gradient(self, centers: npt.ArrayLike) -> Array:
        """Return dF/dC at camera centres (k, 3) [m], shape (k, 3) [1/m]."""
        h = self._homogeneous(centers)
        gradient: Array = 3.0 * np.einsum("abc,ka,kb->kc", self.tensor, h, h)[:, 1:] / self.frame.length
        return gradient

    def first_order_closest_point(self, center: Array) -> Array:
        """Return one Newton step from center (3,) to the surface along its gradient, shape (3,) [m]."""
        h = np.empty(4)
        h[0] = 1.0
        h[1:] = self.frame.to_scene(center)
        plane = self.tensor @ h @ h
        gradient = 3.0 * plane[1:]
        square = float(gradient @ gradient)
        if square == 0.0:
            return center
        # d|F| / |grad F| of the scene coordinates, back in metres.
        step: Array = center - gradient * (float(plane @ h) / square) * self.frame.length
        return step

    def nearest_point(self, center: npt.ArrayLike) -> Array:
        """Return the point of the surface closest to a camera centre, shape (3,) [m].

        Newton's method on the Lagrange conditions C - center + lambda grad F = 0, F = 0, from several starts; the
        closest of the solutions found. For use offline: it takes a few milliseconds.

        Args:
            center: In the frame of the lines, shape (3,) [m].

        Raises:
            GeometryError: If center is not three finite numbers, or beyond 1e50 m.
        """
        given = self.frame.to_scene(checked_position("center", center))
        starts = [given, *(given + radius * way for radius in _START_RADII for way in _START_DIRECTIONS)]
        found = [point for start in starts if (point := self._lagrange_point(given, start)) is not None]
        if not found:
            return self.first_order_closest_point(np.asarray(center, dtype=float))
        return self.frame.from_scene(min(found, key=lambda point: float(np.linalg.norm(point - given))))

    def _lagrange_point(self, given: Array, start: Array) -> Array | None:
        """Return the critical point of the distance that Newton's method reaches from a start, in scene coordinates."""
        point, multiplier = start, 0.0
        for step in range(60):
            h = np.array([1.0, *point])
            plane = self.tensor @ h
            gradient = 3.0 * (plane @ h)[1:]
            value = float(h @ plane @ h)
            if step == 0:
                multiplier = value / max(float(gradient @ gradient), 1e-300)
            system = np.zeros((4, 4))
            system[:3, :3] = np.eye(3) + multiplier * 6.0 * plane[1:, 1:]
            system[:3, 3] = system[3, :3] = gradient
            right = np.array([*(point - given + multiplier * gradient), value])
            try:
                change = np.linalg.solve(system, right)
            except np.linalg.LinAlgError:
                return None
            length = float(np.linalg.norm(change[:3]))
            shorten = min(1.0, (0.2 + float(np.linalg.norm(point - given))) / length) if length > 0.0 else 1.0
            point, multiplier = point - shorten * change[:3], multiplier - shorten * float(change[3])
            if not np.isfinite(point).all():
                return None
            if length <= 1e-13 * (1.0 + float(np.linalg.norm(point))):
                return point
        return None

    def _homogeneous(self, centers: npt.ArrayLike) -> Array:
        points = self.frame.to_scene(checked_array("centers", centers, (None, 3)))
        return np.concatenate([np.ones((len(points), 1)), points], axis=1)


def three_line_quadric(frame: SceneFrame) -> Surface | None:
    """Return G(C) = det[f_1 f_2 f_3], the quadric of all lines that meet the first three lines; None if it is zero.

    Source: eq. _conditionG; for skew lines the hyperboloid of theorem 1.
    """
    # f = u x (M - C).
    forms = np.empty((3, 3, 4))
    forms[:, :, 0] = cross(frame.direction[:3], frame.point[:3])
    forms[:, :, 1:] = minus_skew(frame.direction[:3])
    return _surface(Kind.QUADRIC, "quadric", frame, forms)


def three_line_cubic(frame: SceneFrame) -> Surface | None:
    """Return H(C) = det[m_1 m_2 m_3] of the first three lines; None if it is zero.

    It is zero where the perpendiculars from C to the lines are coplanar.

    Source: eq. _conditionH; the interpretation is new, docs/theory.md section "Three lines".
    """
    # m = u x (u x (M - C)) = -P (M - C), with P the projection across u.
    across = np.eye(3) - frame.direction[:3, :, np.newaxis] * frame.direction[:3, np.newaxis, :]
    forms = np.empty((3, 3, 4))
    forms[:, :, 0] = -frame.point[:3]
    forms[:, :, 1:] = across
    return _surface(Kind.CUBIC, "cubic surface", frame, forms)


def plane_surface(frame: SceneFrame, plane: Array, name: str) -> Surface:
    """Return the plane a . x + b = 0 of (a, b) in scene coordinates, shape (4,), as a surface."""
    linear = np.array([plane[3], *plane[:3]])
    one = np.array([1.0, 0.0, 0.0, 0.0])
    return Surface(Kind.PLANE, name, frame, _normalized(_symmetric(np.einsum("a,b,c->abc", linear, one, one))))


def transversal_surfaces(frame: SceneFrame, analysis: TransversalAnalysis) -> tuple[Surface, ...]:
    """Return the surfaces filled with transversals: planes of pencils, the quadric of a regulus."""
    count = len(analysis.planes)
    names = ["plane"] if count == 1 else [f"plane {i}" for i in range(1, count + 1)]
    found = [plane_surface(frame, analysis.planes[i], name) for i, name in enumerate(names)]
    if analysis.family is TransversalFamily.REGULUS:
        # Any three lines of a regulus carry its quadric.
        quadric = three_line_quadric(frame)
        found += [quadric] if quadric is not None else []
    return tuple(found)


def _surface(kind: Kind, name: str, frame: SceneFrame, forms: Array) -> Surface | None:
    """Return the determinant of three vectors linear in (1, C), shape (3 lines, 3 components, 4)."""
    tensor = _symmetric(np.einsum("ijk,ia,jb,kc->abc", _LEVI_CIVITA, *forms))
    if np.abs(tensor).max() < 1e-12:
        return None
    return Surface(kind, name, frame, _normalized(tensor))


def _symmetric(tensor: Array) -> Array:
    axes = ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))
    total: Array = np.sum([tensor.transpose(order) for order in axes], axis=0)
    return total / 6.0


def _normalized(tensor: Array) -> Array:
    normalized: Array = tensor / tensor.ravel()[np.argmax(np.abs(tensor))]
    return normalized
