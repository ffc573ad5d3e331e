# SPDX-License-Identifier: Apache-2.0
"""The straight lines that meet all n observed lines: on them every camera loses a translation."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.singularities.lapack import right_singular_vectors
from plsing_ros.singularities.residual import NO_PLACES
from plsing_ros.singularities.scene_frame import SceneFrame

# Everything here is of order one in the scene frame; what is below this is zero. Rounded coordinates leave 1e-15, and
# 1e-12 in a scene a thousand scene lengths from the origin, so that a scene that was meant to be special is seen as it.
TOLERANCE = 1e-9


class TransversalFamily(enum.Enum):
    """How many lines meet all observed lines, over the reals."""

    NONE = "no line meets all observed lines"
    ONE = "one line meets all observed lines"
    TWO = "two lines meet all observed lines (hyperbolic congruence)"
    DOUBLE = "one line, counted twice, meets all observed lines (parabolic congruence)"
    COMPLEX_PAIR = "only two complex conjugate lines meet all observed lines (elliptic congruence)"
    PENCIL = "all lines of one plane through one of its points meet all observed lines"
    TWO_PENCILS = "the lines of two plane pencils meet all observed lines"
    REGULUS = "all lines of one regulus meet all observed lines"
    PLANE = "the observed lines are in one plane, and all lines of the plane meet them"
    EVERYWHERE = "through every point passes a line that meets all observed lines"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, eq=False)
class Transversal:
    """A straight line that meets all observed lines.

    Attributes:
        point: Its point closest to the scene's centre, in the frame of the lines, shape (3,) [m].
        direction: Unit direction; of its two signs the one whose largest component is positive (the first of
            several as large), shape (3,).
        residual: The largest of the independent residuals (singularity_residuals) at two of its points.
        name: "transversal 1", ...: the one closest to the scene's centre first.
        exactness: By how many tolerances the lines must change, root mean square over the conditions, for it to meet
            them all; 0 for exact lines.
    """

    point: Array
    direction: Array
    residual: float
    name: str
    exactness: float = 0.0


@dataclass(frozen=True, eq=False)
class TransversalAnalysis:
    """What meets all n lines, in scene coordinates.

    Attributes:
        family: How many.
        lines: Single transversals (d, m), at infinity too, shape (k, 6), unit length.
        planes: (a, b) of the planes a . x + b = 0 filled with transversals, shape (p, 4).
    """

    family: TransversalFamily
    lines: Array
    planes: Array


# Where along a line its residual is computed, in scene lengths from its foot.
_PLACES = np.array([[1.0], [-1.618]])

# Relative difference of distances to the scene's centre up to which two loci are ordered by their coordinates, and of
# components of a direction up to which the first decides its sign.
_TIE = 1e-5

# Sine and scene lengths up to which a transversal is an observed line; a double one is known to half of the digits.
_SAME = 1e-7

_NO_LINES = np.zeros((0, 6))
_NO_PLANES = np.zeros((0, 4))


def analyze_transversals(frame: SceneFrame) -> TransversalAnalysis:
    """Return what meets all lines of a scene.

    Args:
        frame: The scene, n >= 1 lines.

    Source: eq. discr and section "Analysis of the variety V(G)" for n = 4 and 5; the cases by the rank of d . m on the
    null space are new, docs/theory.md section "Transversals".
    """
    singular_values, right = right_singular_vectors(frame.plucker_matrix)
    values = singular_values.tolist()
    dimension = 6 - sum(value > TOLERANCE * values[0] for value in values)
    null = right[6 - dimension :]
    if dimension == 0:
        return TransversalAnalysis(TransversalFamily.NONE, _NO_LINES, _NO_PLANES)
    if dimension == 1:
        if abs(float(null[0, :3] @ null[0, 3:])) <= TOLERANCE:
            return TransversalAnalysis(TransversalFamily.ONE, null, _NO_PLANES)
        return TransversalAnalysis(TransversalFamily.NONE, _NO_LINES, _NO_PLANES)
    if dimension == 2:
        return transversals_of_pencil(null)
    if dimension == 3:
        return _of_net(null)
    return TransversalAnalysis(TransversalFamily.EVERYWHERE, _NO_LINES, _NO_PLANES)


def finite_transversals(analysis: TransversalAnalysis) -> tuple[Array, Array]:
    """Return points closest to the scene's centre and unit directions of the finite single transversals, (k, 3) each.

    Of the two signs of a direction the one whose largest component is positive, the first of several as large; scene
    coordinates.
    """
    scaled = []
    for line in analysis.lines.tolist():
        length = math.hypot(*line[:3])
        if length > TOLERANCE:
            largest = max(map(abs, line[:3]))
            scale = math.copysign(1.0 / length, next(x for x in line[:3] if abs(x) > (1.0 - _TIE) * largest))
            scaled.append([scale * value for value in line])
    if not scaled:
        return NO_PLACES, NO_PLACES
    lines = np.array(scaled)
    direction = lines[:, :3]
    return cross(direction, lines[:, 3:]), direction


def observed_rows(frame: SceneFrame, foot: Array, direction: Array) -> list[int]:
    """Return the row of the observed line that each of k lines is, -1 for none; empty if none is any.

    Args:
        frame: The scene.
        foot: A point on each line, scene coordinates, shape (k, 3).
        direction: Unit directions, shape (k, 3).
    """
    if np.abs(direction @ frame.direction.T).max(initial=0.0) <= 1.0 - _SAME:
        return []
    rows = [-1] * len(foot)
    for i in range(len(foot)):
        turned = np.linalg.norm(cross(frame.direction, direction[i]), axis=1)
        apart = np.linalg.norm(cross(frame.point - foot[i], direction[i]), axis=1)
        same = np.flatnonzero((turned <= _SAME) & (apart <= _SAME * (1.0 + np.linalg.norm(foot[i]))))
        if len(same):
            rows[i] = int(same[0])
    return rows if max(rows) >= 0 else []


def places_along(foot: Array, direction: Array) -> Array:
    """Return the two places on each of k lines at which its residual is computed, shape (2 k, 3).

    Two that are not its foot, so that a point it shares with an observed line hardly hides a wrong direction.
    """
    places: Array = foot[:, np.newaxis, :] + direction[:, np.newaxis, :] * _PLACES
    return places.reshape(-1, 3)


def named_transversals(frame: SceneFrame, foot: Array, direction: Array, residual: Array) -> tuple[Transversal, ...]:
    """Return transversals in the frame of the lines, closest to the scene's centre first.

    Args:
        frame: The scene.
        foot: Of finite_transversals, shape (k, 3).
        direction: Of finite_transversals, shape (k, 3).
        residual: Independent residuals at places_along, shape (2 k,).
    """
    point = frame.from_scene(foot)
    each = residual.tolist()
    return tuple(
        Transversal(point[i], direction[i], max(each[2 * i], each[2 * i + 1]), f"transversal {rank}")
        for rank, i in enumerate(order_of_loci(foot, direction), start=1)
    )


def _klein_form(basis: Array) -> Array:
    """Return the symmetric matrix of d . m on the span of rows (d, m)."""
    form = basis[:, :3] @ basis[:, 3:].T
    symmetric: Array = 0.5 * (form + form.T)
    return symmetric


def order_of_loci(point: Array, direction: Array | None = None) -> list[int]:
    """Return the order in which loci are named: by distance to the scene's centre, then by coordinates.

    The distance comes first because it does not depend on the frame, the unit or the order of the lines; it is
    compared to six digits, so that equally distant loci of a symmetric scene do not change places with rounding.

    Args:
        point: Their points closest to the centre, scene coordinates, shape (k, 3).
        direction: Their directions, if they are lines, shape (k, 3).
    """
    distance = [math.hypot(*row) for row in point.tolist()]
    order = sorted(range(len(distance)), key=distance.__getitem__)
    if all(distance[j] - distance[i] > _TIE * distance[j] for i, j in pairwise(order)):
        return order
    columns = point if direction is None else np.concatenate([point, direction], axis=1)
    rows = np.round(columns, 6).tolist()
    return sorted(order, key=lambda i: (float(f"{distance[i]:.6g}"), rows[i]))


def transversals_of_pencil(null: Array) -> TransversalAnalysis:
    """Return the transversals in a two-dimensional null space (2, 6): the zeros of a binary quadratic form."""
    (a, b), (_, c) = _klein_form(null).tolist()
    discriminant, size = b * b - a * c, max(abs(a), abs(b), abs(c))
    if size <= TOLERANCE:
        return TransversalAnalysis(TransversalFamily.PENCIL, _NO_LINES, _plane_of(null))
    # Relative to the form, which is small as a whole near a pencil.
    margin = TOLERANCE * size**2
    if discriminant < -margin:
        return TransversalAnalysis(TransversalFamily.COMPLEX_PAIR, _NO_LINES, _NO_PLANES)
    if discriminant <= margin:
        root = [(-b, a)] if abs(a) >= abs(c) else [(c, -b)]
        return TransversalAnalysis(TransversalFamily.DOUBLE, _combined(root, null), _NO_PLANES)
    # The root without cancellation first; the other from the product of the two.
    q = -(b + math.copysign(math.sqrt(discriminant), b))
    roots = [(q, a), (c, q)]
    return TransversalAnalysis(TransversalFamily.TWO, _combined(roots, null), _NO_PLANES)


def _of_net(null: Array) -> TransversalAnalysis:
    """The transversals in a three-dimensional null space: the zeros of a ternary quadratic form, a conic."""
    value, vector = np.linalg.eigh(_klein_form(null))
    rank = int((np.abs(value) > TOLERANCE).sum())
    if rank == 3:
        return TransversalAnalysis(TransversalFamily.REGULUS, _NO_LINES, _NO_PLANES)
    if rank == 0:
        # All d . m vanish: the lines of one plane, or all lines through one point (finite or not).
        flat = np.linalg.svd(null[:, :3], compute_uv=False)
        if flat[2] <= TOLERANCE < flat[1]:
            return TransversalAnalysis(TransversalFamily.PLANE, _NO_LINES, _plane_of(null))
        return TransversalAnalysis(TransversalFamily.EVERYWHERE, _NO_LINES, _NO_PLANES)
    # Two planes of vectors, b . x = 0 with b = sqrt|v1| e1 +- sqrt|v2| e2, equal when the rank is one.
    order = np.argsort(-np.abs(value))
    first, second = (np.sqrt(np.abs(value[i])) * vector[:, i] for i in order[:2])
    if rank == 2 and value[order[0]] * value[order[1]] > 0.0:
        return TransversalAnalysis(TransversalFamily.ONE, vector[:, order[2:]].T @ null, _NO_PLANES)
    normals = [first] if rank == 1 else [first + second, first - second]
    planes = np.concatenate([_plane_of(np.linalg.svd(b[np.newaxis, :])[2][1:] @ null) for b in normals])
    family = TransversalFamily.PENCIL if rank == 1 else TransversalFamily.TWO_PENCILS
    return TransversalAnalysis(family, _NO_LINES, planes)


def _plane_of(lines: Array) -> Array:
    """Return the plane (a, b), a . x + b = 0, |a| = 1, through coplanar lines (d, m); none if it is at infinity.

    A line lies in the plane if a . d = 0 and a x m = b d.
    """
    equations = np.zeros((4 * len(lines), 4))
    for row in range(len(lines)):
        d, (x, y, z) = lines[row, :3], lines[row, 3:]
        equations[4 * row, :3] = d
        equations[4 * row + 1 : 4 * row + 4, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        equations[4 * row + 1 : 4 * row + 4, 3] = -d
    plane: Array = np.linalg.svd(equations)[2][-1:]
    normal_length = float(np.linalg.norm(plane[0, :3]))
    if normal_length <= TOLERANCE:
        return _NO_PLANES
    return plane / normal_length


def _combined(roots: list[tuple[float, float]], null: Array) -> Array:
    """Return the unit vectors along x null[0] + y null[1] for roots (x, y), shape (k, 6); null is orthonormal."""
    lines: Array = np.array([(x / math.hypot(x, y), y / math.hypot(x, y)) for x, y in roots]) @ null
    return lines
