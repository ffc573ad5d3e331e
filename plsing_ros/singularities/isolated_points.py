"""The ten isolated singularities of four lines, for many scenes at once.

At an isolated singularity the camera loses a screw motion with axis direction w. The axis directions are the w for
which some forces F_i, each across its line, are in balance and lie in the planes of w and u_i (docs/theory.md, section
"Ten points"): with the four-dimensional space of forces F_i . u_i = 0, sum F_i = 0, sum F_i . M_i = 0,

    det[F_i, u_i, w] = 0 for each of the four lines,   sum (u_i . w) F_i . (u_i x M_i) = 0.

These are five equations linear in F and in w: a 5 x 4 matrix, linear in w, loses rank. That happens at ten points of
the plane. The steps, for S scenes each:

1. its five 4 x 4 minors, plane quartics, from their values at 15 fixed points of the sphere;
2. the ten-dimensional space of functionals on quartics that vanish on all five (one QR factorisation, 15 x 5);
3. multiplication by one linear form over another on that space: a 10 x 10 eigenproblem; w read off its eigenvectors;
4. camera centre and motion from w, and Newton's method on the bilinear equations A(C) k = 0 of the rank basis.

All in scene coordinates (SceneFrame). Source: new.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, BoolArray, cross
from plsing_ros.singularities.kernel_pencil import (
    bilinear_tensor,
    centers_from_axis_directions,
    motions_from_centers,
    newton,
)
from plsing_ros.singularities.residual import NO_PLACES, residuals_and_incidence
from plsing_ros.singularities.small_matrices import eigenvectors_up, orthogonal_complements
from plsing_ros.singularities.ternary_forms import basis_values, half_sphere_points, multiplication_maps

ComplexArray = npt.NDArray[np.complex128]

# A point counts as found if its independent residual is at most this.
RESIDUAL_TOLERANCE = 1e-9

# A point with a larger residual than this gets Newton's method, which makes it a few digits better and takes as long
# again as the rest; most points are below at once.
_POLISHED = 1e-13

# Two of the ten nearer than this to each other in projective space are one: the solver found a point twice.
_SEPARATION = 1e-7

# Homogeneous coordinate C_0 below which a unit (C_0, C) is a point at infinity: farther than 1e9 scene lengths.
_AT_INFINITY = 1e-9

# Imaginary part, relative to the largest coordinate about the scene's centre, up to which a point is real.
_REAL = 1e-10

_SAMPLES = half_sphere_points(15)
_INTERPOLATE = np.linalg.inv(basis_values(4, _SAMPLES))
_MULTIPLY = multiplication_maps(4)
_MULTIPLY_ALL = np.ascontiguousarray(_MULTIPLY.reshape(30, 15).T)
_TINY = np.finfo(float).tiny
_TEN = np.arange(10)
_IDENTITY = np.eye(3)
# Row i of the line's coordinates belongs to column i of its own constraint.
_OWN_COLUMN = np.eye(4)[:, np.newaxis, :]

# Pairs of generic linear forms (numerator, denominator); the next pair is tried where one fails.
_FORMS = np.array(
    [
        [[0.62, -0.35, 0.71], [0.30, 0.83, 0.47]],
        [[0.48, 0.65, -0.59], [-0.77, 0.42, 0.48]],
        [[-0.28, 0.79, 0.55], [0.66, 0.17, -0.73]],
    ]
)
_TRY_FORMS = np.einsum("tfa,aij->tfij", _FORMS, _MULTIPLY)

_PAIRS = list(combinations(range(5), 2))


def _wedge_signs() -> Array:
    """Return W (25, 10): (outer product of two columns of five) @ W = their 2 x 2 minors."""
    signs = np.zeros((5, 5, 10))
    for pair, (i, j) in enumerate(_PAIRS):
        signs[i, j, pair], signs[j, i, pair] = 1.0, -1.0
    return signs.reshape(25, 10)


def _laplace_signs() -> Array:
    """Return E (100, 5): (2 x 2 minors of the first two columns, outer, those of the last two) @ E = 4 x 4 minors."""
    signs = np.zeros((10, 10, 5))
    for first, second in permutations(range(10), 2):
        rows = _PAIRS[first] + _PAIRS[second]
        if len(set(rows)) == 4:
            left_out = (set(range(5)) - set(rows)).pop()
            inversions = sum(x > y for x, y in combinations(rows, 2))
            signs[first, second, left_out] = (-1.0) ** inversions
    return signs.reshape(100, 5)


_WEDGE = _wedge_signs()
_LAPLACE = _laplace_signs()


@dataclass(frozen=True, eq=False)
class TenPoints:
    """What the direct solver found for S scenes, in scene coordinates.

    Attributes:
        center: Camera centres, complex, shape (S, 10, 3); NaN where a point is at infinity.
        real: Which are real, shape (S, 10).
        residual: Independent residuals (singularity_residuals), shape (S, 10); 1 where there is no centre.
        complete: Scenes with ten distinct finite points, all with residuals up to RESIDUAL_TOLERANCE, shape (S,).
        rank_margin: How far the scene is from one with fewer points or infinitely many, in [0, 1], shape (S,): the
            smallest relative gap in the two rank decisions of the elimination.
        place_residual: Residuals of the places that were given, shape (p,).
    """

    center: ComplexArray
    real: BoolArray
    residual: Array
    complete: BoolArray
    rank_margin: Array
    place_residual: Array


def solve_ten_points(direction: Array, point: Array, places: Array = NO_PLACES) -> TenPoints:
    """Return the ten isolated singularities of S scenes of four lines.

    Args:
        direction: Unit directions, shape (S, 4, 3).
        point: The point of each line closest to the scene's centre, scene coordinates, shape (S, 4, 3).
        places: Other places at which the residual is asked for, if there is one scene, shape (p, 3). All residuals
            of a scene in one go take half as long as in two.
    """
    functionals, margin = _unknown_functionals(direction, point)
    found = _from_functionals(functionals, margin, direction, point, _TRY_FORMS[0], places)
    for forms in _TRY_FORMS[1:]:
        if found.complete.all():
            break
        failed = np.flatnonzero(~found.complete)
        again = _from_functionals(functionals[failed], margin[failed], direction[failed], point[failed], forms)
        better = again.complete | (again.residual.max(axis=1) < found.residual[failed].max(axis=1))
        for name in ("center", "real", "residual", "complete"):
            getattr(found, name)[failed[better]] = getattr(again, name)[better]
    return found


def _unknown_functionals(direction: Array, point: Array) -> tuple[Array, Array]:
    """Return the span of the quartic basis at the axis directions (S, 15, 10), and the rank margins (S,)."""
    scenes = len(direction)
    matrix = force_matrix(direction, point).swapaxes(1, 2).reshape(scenes, 20, 3)
    columns = (_SAMPLES @ matrix.swapaxes(1, 2)).reshape(scenes, 15, 4, 5)
    outer = columns[:, :, ::2, :, np.newaxis] * columns[:, :, 1::2, np.newaxis, :]
    pairs = outer.reshape(scenes, 15, 2, 25) @ _WEDGE
    minors = (pairs[:, :, 0, :, np.newaxis] * pairs[:, :, 1, np.newaxis, :]).reshape(scenes, 15, 100) @ _LAPLACE
    functionals, size = orthogonal_complements(_INTERPOLATE @ minors)
    # 0 / tiny = 0 for a matrix of zeros.
    return functionals, size.min(axis=1) / np.maximum(size.max(axis=1), _TINY)


def force_matrix(direction: Array, point: Array) -> Array:
    """Return the five equations of the module's head as bilinear forms in a basis of the forces and w, (S, 5, 4, 3)."""
    scenes = len(direction)
    constraints = np.empty((scenes, 4, 3, 8))
    constraints[:, :, :, :4] = direction[..., np.newaxis] * _OWN_COLUMN
    constraints[:, :, :, 4:7] = _IDENTITY
    constraints[:, :, :, 7] = point
    forces = orthogonal_complements(constraints.reshape(scenes, 12, 8))[0].swapaxes(1, 2).reshape(scenes, 4, 4, 3)
    equations = np.empty((scenes, 5, 4, 3))
    equations[:, :4] = cross(direction[:, np.newaxis], forces).swapaxes(1, 2)
    equations[:, 4] = np.einsum("sfni,sni->sfn", forces, cross(direction, point)) @ direction
    return equations


def _from_functionals(
    functionals: Array, margin: Array, direction: Array, point: Array, forms: Array, places: Array = NO_PLACES
) -> TenPoints:
    """Solve the eigenproblems for one pair of linear forms and turn axis directions into camera centres."""
    numerator, denominator = forms[:, np.newaxis] @ functionals
    # A wrong result is caught by the residuals below.
    kept, vectors = eigenvectors_up(denominator, numerator)
    scenes = len(functionals)
    scene = kept.nonzero()[0]
    if scenes == 1:
        quartics = vectors @ functionals[0].T
    else:
        quartics = (functionals[scene] @ vectors[:, :, np.newaxis])[:, :, 0]
        # The lines of the scene of each point.
        direction, point = direction[scene], point[scene]
    # w times each cubic basis value: w itself, up to scale, where that value is largest.
    products = (quartics @ _MULTIPLY_ALL).reshape(-1, 3, 10)
    largest = np.abs(products).max(axis=1).argmax(axis=1)
    w = products[np.arange(len(scene)), :, largest].astype(complex)
    h = centers_from_axis_directions(direction, point, w)
    center, residual, place_residual = _centers(h, direction, point, places)
    (rough,) = (residual > _POLISHED).nonzero()
    if len(rough):
        own = np.zeros_like(rough) if scenes == 1 else rough
        direction, point = direction[own], point[own]
        tensor = bilinear_tensor(direction, point)
        motion = motions_from_centers(tensor, h[rough], w[rough])
        h[rough] = newton(tensor, np.arange(len(rough)), h[rough], motion)[0]
        center[rough], residual[rough], _ = _centers(h[rough], direction, point, NO_PLACES)
    return _with_conjugates(h, center, residual, kept, margin, place_residual)


def _centers(
    h: npt.NDArray[Any], direction: Array, point: Array, places: Array
) -> tuple[npt.NDArray[Any], Array, Array]:
    """Return camera centres of homogeneous ones, NaN at infinity, and the independent residuals there and at places."""
    count = len(h)
    scale = h[:, :1]
    infinite = np.abs(h[:, 0]) <= _AT_INFINITY
    any_infinite = infinite.any()
    if any_infinite:
        scale = np.where(infinite[:, np.newaxis], 1.0, scale)
    center = h[:, 1:] / scale
    checked = np.concatenate([center, places]) if len(places) else center
    residual, on_line = residuals_and_incidence(point, direction, checked)
    # A centre on an observed line is a singularity of another kind.
    residual[:count][on_line[:count]] = 1.0
    if any_infinite:
        center[infinite], residual[:count][infinite] = np.nan, 1.0
    return center, residual[:count], residual[count:]


def _with_conjugates(
    h: npt.NDArray[Any], center: npt.NDArray[Any], residual: Array, kept: BoolArray, margin: Array, places: Array
) -> TenPoints:
    """Fill in the conjugates that were left out, and judge the ten of each scene as a whole."""
    scenes = len(margin)
    real = np.abs(center.imag).max(axis=1) <= _REAL * (1.0 + np.abs(center).max(axis=1))
    # A slot that was left out follows the one with its conjugate.
    source = kept.cumsum() - 1
    both = np.concatenate([h, center], axis=1)[source]
    np.conjugate(both, out=both, where=~kept.reshape(-1, 1))
    both = both.reshape(scenes, 10, 7)
    h, center = both[:, :, :4], both[:, :, 4:]
    residual, real = residual[source].reshape(scenes, 10), real[source].reshape(scenes, 10)
    overlap = np.abs(h @ h.conj().swapaxes(1, 2))
    overlap[:, _TEN, _TEN] = 0.0
    distinct = overlap.max(axis=(1, 2)) < 1.0 - 0.5 * _SEPARATION**2
    return TenPoints(center, real, residual, distinct & (residual <= RESIDUAL_TOLERANCE).all(axis=1), margin, places)
