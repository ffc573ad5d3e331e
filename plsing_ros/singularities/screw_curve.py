# SPDX-License-Identifier: Apache-2.0
"""A curve of singular centres along which the axis of the unobservable screw turns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, cross, vector_text
from plsing_ros.singularities.bilinear_system import bilinear_tensor
from plsing_ros.singularities.loci import Kind
from plsing_ros.singularities.moving_screws import centers_of_axes
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.ternary_forms import basis_values, multiplication_maps

# Lines through a point of the plane of axes that the curve is cut with, and two such points, each with two axes across:
# what is along the lines of one is across those of the other.
_TURNS = 180
_CASTS = tuple(np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0] for seed in (43, 44))
# Angles between axes up to which neighbours belong together, and chords, over one plus the distance from the scene's
# centre, above which a piece goes through infinity.
_TOGETHER, _THROUGH_INFINITY = 0.3, 0.6
# Such chords that are halved up to one, and up to another distance from the centre; nothing is farther than that.
_FINE, _NEAR, _COARSE, _FAR = 0.03, 30.0, 0.1, 1e4
_HALVINGS = 12
_SINGULAR = 1e-8


@dataclass(frozen=True, eq=False)
class ScrewCurve:
    """The centres C(w) of the real points of a plane curve F(w) = 0 of axis directions.

    C(w) is where P w . (M - C) = 0 for all lines (moving_screws.centers_of_axes).

    Attributes:
        name: As in SingularSet.locus_names.
        frame: The scene.
        form: F, in the basis of ternary_forms, shape (3,), (6,), (10,) or (15,).
    """

    name: str
    frame: SceneFrame
    form: Array

    @property
    def kind(self) -> Kind:
        """Kind.CURVE."""
        return Kind.CURVE

    @property
    def degree(self) -> int:
        """Degree of F."""
        return round(math.sqrt(2.0 * len(self.form) + 0.25) - 1.5)

    @property
    def exists(self) -> bool:
        """Whether it has real points."""
        return any(len(self._singular_pieces(self._joined(self._cut(cast)))) > 0 for cast in _CASTS)

    def contains(self, center: Array, reach: float) -> bool:
        """Return whether a singular centre (3,), scene coordinates, is the C(w) of its own axis up to a distance."""
        tensor = bilinear_tensor(self.frame.direction[np.newaxis], self.frame.point[np.newaxis])[0]
        motion = np.linalg.svd(np.tensordot(np.array([1.0, *center]), tensor, axes=1))[2][-1]
        axis = motion[np.newaxis, 3:] / max(float(np.linalg.norm(motion[3:])), 1e-300)
        place, unique = centers_of_axes(self.frame, axis)
        off = abs(float(self._values(axis)[0]))
        return bool(unique[0] and off <= reach and np.linalg.norm(place[0] - center) <= reach)

    def __str__(self) -> str:
        place = self.closest_point(self.frame.center)
        return (
            f"{self.name}: through {vector_text(place)} m, axes of its screws on a plane curve of degree {self.degree}"
        )

    def closest_point(self, center: npt.ArrayLike) -> Array:
        """Return the point of the curve closest to a camera centre (3,), in the frame of the lines, shape (3,) [m]."""
        given = self.frame.to_scene(np.asarray(center, dtype=float))
        axes, centers = self._vertices
        square = ((centers - given) ** 2).sum(axis=1)
        best = int(square.argmin())
        axis, place, least = axes[best], centers[best], float(square[best])
        step = 1.0
        # Gauss and Newton's method along the curve, shortened where it does not come nearer.
        for _ in range(30):
            way = cross(axis, self._gradients(axis[np.newaxis])[0])
            way /= max(float(np.linalg.norm(way)), 1e-300)
            slope = self._velocity(axis, way, place)
            turn = float((given - place) @ slope) / max(float(slope @ slope), 1e-300)
            tried = self._on_curve((axis + step * np.clip(turn, -0.1, 0.1) * way)[np.newaxis])
            moved = centers_of_axes(self.frame, tried)[0][0]
            distance = float(((moved - given) ** 2).sum())
            if distance > least:
                step *= 0.5
                if step < 1e-3:
                    break
                continue
            finished = least - distance <= 1e-15 * least or abs(turn) <= 1e-12
            axis, place, least = tried[0], moved, distance
            if finished:
                break
        return self.frame.from_scene(place)

    def segments(self, middle: Array, radius: float) -> Array:
        """Return short segments along the part of the curve in a ball, shape (k, 2, 3) [m], for drawing."""
        pieces = self.frame.from_scene(self._pieces)
        inside = (np.linalg.norm(pieces - middle, axis=2) <= radius).all(axis=1)
        drawn: Array = pieces[inside]
        return drawn

    def polyline(self, middle: Array, radius: float) -> Array:
        """Return points along the part of the curve in a ball, shape (k, 3) [m]; NaN between two pieces."""
        pieces = self.segments(middle, radius)
        apart = np.full((len(pieces), 1, 3), np.nan)
        points: Array = np.concatenate([pieces, apart], axis=1).reshape(-1, 3)
        return points

    @cached_property
    def _maps(self) -> Array:
        return multiplication_maps(self.degree)

    def _values(self, axes: Array) -> Array:
        values: Array = basis_values(self.degree, axes) @ self.form
        return values

    def _gradients(self, axes: Array) -> Array:
        """Return dF/dw at unit vectors (k, 3), across them."""
        # The contraction of F, a symmetric tensor, with each unit vector.
        slopes: Array = self.degree * basis_values(self.degree - 1, axes) @ (self._maps @ self.form).T
        across: Array = slopes - (slopes * axes).sum(axis=1, keepdims=True) * axes
        return across

    def _on_curve(self, axes: Array) -> Array:
        """Return the unit vectors with F = 0 near vectors (k, 3), by Newton's method."""
        # Where the curve turns sharply, three steps do not reach it.
        for _ in range(5):
            axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
            slopes = self._gradients(axes)
            square = np.maximum((slopes * slopes).sum(axis=1), 1e-300)
            axes = axes - (self._values(axes) / square)[:, np.newaxis] * slopes
        unit: Array = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        return unit

    def _velocity(self, axis: Array, way: Array, place: Array) -> Array:
        """Return dC as the axis turns along `way`."""
        direction = self.frame.direction
        across = axis - (direction @ axis)[:, np.newaxis] * direction
        change = way - (direction @ way)[:, np.newaxis] * direction
        return np.asarray(np.linalg.lstsq(across, (change * (self.frame.point - place)).sum(axis=1), rcond=None)[0])

    @cached_property
    def _vertices(self) -> tuple[Array, Array]:
        """Axes and centres of all ends of pieces, (k, 3) each."""
        return self._ends.reshape(-1, 3), self._centers(self._ends).reshape(-1, 3)

    @cached_property
    def _pieces(self) -> Array:
        """Centres at the ends of short pieces that do not go through infinity, scene coordinates, shape (k, 2, 3)."""
        size, chord = self._sizes(self._ends)
        return self._centers(self._ends[chord <= _THROUGH_INFINITY * size])

    def _singular_pieces(self, pairs: Array) -> Array:
        """Return the axes at the ends of pieces (k, 2, 3) that are singular at both."""
        centers, unique = centers_of_axes(self.frame, pairs.reshape(-1, 3))
        residual = singularity_residuals(self.frame.point, self.frame.direction, centers)
        kept: Array = pairs[(unique & (residual <= _SINGULAR)).reshape(-1, 2).all(axis=1)]
        return kept

    @cached_property
    def _ends(self) -> Array:
        """Axes at the ends of short pieces of the curve, shape (k, 2, 3)."""
        pairs = np.concatenate([self._joined(self._cut(cast)) for cast in _CASTS])
        for _ in range(_HALVINGS):
            size, chord = self._sizes(pairs)
            long = (chord > np.where(size < _NEAR, _FINE, _COARSE) * size) & (size < _FAR)
            middle = self._on_curve(pairs[long].sum(axis=1))
            halves = [np.stack([pairs[long, 0], middle], axis=1), np.stack([middle, pairs[long, 1]], axis=1)]
            pairs = np.concatenate([pairs[~long], *halves])
        # Neighbours that do not belong together leave places off the curve between them.
        return self._singular_pieces(pairs)

    def _sizes(self, pairs: Array) -> tuple[Array, Array]:
        """Return one plus the distance from the scene's centre, and the chord, of pieces (k, 2, 3), (k,) each."""
        centers = self._centers(pairs)
        size = 1.0 + np.linalg.norm(centers, axis=2).min(axis=1)
        return size, np.linalg.norm(centers[:, 1] - centers[:, 0], axis=1)

    def _centers(self, pairs: Array) -> Array:
        centers: Array = centers_of_axes(self.frame, pairs.reshape(-1, 3))[0].reshape(-1, 2, 3)
        return centers

    def _cut(self, cast: Array) -> list[Array]:
        """Return the axes on each of the lines through the first of three orthonormal axes, shape (k, 3) each."""
        angle = np.pi * np.arange(_TURNS) / _TURNS
        across = np.cos(angle)[:, np.newaxis] * cast[1] + np.sin(angle)[:, np.newaxis] * cast[2]
        places = np.cos(np.pi * (np.arange(self.degree + 1) + 0.5) / (self.degree + 1))
        points = places[:, np.newaxis] * cast[0] + across[:, np.newaxis]
        values = self._values(points.reshape(-1, 3)).reshape(_TURNS, -1)
        coefficients = np.linalg.solve(np.vander(places), values.T).T
        # The eigenvalues of companion matrices; the curve is in no special position to the point.
        companion = np.zeros((_TURNS, self.degree, self.degree))
        companion[:, np.arange(1, self.degree), np.arange(self.degree - 1)] = 1.0
        companion[:, 0] = -coefficients[:, 1:] / coefficients[:, :1]
        found = []
        for way, roots in zip(across, np.linalg.eigvals(companion), strict=True):
            real = roots.real[np.abs(roots.imag) <= 1e-7 * (1.0 + np.abs(roots))]
            on = real[:, np.newaxis] * cast[0] + way
            found.append(on / np.linalg.norm(on, axis=1, keepdims=True))
        return found

    def _joined(self, cut: list[Array]) -> Array:
        """Return neighbouring axes with like signs, shape (k, 2, 3)."""
        pairs: list[tuple[Array, Array]] = []
        left = [set(range(len(row))) for row in cut]
        for i, row in enumerate(cut):
            other = cut[(i + 1) % len(cut)]
            product = row @ other.T
            used: set[int] = set()
            for a in range(len(row)):
                for b in np.argsort(-np.abs(product[a])).tolist():
                    if b not in used and abs(product[a, b]) >= np.cos(_TOGETHER):
                        pairs.append((row[a], np.sign(product[a, b]) * other[b]))
                        used.add(b)
                        left[i].discard(a)
                        break
            # Where two of one line are about to meet, they join.
            over = [a for a in range(len(row)) if a in left[i]]
            new = [b for b in range(len(other)) if b not in used]
            for rows, axes in ((over, row), (new, other)):
                for a, b in zip(rows[::2], rows[1::2], strict=False):
                    if abs(axes[a] @ axes[b]) >= np.cos(_TOGETHER):
                        pairs.append((axes[a], np.sign(axes[a] @ axes[b]) * axes[b]))
        return np.array(pairs).reshape(-1, 2, 3)
