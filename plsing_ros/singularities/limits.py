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
from plsing_ros.singularities.isolated_points import RESIDUAL_TOLERANCE, ComplexArray, solve_ten_points
from plsing_ros.singularities.kernel_pencil import bilinear_tensor, jacobians, newton
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.surfaces import Surface
from plsing_ros.singularities.transversals import TransversalAnalysis

# Size of the perturbation of directions and points, scene coordinates: from generic to numerically zero.
_SIZES = 1e-2 * 0.5 ** np.arange(0, 24)
_APPROACHES = 3
_SPARE = 9

# A path that comes this near to a line, a transversal, or infinity (inverse distance) has gone there.
MERGED = 1e-6
# ... or this near, if it is still getting nearer by _APPROACHING over the last _LOOK_BACK halvings of the perturbation.
_NEAR = 1e-2
_LOOK_BACK = 8
_APPROACHING = 0.3

# Inverse condition number of the equations' Jacobian above which a solution is isolated and simple.
_REGULAR = 1e-9
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
    infinite = fate.at_infinity(h, earlier)
    on_line = ~infinite & fate.on_lines(h, earlier)
    on_transversal = ~infinite & ~on_line & fate.on_transversals(h, earlier)
    open_ = ~(infinite | on_line | on_transversal)
    center = np.full((len(h), 3), np.nan + 0j)
    center[open_] = h[open_, 1:] / h[open_, :1]
    approach = np.repeat(np.arange(_APPROACHES), 10)
    groups, alone = _group(center, regular, np.flatnonzero(open_), approach)
    found = np.array([center[g].mean(axis=0) for g in groups]).reshape(-1, 3)
    residual = singularity_residuals(frame.point, frame.direction, found)
    simple = np.array([regular[g[0]] for g in groups], dtype=bool)
    size = 1.0 + np.abs(found).max(axis=1, initial=0.0)
    real = np.abs(found.imag).max(axis=1, initial=0.0) <= np.where(simple, _REAL, _SAME_MULTIPLE) * size
    found[real] = found[real].real
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


def _is_singular(frame: SceneFrame, center: ComplexArray) -> bool:
    """Return whether a limit that is known to the last perturbation only is a singular centre of the scene itself."""
    residual = singularity_residuals(frame.point, frame.direction, center[np.newaxis])
    return bool(residual[0] <= 1e3 * float(_SIZES[-1]))


def _follow(frame: SceneFrame) -> tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]:
    """Return centres and motions of all approaches near the end of the path, and the centres some halvings before."""
    rng = np.random.default_rng(20210517)
    turn, shift = rng.normal(size=(2, _SPARE, 4, 3))

    def scenes_at(size: float, which: npt.NDArray[np.intp]) -> tuple[Array, Array]:
        direction = frame.direction + size * turn[which]
        direction /= np.linalg.norm(direction, axis=2, keepdims=True)
        point = frame.point + size * shift[which]
        return direction, point - (point * direction).sum(axis=2, keepdims=True) * direction

    every = np.arange(_SPARE)
    start = solve_ten_points(*scenes_at(float(_SIZES[0]), every))
    which = np.argsort(~start.complete, kind="stable")[:_APPROACHES]
    direction, point = scenes_at(float(_SIZES[0]), which)
    center = start.center[which].reshape(-1, 3)
    h = np.concatenate([np.ones((len(center), 1)), np.nan_to_num(center)], axis=1)
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    scene = np.repeat(np.arange(_APPROACHES), 10)
    a = np.einsum("ka,kaij->kij", h, bilinear_tensor(direction, point)[scene])
    k = np.linalg.svd(a)[2][:, -1].conj()
    history = []
    for size in _SIZES[1:]:
        tensor = bilinear_tensor(*scenes_at(float(size), which))
        h, k = newton(tensor, scene, h, k)
        history.append(h)
    return h, k, history[-1 - _LOOK_BACK]


class _Fate:
    """Where a path of homogeneous centres ends: near the end, or approaching it from some halvings before."""

    def __init__(self, frame: SceneFrame, analysis: TransversalAnalysis, surfaces: tuple[Surface, ...]) -> None:
        self._frame = frame
        self._lines = analysis.lines
        self._surfaces = surfaces

    def at_infinity(self, h: npt.NDArray[Any], earlier: npt.NDArray[Any]) -> BoolArray:
        return _arrived(np.abs(h[:, 0]), np.abs(earlier[:, 0]))

    def on_lines(self, h: npt.NDArray[Any], earlier: npt.NDArray[Any]) -> BoolArray:
        return _arrived(self._to_lines(h), self._to_lines(earlier))

    def on_transversals(self, h: npt.NDArray[Any], earlier: npt.NDArray[Any]) -> BoolArray:
        reached = np.zeros(len(h), dtype=bool)
        for line in self._lines:
            reached |= _arrived(_incidence(line, h), _incidence(line, earlier))
        for surface in self._surfaces:
            now, before = (np.abs(np.einsum("abc,ka,kb,kc->k", surface.tensor, x, x, x)) for x in (h, earlier))
            reached |= _arrived(now, before)
        return reached

    def _to_lines(self, h: npt.NDArray[Any]) -> Array:
        direction, moment = self._frame.direction, self._frame.moment
        # m C_0 - C x d of the homogeneous centre: its distance to the line over its distance to the scene.
        offset = h[:, np.newaxis, :1] * moment + cross(direction, h[:, np.newaxis, 1:])
        distance: Array = np.sqrt((offset.real**2 + offset.imag**2).sum(axis=2)).min(axis=1)
        return distance


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
