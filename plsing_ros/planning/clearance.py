# SPDX-License-Identifier: Apache-2.0
"""How far camera centres are from everything singular, for many centres at once, and how far they must be."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.singularities import Curve, Kind, SingularSet

# Share of an end's own distance to a locus that is kept there, and by how much more for each metre away from the end.
_KEPT = 0.9
_SLOPE = 0.5
# Curves are looked at up to so many times the distance of start and target, and the margin, from their middle.
_FAR = 4.0


class Clearance:
    """Distances of a path from start to target to every part of a singular set, against the distance to keep.

    The distance to keep from a part is the margin, but near the ends no more than they have themselves: 0.9 of it, and
    0.5 m more for each metre away. Parts with an end on them can be left and reached that way. Surfaces that separate
    start and target must be crossed and are left out, and all surfaces if asked for; they are `crossed`.

    Attributes:
        start: Camera centre at the start, in the frame of the lines, shape (3,) [m].
        target: At the target, likewise.
        margin: [m].
        names: Of the parts kept clear of, in the order of the columns.
        crossed: Names of the surfaces left out.
    """

    def __init__(
        self, singular: SingularSet, start: Array, target: Array, margin: float, keep_side: bool = True
    ) -> None:
        """Prepare for one task.

        Args:
            singular: The singular set.
            start: Camera centre at the start, in the frame of the lines, shape (3,) [m].
            target: At the target, likewise.
            margin: [m].
            keep_side: Whether surfaces that do not separate start and target are kept clear of.
        """
        self.start, self.target, self.margin = start, target, margin
        ends = np.array([start, target])
        signs = [np.sign(surface.value(ends)) for surface in singular.surfaces]
        kept = [
            (surface, float(first or last or 1.0))
            for surface, (first, last) in zip(singular.surfaces, signs, strict=True)
            if keep_side and first * last >= 0.0
        ]
        self.crossed = tuple(each.name for each in singular.surfaces if each not in [surface for surface, _ in kept])
        self._surfaces = kept
        point, direction = singular.lines_and_points
        straight = [each for each in singular.curves if isinstance(each, Curve) and each.kind is Kind.STRAIGHT_LINE]
        bent = [each for each in singular.curves if each not in straight]
        self._point = np.concatenate([point, *(curve.point[np.newaxis] for curve in straight)])
        self._direction = np.concatenate([direction, *(curve.axes for curve in straight)])
        middle, reach = 0.5 * (start + target), _FAR * (float(np.linalg.norm(target - start)) + margin)
        self._far, self._pieces = reach, [curve.segments(middle, reach) for curve in bent]
        self.names = singular.locus_names[: len(point)] + tuple(curve.name for curve in (*straight, *bent))
        self.names += tuple(surface.name for surface, _ in kept)
        self._at_ends = self.distances(ends)

    def distances(self, centers: Array) -> Array:
        """Return the distances of camera centres (k, 3) to each part, shape (k, parts) [m].

        To quadrics and cubics it is of first order, and negative on the side where start and target are not.
        """
        thin = np.linalg.norm(self._offsets(centers), axis=2)
        sides = [
            sign * surface.value(centers) / np.maximum(np.linalg.norm(surface.gradient(centers), axis=1), 1e-300)
            for surface, sign in self._surfaces
        ]
        bent = [np.minimum(_apart(pieces, centers), self._far) for pieces in self._pieces]
        return np.column_stack([thin, *bent, *sides])

    def to_keep(self, centers: Array) -> Array:
        """Return the distances that camera centres (k, 3) must keep from each part, shape (k, parts) [m]."""
        keep = np.full((len(centers), len(self.names)), self.margin)
        for end, distance in zip((self.start, self.target), self._at_ends, strict=True):
            away = np.linalg.norm(centers - end, axis=1)[:, np.newaxis]
            keep = np.minimum(keep, _KEPT * np.maximum(distance, 0.0) + _SLOPE * away)
        return keep

    def excess(self, centers: Array) -> Array:
        """Return by how much camera centres (k, 3) are farther from every part than they must be, shape (k,) [m]."""
        excess: Array = (self.distances(centers) - self.to_keep(centers)).min(axis=1)
        return excess

    def directions_out(self, center: Array, part: int, along: Array, count: int) -> Array:
        """Return unit vectors (count, 3), across the direction of motion `along`, that lead away from a part.

        For a line the first leads straight away from it and from the direction of motion.
        """
        axis = self._direction[part] if part < len(self._direction) else np.zeros(3)
        bent = part - len(self._direction)
        if 0 <= bent < len(self._pieces) and len(self._pieces[bent]):
            ends = self._pieces[bent]
            nearest = ends[np.linalg.norm(ends.mean(axis=1) - center, axis=1).argmin()]
            axis = nearest[1] - nearest[0]
        first = np.cross(axis, along)
        if np.linalg.norm(first) < 1e-6 * max(float(np.linalg.norm(axis)), 1e-300):
            offset = self._offsets(center[np.newaxis])[0, part] if part < len(self._direction) else np.zeros(3)
            first = offset - (offset @ along) * along
        if np.linalg.norm(first) < 1e-12:
            first = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        first /= np.linalg.norm(first)
        second = np.cross(along, first)
        angle = np.arange(count)[:, np.newaxis] * (2.0 * np.pi / count)
        vectors: Array = np.cos(angle) * first + np.sin(angle) * second
        return vectors

    def _offsets(self, centers: Array) -> Array:
        """Return the vectors from the closest points of lines and points to centres, shape (k, parts, 3) [m]."""
        offset = centers[:, np.newaxis] - self._point
        along = np.einsum("kpi,pi->kp", offset, self._direction)
        across: Array = offset - along[:, :, np.newaxis] * self._direction
        return across


def _apart(pieces: Array, centers: Array) -> Array:
    """Return the distances of centres (k, 3) from the nearest of straight pieces (m, 2, 3), shape (k,) [m]."""
    nearest = np.full(len(centers), np.inf)
    if len(pieces):
        way = pieces[:, 1] - pieces[:, 0]
        square = np.maximum((way * way).sum(axis=1), 1e-300)
        for i, center in enumerate(centers):
            offset = center - pieces[:, 0]
            share = np.clip((offset * way).sum(axis=1) / square, 0.0, 1.0)
            nearest[i] = np.sqrt(((offset - share[:, np.newaxis] * way) ** 2).sum(axis=1).min())
    return nearest
