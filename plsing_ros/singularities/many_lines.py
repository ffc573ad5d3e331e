# SPDX-License-Identifier: Apache-2.0
"""Isolated points of five or more lines, none parallel: those of a four-line subset that all lines keep singular."""

from __future__ import annotations

from itertools import combinations, islice

import numpy as np
import numpy.typing as npt
import scipy.linalg

from plsing_ros.arrays import Array, cross
from plsing_ros.singularities.bilinear_system import bilinear_tensor, newton
from plsing_ros.singularities.degenerate_scenes import distinct_rows, singular_everywhere_reason
from plsing_ros.singularities.four_lines import (
    IsolatedPoints,
    IsolatedStatus,
    is_generic,
    isolated_points_of_four,
    no_points,
)
from plsing_ros.singularities.isolated_points import RESIDUAL_TOLERANCE, ComplexArray, solve_ten_points
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.surfaces import transversal_surfaces
from plsing_ros.singularities.transversals import (
    TransversalAnalysis,
    TransversalFamily,
    analyze_transversals,
)

# Four-line subsets ranked by how independent their lines are, and
_CONSIDERED = 1000
# those tried; one that is understood completely is enough, and box-like scenes have some that are not.
_SUBSETS = 15
# Candidates start from a subset's points, which differ from those of all lines by rounding only.
_CANDIDATE = 1e-6
_ON_LOCUS = 1e-8
# Scene lengths from the scene's centre beyond which a candidate is an eigenvalue at infinity, blurred by rounding.
_FARTHEST = 1e7


def isolated_points_of_many(frame: SceneFrame, analysis: TransversalAnalysis) -> IsolatedPoints:
    """Return the isolated points of n >= 5 distinct lines that are not singular everywhere.

    Leaving lines out can only lower the rank, so a singular centre of all lines is singular for each four of them: it
    is one of their isolated points or on one of their transversals. Along a transversal xi is a matrix linear in the
    position, whose singular positions are generalised eigenvalues.

    Args:
        frame: The scene.
        analysis: Its transversals.

    Source: new, docs/theory.md section "Five and more lines".
    """
    rows = best_subsets(frame)
    ten = solve_ten_points(frame.direction[rows], frame.point[rows])
    generic = is_generic(ten)
    for i in np.argsort(-np.where(generic, ten.rank_margin, 0.0), kind="stable"):
        candidates = _candidates(frame, analysis, rows[i].tolist(), ten.center[i] if generic[i] else None)
        if candidates is not None:
            return _surviving(frame, analysis, candidates)
    return no_points(
        IsolatedStatus.UNRESOLVED,
        f"None of the {len(rows)} sets of four lines that were tried is singular at points and lines only, so that "
        "isolated points of all lines cannot be excluded.",
    )


def best_subsets(frame: SceneFrame) -> npt.NDArray[np.intp]:
    """Return four-line subsets, those whose lines are least dependent first, shape (at most _SUBSETS, 4)."""
    subsets = np.array(list(islice(combinations(range(len(frame.direction)), 4), _CONSIDERED)))
    independence = np.linalg.svd(frame.plucker_matrix[subsets], compute_uv=False)[:, -1]
    # Three independent directions, or the perpendiculars of the lines are dependent for too many cameras.
    independence *= np.linalg.svd(frame.direction[subsets], compute_uv=False)[:, -1]
    return subsets[np.argsort(-independence, kind="stable")[:_SUBSETS]]


def _candidates(
    frame: SceneFrame, analysis: TransversalAnalysis, subset: list[int], ten: ComplexArray | None
) -> ComplexArray | None:
    """Return points among which the singular ones of all lines are; None if the subset leaves more than points."""
    four = SceneFrame(frame.center, frame.length, False, frame.direction[subset], frame.point[subset])
    transversals = analyze_transversals(four)
    if transversals.family in (TransversalFamily.REGULUS, TransversalFamily.EVERYWHERE):
        return None
    # A plane that is singular for all lines anyway does no harm.
    for plane in transversals.planes:
        if not any(min(np.abs(plane - own).max(), np.abs(plane + own).max()) <= _ON_LOCUS for own in analysis.planes):
            return None
    if ten is None:
        own = SceneFrame.recentered(four)
        distinct = len(distinct_rows(own))
        if distinct < 4 or singular_everywhere_reason(own, distinct) is not None:
            return None
        found = isolated_points_of_four(four, transversals, transversal_surfaces(four, transversals))
        if found.status not in (IsolatedStatus.FINITE, IsolatedStatus.NONE):
            return None
        ten = found.center
    along = [_singular_along(frame, line) for line in transversals.lines if np.linalg.norm(line[:3]) > _ON_LOCUS]
    candidates: ComplexArray = np.concatenate([ten, *along])
    return candidates


def _singular_along(frame: SceneFrame, line: Array) -> ComplexArray:
    """Return the points of a line (d, m) at which a square compression of xi is singular, shape (k, 3)."""
    length = float(np.linalg.norm(line[:3]))
    direction, foot = line[:3] / length, cross(line[:3], line[3:]) / length**2
    tensor = bilinear_tensor(frame.direction[np.newaxis], frame.point[np.newaxis])[0]
    constant = np.tensordot(np.array([1.0, *foot]), tensor, axes=1)
    linear = np.tensordot(np.array([0.0, *direction]), tensor, axes=1)
    # Any six generic combinations of the rows lose rank wherever all rows do, and at some more places, which the
    # residual of the full matrix rejects.
    mix = np.random.default_rng(6).normal(size=(6, len(constant)))
    position = scipy.linalg.eigvals(mix @ constant, -(mix @ linear))
    position = position[np.isfinite(position)]
    points: ComplexArray = foot + position[:, np.newaxis] * direction
    return points


def _surviving(frame: SceneFrame, analysis: TransversalAnalysis, candidates: ComplexArray) -> IsolatedPoints:
    near = singularity_residuals(frame.point, frame.direction, candidates) <= _CANDIDATE
    near &= np.abs(candidates).max(axis=1, initial=0.0) < _FARTHEST
    start = candidates[near]
    if len(start) == 0:
        return no_points(IsolatedStatus.NONE)
    tensor = bilinear_tensor(frame.direction[np.newaxis], frame.point[np.newaxis])
    h = np.concatenate([np.ones((len(start), 1)), start], axis=1)
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    k = np.linalg.svd(np.einsum("ka,aij->kij", h, tensor[0]))[2][:, -1].conj()
    polished, _ = newton(tensor, np.zeros(len(h), dtype=np.intp), h, k)
    polished = polished[np.abs(polished[:, 0]) > 1.0 / _FARTHEST]
    center = polished[:, 1:] / polished[:, :1]
    residual = singularity_residuals(frame.point, frame.direction, center)
    kept: list[int] = []
    for i in np.argsort(residual):
        repeated = any(np.abs(center[i] - center[j]).max() <= _CANDIDATE for j in kept)
        if residual[i] <= RESIDUAL_TOLERANCE and not repeated and not _on_known_locus(frame, analysis, center[i]):
            kept.append(int(i))
    if not kept:
        return no_points(IsolatedStatus.NONE)
    found = center[kept]
    real = np.abs(found.imag).max(axis=1) <= _ON_LOCUS * (1.0 + np.abs(found).max(axis=1))
    found[real] = found[real].real
    return IsolatedPoints(IsolatedStatus.FINITE, "", found, real, residual[kept])


def _on_known_locus(frame: SceneFrame, analysis: TransversalAnalysis, center: ComplexArray) -> bool:
    lines = [np.concatenate([frame.direction, frame.moment], axis=1), analysis.lines]
    for line in np.concatenate(lines):
        if np.linalg.norm(line[3:] - np.cross(center, line[:3])) <= _ON_LOCUS * (1.0 + np.linalg.norm(center)):
            return True
    return any(
        abs(complex(plane[:3] @ center + plane[3])) <= _ON_LOCUS * (1.0 + np.linalg.norm(center))
        for plane in analysis.planes
    )
