# SPDX-License-Identifier: Apache-2.0
"""Isolated points of special four-line scenes, as limits of the ten points of nearby generic scenes.

The equations A(h) k = 0 are as many as their unknowns, so every isolated solution of a special scene is the limit of
solutions of any generic scene that tends to it, and a generic scene has ten. Three different directions of approach
separate the cases: a limit that all of them share is isolated; limits that differ lie on a curve or surface.
Source: new, docs/theory.md section "Special scenes".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, BoolArray, cross
from plsing_ros.singularities.bilinear_system import bilinear_tensor, jacobians, newton
from plsing_ros.singularities.isolated_points import RESIDUAL_TOLERANCE, ComplexArray, solve_ten_points
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.surfaces import Surface
from plsing_ros.singularities.transversals import TransversalAnalysis

# Size of the perturbation of directions and points, scene coordinates: from generic to numerically zero, on a spiral
# in the complex plane. On a straight way real points would meet and become complex, where no path can be followed.
_FIRST = 1e-2
_LAST = 7e-10 * np.exp(9j)
# Steps on this way; the next number for approaches that lost a path.
_STEPS = (18, 36)
_APPROACHES = 3
_SPARE = 9
# |A(h) k| of unit vectors up to which a path is followed, and
_FOLLOWED = 1e-7
# that above which a path was lost.
_LOST = 1e-8
# Distance to a line or inverse distance, a third before the end, that is too small to be that of a path going there.
_CAPTURED = 1e-14

# A path that comes this near to a line, a transversal, or infinity (inverse distance) has gone there.
MERGED = 1e-6
_MERGED_MULTIPLE = 1e-4
# ... or this near, if it is still getting nearer by _APPROACHING over the last third of the steps.
_NEAR = 1e-2
_APPROACHING = 0.3

# Inverse condition number of the equations' Jacobian above which a solution is isolated and simple.
_REGULAR = 1e-7
# Limits nearer to each other than this (relative) are the same; those of a multiple point spread by a root of the
# perturbation.
_SAME = 1e-6
_SAME_MULTIPLE = 2e-3
# Imaginary part, relative to the distance from the scene's centre, up to which a simple limit is real.
_REAL = 1e-9


@dataclass(frozen=True, eq=False)
class Limits:
    """What became of the ten points.

    Attributes:
        center: The isolated ones, scene coordinates, shape (k, 3), each once.
        real: Which of them are real, shape (k,).
        residual: Independent residuals, shape (k,).
        multiplicity: How many of the ten points merged there, shape (k,).
        at_infinity: How many of the ten left for infinity.
        on_lines: How many merged with observed lines.
        on_transversals: How many merged with transversals or surfaces filled with them.
        moving: How many have a limit that depends on the approach: the singular set contains a curve or surface there.
        unresolved: How many are none of these.
        tangent_dimension: The largest dimension of the singular set at the moving limits; 0 if there are none.
    """

    center: ComplexArray
    real: BoolArray
    residual: Array
    multiplicity: npt.NDArray[np.intp]
    at_infinity: int
    on_lines: int
    on_transversals: int
    moving: int
    unresolved: int
    tangent_dimension: int


def limits_of_ten_points(frame: SceneFrame, analysis: TransversalAnalysis, surfaces: tuple[Surface, ...]) -> Limits:
    """Return what becomes of the ten points of generic scenes that tend to a scene of four lines.

    Args:
        frame: The scene.
        analysis: Its transversals.
        surfaces: The surfaces filled with transversals.
    """
    h, k, earlier = _follow(frame)
    tensor = bilinear_tensor(frame.direction[np.newaxis], frame.point[np.newaxis])
    scene = np.zeros(len(h), dtype=np.intp)
    polished, motion = newton(tensor, scene, h, k)
    jacobian = jacobians(tensor, scene, polished, motion)
    singular_values = np.linalg.svd(jacobian, compute_uv=False)
    regular = singular_values[:, -1] > _REGULAR * singular_values[:, 0]
    moved = 1.0 - np.abs(np.einsum("ij,ij->i", polished, h.conj()))
    regular &= moved < 1e-4
    h = np.where(regular[:, np.newaxis], polished, h)
    fate = _Fate(frame, analysis, surfaces)
    infinite = fate.at_infinity(h, earlier, regular)
    on_line = ~infinite & fate.on_lines(h, earlier)
    on_transversal = ~infinite & ~on_line & fate.on_transversals(h, earlier)
    open_: BoolArray = ~(infinite | on_line | on_transversal)
    center = np.full((len(h), 3), np.nan + 0j)
    rows = np.flatnonzero(open_)
    center[rows] = h[rows, 1:] / h[rows, :1]
    approach = np.repeat(np.arange(_APPROACHES), 10)
    groups, alone = _group(center, regular, rows, approach)
    ends = [_end(frame, center[g], polished[g], bool(regular[g[0]])) for g in groups]
    found = np.array(ends, dtype=complex).reshape(-1, 3)
    real: BoolArray = np.abs(found.imag).max(axis=1, initial=0.0) == 0.0
    residual = singularity_residuals(frame.point, frame.direction, found)
    good = np.flatnonzero(residual <= RESIDUAL_TOLERANCE)
    moving = [i for i in alone if _is_singular(frame, center[i])]
    # The counts of one approach, so that they add up to ten: of the one that saw most of the isolated points.
    seen = [i for row in good for i in groups[row]]
    counted = max(range(_APPROACHES), key=lambda a: (sum(approach[i] == a for i in seen), -a))
    own = approach == counted
    fates = [int((mask & own).sum()) for mask in (infinite, on_line, on_transversal)]
    spread = sum(int(own[i]) for i in moving)
    multiplicity = np.array([max(1, sum(int(own[i]) for i in groups[row])) for row in good], dtype=np.intp)
    return Limits(
        center=found[good],
        real=real[good],
        residual=residual[good],
        multiplicity=multiplicity,
        at_infinity=fates[0],
        on_lines=fates[1],
        on_transversals=fates[2],
        moving=spread if spread or not moving else 1,
        unresolved=max(0, 10 - int(multiplicity.sum()) - sum(fates) - spread),
        tangent_dimension=_tangent_dimension(jacobian[moving]),
    )


def _end(frame: SceneFrame, center: ComplexArray, polished: npt.NDArray[Any], simple: bool) -> ComplexArray:
    """Return the best of the limits in one group, without imaginary part if it is real, shape (3,)."""
    # At a multiple point the mean of what came near from several sides, or Newton's slow convergence, is better than
    # any single one.
    candidates = center.mean(axis=0, keepdims=True)
    if not simple:
        candidates = np.concatenate([candidates, polished[:, 1:] / polished[:, :1]])
    size = 1.0 + np.abs(candidates).max(axis=1)
    real = np.abs(candidates.imag).max(axis=1) <= (_REAL if simple else _SAME_MULTIPLE) * size
    candidates[real] = candidates[real].real
    if len(candidates) == 1:
        return np.asarray(candidates[0])
    return np.asarray(candidates[singularity_residuals(frame.point, frame.direction, candidates).argmin()])


def _is_singular(frame: SceneFrame, center: ComplexArray) -> bool:
    """Return whether a limit that is known to the last perturbation only is a singular centre of the scene itself."""
    residual = singularity_residuals(frame.point, frame.direction, center[np.newaxis])
    return bool(residual[0] <= 1e3 * abs(_LAST))


def _follow(frame: SceneFrame) -> tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]:
    """Return centres and motions of all approaches near the end of the path, and the centres some steps before."""
    rng = np.random.default_rng(20210517)
    turn, shift = rng.normal(size=(2, _SPARE, 4, 3))
    start = solve_ten_points(*_neighbours(frame, turn, shift, _FIRST))
    order = np.argsort(~start.complete, kind="stable")
    found: list[tuple[int, npt.NDArray[Any]]] = []
    # Where a path of one approach is lost, a spare one takes its place, in smaller steps.
    for steps in _STEPS:
        missing = _APPROACHES - sum(lost == 0 for lost, _ in found)
        which, order = order[:missing], order[missing:]
        if len(which) == 0:
            break
        paths, lost = _follow_some(frame, turn[which], shift[which], start.center[which], steps)
        found += [(int(lost[i]), paths[10 * i : 10 * i + 10]) for i in range(len(which))]
    best = np.concatenate([paths for _, paths in sorted(found, key=lambda each: each[0])[:_APPROACHES]])
    return best[:, :4], best[:, 4:10], best[:, 10:]


def _follow_some(
    frame: SceneFrame, turn: Array, shift: Array, center: ComplexArray, steps: int
) -> tuple[npt.NDArray[Any], npt.NDArray[np.intp]]:
    """Return rows (h, k, earlier h) of the ends of the ten paths of some approaches, and how many of each were lost."""
    ratio = (_LAST / _FIRST) ** (1.0 / steps)
    scene = np.repeat(np.arange(len(turn)), 10)
    flat = np.nan_to_num(center.reshape(-1, 3))
    h = np.concatenate([np.ones((len(flat), 1)), flat], axis=1)
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    tensor = bilinear_tensor(*_neighbours(frame, turn, shift, _FIRST))
    k = np.linalg.svd(np.einsum("ka,kaij->kij", h, tensor[scene]))[2][:, -1].conj()
    history = [(h, k)]
    for step in range(1, steps + 1):
        direction, point = _neighbours(frame, turn, shift, _FIRST * ratio**step)
        tensor = bilinear_tensor(direction, point)
        before = history[-2] if len(history) > 1 else (h, k)
        # Along the chord of the last step, which the ratio of the sizes shortens.
        h, k = newton(tensor, scene, h + ratio * (h - before[0]), k + ratio * (k - before[1]), _FOLLOWED)
        history.append((h, k))
        if step == steps - steps // 3:
            # The equations have other solutions than the ten: at infinity, and on the lines. A path that ends there
            # gets there at some rate of the perturbation; one that is there already was attracted by such a solution.
            to_lines = _offsets(direction[scene], cross(point, direction)[scene], h)
            captured = np.minimum(np.abs(h[:, 0]), to_lines) < _CAPTURED
    value = np.linalg.norm(np.einsum("ka,kaij,kj->ki", h, tensor[scene], k, optimize=True), axis=1)
    lost = captured | (value > _LOST)
    earlier = history[-1 - steps // 3][0]
    return np.concatenate([h, k, earlier], axis=1), lost.reshape(-1, 10).sum(axis=1)


def _offsets(direction: npt.NDArray[Any], moment: npt.NDArray[Any], h: npt.NDArray[Any]) -> Array:
    """Return the distances of homogeneous centres (k, 4) to the nearest of lines (k or 1, n, 3), shape (k,).

    m C_0 - C x d for a unit h: the distance over that to the scene.
    """
    offset = h[:, np.newaxis, :1] * moment + cross(direction, h[:, np.newaxis, 1:])
    distance: Array = np.sqrt((offset.real**2 + offset.imag**2).sum(axis=2)).min(axis=1)
    return distance


def _neighbours(
    frame: SceneFrame, turn: Array, shift: Array, size: complex
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Return directions and closest points of scenes that differ from a scene by size times turn and shift."""
    direction = frame.direction + size * turn
    # Not the norm: without conjugation everything stays analytic in the size.
    direction /= np.sqrt((direction * direction).sum(axis=2, keepdims=True))
    point = frame.point + size * shift
    return direction, point - (point * direction).sum(axis=2, keepdims=True) * direction


class _Fate:
    """Where a path of homogeneous centres ends: near the end, or approaching it from some halvings before."""

    def __init__(self, frame: SceneFrame, analysis: TransversalAnalysis, surfaces: tuple[Surface, ...]) -> None:
        self._frame = frame
        self._lines = analysis.lines
        self._surfaces = surfaces

    def at_infinity(self, h: npt.NDArray[Any], earlier: npt.NDArray[Any], regular: BoolArray) -> BoolArray:
        # Where several have the same limit, rounding keeps them farther from it.
        blurred: BoolArray = ~regular & (np.abs(h[:, 0]) < _MERGED_MULTIPLE)
        return np.logical_or(blurred, _arrived(np.abs(h[:, 0]), np.abs(earlier[:, 0])))

    def on_lines(self, h: npt.NDArray[Any], earlier: npt.NDArray[Any]) -> BoolArray:
        direction, moment = self._frame.direction[np.newaxis], self._frame.moment[np.newaxis]
        return _arrived(_offsets(direction, moment, h), _offsets(direction, moment, earlier))

    def on_transversals(self, h: npt.NDArray[Any], earlier: npt.NDArray[Any]) -> BoolArray:
        reached = np.zeros(len(h), dtype=bool)
        for line in self._lines:
            reached |= _arrived(_incidence(line, h), _incidence(line, earlier))
        for surface in self._surfaces:
            now, before = (np.abs(np.einsum("abc,ka,kb,kc->k", surface.tensor, x, x, x)) for x in (h, earlier))
            reached |= _arrived(now, before)
        return reached


def _incidence(line: Array, h: npt.NDArray[Any]) -> Array:
    offset = h[:, :1] * line[3:] + cross(line[:3], h[:, 1:])
    distance: Array = np.sqrt((offset.real**2 + offset.imag**2).sum(axis=1))
    return distance


def _arrived(now: Array, before: Array) -> BoolArray:
    arrived: BoolArray = (now < MERGED) | ((now < _NEAR) & (now < _APPROACHING * before))
    return arrived


def _group(
    center: ComplexArray, regular: BoolArray, open_: npt.NDArray[np.intp], approach: npt.NDArray[np.intp]
) -> tuple[list[list[int]], list[int]]:
    """Return groups of equal limits that are isolated, and the limits that no other approach shares."""
    groups: list[list[int]] = []
    left = [int(i) for i in open_]
    while left:
        first = next((i for i in left if regular[i]), left[0])
        tolerance = (_SAME if regular[first] else _SAME_MULTIPLE) * (1.0 + float(np.abs(center[first]).max()))
        same = [i for i in left if float(np.abs(center[i] - center[first]).max()) <= tolerance]
        groups.append(same)
        left = [i for i in left if i not in same]
    isolated = [g for g in groups if regular[g[0]] or len({int(approach[i]) for i in g}) == _APPROACHES]
    alone = [i for g in groups for i in g if g not in isolated]
    return isolated, alone


def _tangent_dimension(jacobian: npt.NDArray[Any]) -> int:
    """Return the largest number of independent directions in which a centre can move, to first order."""
    largest = 0
    for one in jacobian:
        _, singular_values, right = np.linalg.svd(one)
        null = right[singular_values <= 1e-6 * singular_values[0]].conj()
        if len(null):
            centers = np.linalg.svd(null[:, :4], compute_uv=False)
            largest = max(largest, int((centers > 1e-3).sum()))
    return min(largest, 3)
