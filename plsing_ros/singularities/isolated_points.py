# SPDX-License-Identifier: Apache-2.0
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

import numpy as np
import numpy.typing as npt

from plsing_ros import _core
from plsing_ros.arrays import Array, BoolArray
from plsing_ros.singularities.bilinear_system import bilinear_tensor, motions_from_centers, newton
from plsing_ros.singularities.residual import residuals_and_distances
from plsing_ros.singularities.ternary_forms import basis_values, half_sphere_points, multiplication_maps

ComplexArray = npt.NDArray[np.complex128]

# A point counts as found if its independent residual is at most this.
RESIDUAL_TOLERANCE = 1e-9

# A point with a larger residual than this gets Newton's method, which makes it a few digits better; one scene in forty
# has such points.
_POLISHED = 1e-13

# ... by moving unit vectors (C_0, C) no more than this, as one minus their product.
_MOVED = 1e-6

# Distance to an observed line, in the root mean square one, up to which a point is on it; and a residual over that
# distance that cannot tell a point from one that merged with the line.
_ON_LINE, _MERGED = 1e-12, 1e-3

# Two of the ten nearer than this to each other in projective space are one: the solver found a point twice.
_SEPARATION = 1e-7

# Homogeneous coordinate C_0 below which a unit (C_0, C) is a point at infinity: farther than 1e9 scene lengths.
_AT_INFINITY = 1e-9

# Imaginary part, relative to the largest coordinate about the scene's centre, up to which a point is real.
_REAL = 1e-10

_SAMPLES = half_sphere_points(15)
_INTERPOLATE = np.asarray(np.linalg.inv(basis_values(4, _SAMPLES)), dtype=np.float64)
_MULTIPLY = multiplication_maps(4)

# Pairs of generic linear forms (numerator, denominator); the next pair is tried where one fails.
_FORMS = np.array(
    [
        [[0.62, -0.35, 0.71], [0.30, 0.83, 0.47]],
        [[0.48, 0.65, -0.59], [-0.77, 0.42, 0.48]],
        [[-0.28, 0.79, 0.55], [0.66, 0.17, -0.73]],
    ]
)


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
    """

    center: ComplexArray
    real: BoolArray
    residual: Array
    complete: BoolArray
    rank_margin: Array


def solve_ten_points(direction: Array, point: Array) -> TenPoints:
    """Return the ten isolated singularities of S scenes of four lines.

    Args:
        direction: Unit directions, shape (S, 4, 3).
        point: The point of each line closest to the scene's centre, scene coordinates, shape (S, 4, 3).
    """
    found = _solve(direction, point, _FORMS[0])
    for forms in _FORMS[1:]:
        if found.complete.all():
            break
        failed = np.flatnonzero(~found.complete)
        again = _solve(direction[failed], point[failed], forms)
        better = again.complete | (again.residual.max(axis=1) < found.residual[failed].max(axis=1))
        for name in ("center", "real", "residual", "complete"):
            getattr(found, name)[failed[better]] = getattr(again, name)[better]
    return found


def _solve(direction: Array, point: Array, forms: Array) -> TenPoints:
    """Solve with one pair of linear forms, polish what is rough, and judge the ten of each scene as a whole."""
    center, h, w, residual, margin = _core.isolated_points(
        direction, point, forms, _SAMPLES, _INTERPOLATE, _MULTIPLY, _ON_LINE, _MERGED, _AT_INFINITY
    )
    rough = (residual > _POLISHED) & ~np.isnan(center[:, :, 0])
    if rough.any():
        scene = rough.nonzero()[0]
        h[rough], center[rough], residual[rough] = _polished(h[rough], w[rough], direction[scene], point[scene])
    with np.errstate(invalid="ignore"):
        real = np.abs(center.imag).max(axis=2) <= _REAL * (1.0 + np.abs(center).max(axis=2))
    complete = are_distinct(h) & (residual.max(axis=1) <= RESIDUAL_TOLERANCE)
    return TenPoints(center, real, residual, complete, margin)


def are_distinct(h: ComplexArray) -> BoolArray:
    """Return for which scenes no two of k points, unit homogeneous vectors (S, k, 4), are the same, shape (S,)."""
    overlap = np.abs(h.conj() @ h.swapaxes(1, 2)) - np.eye(h.shape[1])
    distinct: BoolArray = overlap.max(axis=(1, 2)) < 1.0 - 0.5 * _SEPARATION**2
    return distinct


def _residuals(center: ComplexArray, direction: Array, point: Array) -> Array:
    """Return the independent residuals of centres; 1 on an observed line, a singularity of another kind, too."""
    residual, distance = residuals_and_distances(point, direction, center)
    residual[(distance <= _ON_LINE) | (residual > _MERGED * distance)] = 1.0
    return residual


def _polished(
    h: ComplexArray, w: ComplexArray, direction: Array, point: Array
) -> tuple[ComplexArray, ComplexArray, Array]:
    """Return homogeneous centres, centres and residuals after Newton's method, of one scene each."""
    tensor = bilinear_tensor(direction, point)
    found = newton(tensor, np.arange(len(h)), h, motions_from_centers(tensor, h, w))[0]
    # One that went far has found another kind of singularity, on a transversal for example.
    far = np.abs(np.einsum("ki,ki->k", found, h.conj())) < 1.0 - _MOVED
    found[far] = h[far]
    center = np.full((len(h), 3), np.nan, dtype=complex)
    finite = np.abs(found[:, 0]) > _AT_INFINITY
    center[finite] = found[finite, 1:] / found[finite, :1]
    return found, center, _residuals(center, direction, point)
