# SPDX-License-Identifier: Apache-2.0
"""All camera centres at which a screw with a given axis direction is lost, in closed form.

For a given axis direction w the unknowns are the centre C and the velocity v of the camera there, six numbers
y = (C, v). A line that is not parallel to w asks for

    P w . (M - C) = 0    and    P w . v + (u . w) (w x u) . (M - C) = 0,

which is linear in y. A line parallel to w asks for |w x (M - C)|^2 + (w x (M - C)) . v = 0; the difference of two of
these is linear in y, too. So the solutions are an affine space, and if lines are parallel to w, one quadric cuts it.
The centres are a point, a straight line, a plane or a conic.

Parallel lines leave at most two axis directions (axes_of_parallel_lines), so that in a scene with parallel lines this
is everything besides transversals. All in scene coordinates. Source: new, docs/theory.md section "Parallel lines".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, BoolArray, cross
from plsing_ros.singularities.scene_frame import SceneFrame

# Sines, relative singular values and scene coordinates below this are zero.
_ZERO = 1e-9
# Sine of directions up to which a root that is found twice is one.
_BLURRED = 1e-6


@dataclass(frozen=True, eq=False)
class FlatSet:
    """Centres C = origin + axes^T z for z in R^k that fulfil one equation, or all of them.

    Attributes:
        origin: Shape (3,), scene coordinates.
        axes: Orthonormal rows, shape (k, 3), k <= 2.
        quadric: Symmetric matrix of the equation (1, z) Q (1, z) = 0 with largest entry 1, shape (k + 1, k + 1); zeros
            if every z is one.
    """

    origin: Array
    axes: Array
    quadric: Array

    @property
    def whole(self) -> bool:
        """Whether every z is one."""
        return not self.quadric.any()


def axes_of_parallel_lines(frame: SceneFrame) -> Array | None:
    """Return the axis directions that screws can have that are lost off the lines, shape (k, 3); None if any may be.

    Args:
        frame: The scene; its lines differ and are not all parallel.
    """
    if not frame.has_near_parallels:
        return None
    sine = np.linalg.norm(cross(frame.direction[:, np.newaxis], frame.direction), axis=2)
    parallel = sine <= _ZERO
    row = int(parallel.sum(axis=1).argmax())
    rows = np.flatnonzero(parallel[row])
    if len(rows) == 1:
        return None
    direction: Array = frame.direction[row]
    offset = frame.point[rows[1:]] - frame.point[rows[0]]
    offset -= np.outer(offset @ direction, direction)
    _, size, right = np.linalg.svd(offset, full_matrices=False)
    if len(size) > 1 and size[1] > _ZERO * size[0]:
        return direction[np.newaxis]
    return np.stack([direction, cross(direction, right[0])])


def axes_of_concurrent_lines(frame: SceneFrame) -> Array | None:
    """Return the real axis directions that screws can have that are lost off the lines, shape (k, 3); None if any may.

    With the origin at the point of k concurrent lines, each asks for P w . C = 0: S = C w^T + w C^T, a symmetric matrix
    of rank two at most, with tr S = u . S u. For four lines or more these leave a pencil of matrices, one, or none.

    Args:
        frame: The scene; its lines differ and are not all concurrent.

    Source: new, docs/theory.md section "Parallel lines".
    """
    rows = _most_concurrent(frame)
    if len(rows) < 4:
        return None
    return _paired_axes(frame.direction[rows])


def axes_of_flat_loci(frame: SceneFrame) -> Array:
    """Return the axis directions of screws that may be lost at infinitely many centres, shape (k, 3).

    Such centres move along some e with P w . e = 0 for all lines: tr S = u . S u for S = e w^T + w e^T, as for
    concurrent lines. Of lines in parallel planes, only the directions of the lines and of the normal are returned.

    Args:
        frame: The scene; no two lines are parallel.

    Source: new, docs/theory.md section "Witness points".
    """
    found: list[Array] = [frame.direction[row] for row in range(len(frame.direction))]
    axes = _paired_axes(frame.direction)
    if axes is None:
        axes = np.linalg.svd(frame.direction)[2][2:]
    for row in range(len(axes)):
        if all(np.linalg.norm(cross(axes[row], other)) > _BLURRED for other in found):
            found.append(_polished(frame.direction, axes[row]))
    return np.array(found)


def _polished(direction: Array, axis: Array) -> Array:
    """Return the axis w near one for which all P w are in one plane."""
    across = axis - (direction @ axis)[:, np.newaxis] * direction
    pair = np.array([axis, np.linalg.svd(across)[2][2]])
    for _ in range(20):
        w, e = pair
        along_w, along_e = direction @ w, direction @ e
        value = w @ e - along_w * along_e
        if np.abs(value).max() <= 1e-15:
            break
        slope = np.concatenate([e - along_e[:, None] * direction, w - along_w[:, None] * direction], axis=1)
        pair = pair - np.linalg.lstsq(slope, value, rcond=1e-10)[0].reshape(2, 3)
        pair /= np.linalg.norm(pair, axis=1, keepdims=True)
    polished: Array = pair[0]
    return polished


def _paired_axes(u: Array) -> Array | None:
    """Return the real w for which some e has P w . e = 0 for directions u (n, 3), shape (k, 3); None if too many have.

    w and e are in pairs: S = e w^T + w e^T is a symmetric matrix of rank two at most, with tr S = u . S u.
    """
    products = u[:, [0, 1, 2, 0, 0, 1]] * u[:, [0, 1, 2, 1, 2, 2]] * [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
    _, size, right = np.linalg.svd(products - [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    left = 6 - int((size > _ZERO).sum())
    if left > 2:
        return None
    basis = right[6 - left :][:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    if left == 2:
        # det(first + t second), a cubic in t, from four values.
        places = np.array([-1.0, 0.0, 1.0, 2.0])
        values = np.linalg.det(basis[0] + places[:, np.newaxis, np.newaxis] * basis[1])
        roots = np.roots(np.polyfit(places, values, 3))
        real = roots[np.abs(roots.imag) <= 1e-7 * (1.0 + np.abs(roots))].real
        candidates = [*(basis[0] + t * basis[1] for t in real), basis[1]]
    else:
        candidates = list(basis)
    axes: list[Array] = []
    for matrix in candidates:
        value, vector = np.linalg.eigh(matrix)
        if abs(value[1]) <= 1e-6 * np.abs(value).max() and value[0] < 0.0 < value[2]:
            first, second = np.sqrt(value[2]) * vector[:, 2], np.sqrt(-value[0]) * vector[:, 0]
            axes += [each / np.linalg.norm(each) for each in (first + second, first - second)]
    return np.array(axes).reshape(-1, 3)


def _most_concurrent(frame: SceneFrame) -> list[int]:
    """Return the rows of the most lines that pass through one point that two of them have in common."""
    best: list[int] = []
    for i in range(len(frame.direction)):
        for j in range(i):
            normal = cross(frame.direction[i], frame.direction[j])
            square, offset = float(normal @ normal), frame.point[j] - frame.point[i]
            if square > _ZERO and abs(offset @ normal) <= _ZERO * np.sqrt(square):
                place = frame.point[i] + (cross(offset, frame.direction[j]) @ normal) / square * frame.direction[i]
                apart = np.linalg.norm(cross(frame.point - place, frame.direction), axis=1)
                rows = np.flatnonzero(apart <= _ZERO * (1.0 + float(np.linalg.norm(place)))).tolist()
                best = rows if len(rows) > len(best) else best
    return best


def centers_of_axis(frame: SceneFrame, axis: Array) -> FlatSet | None:
    """Return the centres on no line at which a screw along an axis direction is lost; None if there are none.

    Args:
        frame: The scene.
        axis: Unit vector w, shape (3,).
    """
    sine = np.linalg.norm(cross(frame.direction, axis), axis=1)
    along = sine <= _ZERO
    solved = _affine_solutions(frame, axis, sine, along)
    if solved is None:
        return None
    place, basis = solved
    # Combinations that do not move the centre last.
    _, size, mix = np.linalg.svd(basis[:3], full_matrices=True)
    moves = int((size > _ZERO).sum())
    basis = basis @ mix.T
    axes, tilt = np.linalg.qr(basis[:3, :moves])
    # z are coordinates along orthonormal axes.
    slope = np.linalg.solve(tilt.T, basis[:, :moves].T) if moves else np.zeros((0, 6))
    quadric = np.zeros((moves + 1, moves + 1))
    if along.any():
        first = frame.point[np.flatnonzero(along)[0]]
        affine = np.concatenate([place[np.newaxis], slope])
        across = cross(axis, -affine[:, :3])
        across[0] += cross(axis, first)
        # A velocity that the centre does not need fulfils the equation wherever it has an influence.
        if np.abs(across @ basis[3:, moves:]).max(initial=0.0) <= _ZERO:
            quadric = across @ across.T + 0.5 * (across @ affine[:, 3:].T + affine[:, 3:] @ across.T)
            largest = float(np.abs(quadric).max())
            quadric = quadric / largest if largest > _ZERO else np.zeros_like(quadric)
            if moves == 0 and largest > _ZERO:
                return None
    return FlatSet(place[:3], axes.T, quadric)


def _affine_solutions(frame: SceneFrame, axis: Array, sine: Array, along: BoolArray) -> tuple[Array, Array] | None:
    """Return y and orthonormal columns, shape (6, d), of the affine solution space of the linear equations."""
    direction, point, size = frame.direction[~along], frame.point[~along], sine[~along, np.newaxis]
    cosine = direction @ axis
    across = (axis - cosine[:, np.newaxis] * direction) / size
    turned = cosine[:, np.newaxis] * cross(axis, direction) / size
    zero = np.zeros_like(across)
    rows = [np.concatenate([across, zero], axis=1), np.concatenate([-turned, across], axis=1)]
    right = [(across * point).sum(axis=1), -(turned * point).sum(axis=1)]
    parallel = cross(axis, frame.point[along])
    if len(parallel) > 1:
        apart = parallel[1:] - parallel[0]
        scale = np.linalg.norm(apart, axis=1, keepdims=True)
        # -2 (w x dM) . (w x C) + (w x dM) . v = |w x M_1|^2 - |w x M|^2.
        rows.append(np.concatenate([2.0 * cross(axis, apart), apart], axis=1) / scale)
        right.append(((parallel[0] ** 2).sum() - (parallel[1:] ** 2).sum(axis=1)) / scale[:, 0])
    matrix, value = np.concatenate(rows), np.concatenate(right)
    left, size, transposed = np.linalg.svd(matrix)
    rank = int((size > _ZERO * size[0]).sum())
    seen = left.T @ value
    if np.abs(left[:, rank:] @ seen[rank:]).max(initial=0.0) > _ZERO * (1.0 + np.abs(value).max()):
        return None
    place: Array = transposed[:rank].T @ (seen[:rank] / size[:rank])
    return place, transposed[rank:].T
