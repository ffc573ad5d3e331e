# SPDX-License-Identifier: Apache-2.0
"""Singular curves whose unobservable screws turn from point to point, from witness points in the plane of axes.

Such a curve is a plane curve F(w) = 0 of axis directions w, each with one centre C(w) that is linear in what w gives.
Any line of the plane of axes meets it in as many points as its degree, and for four lines these are eigenvalues of a
pencil (isolated_points has the 5 x 4 matrix). Source: new, docs/theory.md section "Witness points".
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, islice, product
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg

from plsing_ros.arrays import Array, BoolArray, cross
from plsing_ros.singularities.isolated_points import ComplexArray
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.ternary_forms import basis_values

# Relative singular values, residuals and values of unit forms that are zero, at eigenvalues of pencils.
_ZERO = 1e-8
# Four-line subsets that are tried for a pencil that is not singular as a whole.
_SUBSETS = 20
# Lines in the plane of axes, each through two directions: for a quartic, and one to verify. Any will do that is in no
# special position.
_LINES = np.random.default_rng(41).normal(size=(6, 2, 3))
_MIX = np.random.default_rng(42).normal(size=(4, 5))


def axis_curves(frame: SceneFrame, is_known: Callable[[ComplexArray], bool]) -> list[Array]:
    """Return forms F of plane curves F(w) = 0 of axis directions, in the basis of ternary_forms, lines apart.

    Args:
        frame: The scene, n >= 4 lines.
        is_known: Whether a singular centre (3,) is on a locus that is known; such curves are left out.
    """
    found = _witnesses(frame, _LINES[0], is_known)
    if not found:
        return []
    degree = len(found)
    rows = [found]
    # The product of as many lines as the degree has the same points.
    for line in _LINES[1 : degree + 2]:
        more = _witnesses(frame, line, is_known)
        if len(more) != degree:
            return []
        rows.append(more)
    forms = []
    for first, second in product(*rows[:2]):
        straight = np.cross(first, second)
        straight = straight / straight[np.abs(straight).argmax()]
        others = [min(row, key=lambda w: abs(straight @ w), default=first) for row in rows[2:]]
        on = [first, second, *others]
        left = [[w for w in row if w is not each] for row, each in zip(rows, on, strict=True)]
        if any(len(a) == len(b) for a, b in zip(left, rows, strict=True)):
            continue
        if all(abs(straight @ w) <= 1e2 * _ZERO for w in others):
            # Half of a conjugate pair of lines has one real point, which is no curve.
            forms += [_fitted(1, on)] if np.abs(straight.imag).max() <= 1e-6 else []
            rows = left
    if rows[0]:
        forms.append(_fitted(len(rows[0]), [w for row in rows for w in row]))
    return forms


def _fitted(degree: int, points: list[ComplexArray]) -> Array:
    values = basis_values(degree, np.array(points))
    form: Array = np.linalg.svd(np.concatenate([values.real, values.imag]))[2][-1]
    return form


def _witnesses(frame: SceneFrame, line: Array, is_known: Callable[[ComplexArray], bool]) -> list[ComplexArray]:
    """Return the axis directions on a line (2, 3) of their plane that are lost somewhere off all known loci."""
    pencil = _pencil(frame, line)
    if pencil is None:
        return []
    position = scipy.linalg.eigvals(_MIX @ pencil[0], -(_MIX @ pencil[1]))
    kept: list[ComplexArray] = []
    for t in position[np.isfinite(position)]:
        w = line[0] + t * line[1]
        w = w / np.linalg.norm(w)
        values = np.linalg.svd(pencil[0] + t * pencil[1], compute_uv=False)
        if values[3] > _ZERO * values[0]:
            continue
        center, rank = centers_of_axes(frame, w[np.newaxis])
        if (
            rank[0]
            and singularity_residuals(frame.point, frame.direction, center)[0] <= _ZERO
            and not is_known(center[0])
        ):
            kept.append(w)
    return kept


def _pencil(frame: SceneFrame, line: Array) -> Array | None:
    """Return the matrices of four of the lines at two axis directions, (2, 5, 4); None if all are singular."""
    for rows in islice(combinations(range(len(frame.direction)), 4), _SUBSETS):
        tensor = balance_tensor(frame.direction[list(rows)], frame.point[list(rows)])
        pencil: Array = np.einsum("ika,la->lik", tensor, line)
        values = np.linalg.svd(pencil[0] + 0.7312 * pencil[1], compute_uv=False)
        if values[3] > _ZERO * values[0]:
            return pencil
    return None


def balance_tensor(direction: Array, point: Array) -> Array:
    """Return T, shape (5, 4, 3), of four lines: T @ w loses rank at the axis directions w of unobservable screws.

    Source: eq. (5) of docs/theory.md section "Ten points".
    """
    equations = np.zeros((8, 4, 3))
    equations[np.arange(4), np.arange(4)] = direction
    for axis in range(3):
        equations[4 + axis, :, axis] = 1.0
    equations[7] = point
    forces = np.linalg.svd(equations.reshape(8, 12))[2][8:].reshape(4, 4, 3)
    tensor = np.empty((5, 4, 3))
    tensor[:4] = cross(forces, direction).transpose(1, 0, 2)
    tensor[4] = np.einsum("kia,ia->ki", forces, cross(direction, point)) @ direction
    return tensor


def centers_of_axes(frame: SceneFrame, axes: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], BoolArray]:
    """Return the centres C with P w . (M - C) = 0 for all lines, for axes w (k, 3), and whether each is the only one.

    In the sense of least squares; shapes (k, 3) and (k,).
    """
    cosine = axes @ frame.direction.T
    across: npt.NDArray[Any] = axes[:, np.newaxis] - cosine[:, :, np.newaxis] * frame.direction
    left, size, right = np.linalg.svd(across, full_matrices=False)
    height = (across * frame.point).sum(axis=2)[:, np.newaxis]
    seen = (height @ left.conj())[:, 0] / np.maximum(size, 1e-300)
    centers: npt.NDArray[Any] = (seen[:, np.newaxis] @ right.conj())[:, 0]
    return centers, np.asarray(size[:, 2] > _ZERO)
