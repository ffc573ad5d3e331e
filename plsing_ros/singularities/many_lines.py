# SPDX-License-Identifier: Apache-2.0
"""Where a screw is unobservable for five or more lines, none parallel: where a four-line subset says that it may be."""

from __future__ import annotations

from itertools import combinations, islice

import numpy as np
import numpy.typing as npt
import scipy.linalg

from plsing_ros.arrays import Array, cross
from plsing_ros.singularities.bilinear_system import bilinear_tensor, newton
from plsing_ros.singularities.curves import Curve
from plsing_ros.singularities.degenerate_scenes import distinct_rows, singular_everywhere_reason
from plsing_ros.singularities.four_lines import IsolatedPoints, IsolatedStatus, is_generic, no_points
from plsing_ros.singularities.isolated_points import RESIDUAL_TOLERANCE, ComplexArray, solve_ten_points
from plsing_ros.singularities.loci import Kind
from plsing_ros.singularities.parallel_lines import ScrewLoci, is_on_known_locus
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.screw_curve import ScrewCurve
from plsing_ros.singularities.special_loci import NO_PLANES, infinite_loci, is_on_curve, screws_of_four_lines
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
# Two points nearer than this are one.
_SAME = 1e-6
_ON_LOCUS = 1e-8
# Scene lengths from the scene's centre beyond which a candidate is an eigenvalue at infinity, blurred by rounding.
_FARTHEST = 1e7
# Places along a curve of a subset from which points that are singular for all lines are looked for: the lowest of the
# residual, if below.
_LOWEST, _LOW = 12, 0.03
# Scene lengths from the scene's centre up to which they are.
_DRAWN = 30.0


def screws_of_many_lines(frame: SceneFrame, analysis: TransversalAnalysis) -> ScrewLoci:
    """Return where a screw is unobservable for n >= 5 distinct lines, no two parallel, not singular everywhere.

    Leaving lines out can only lower the rank, so a singular centre of all lines is singular for each four of them: it
    is one of their isolated points, on one of their transversals or on a curve of theirs. Along a transversal or
    another straight line xi is a matrix linear in the position, whose singular positions are generalised eigenvalues.

    Args:
        frame: The scene.
        analysis: Its transversals.

    Source: new, docs/theory.md section "Five and more lines".
    """
    rows = best_subsets(frame)
    ten = solve_ten_points(frame.direction[rows], frame.point[rows])
    generic = is_generic(ten)
    # Four lines that are singular at points and transversals only leave no curve.
    infinite = (
        ScrewLoci(no_points(IsolatedStatus.NONE), (), NO_PLANES) if generic.any() else infinite_loci(frame, analysis)
    )
    for i in np.argsort(-np.where(generic, ten.rank_margin, 0.0), kind="stable"):
        candidates = _candidates(frame, analysis, infinite, rows[i].tolist(), ten.center[i] if generic[i] else None)
        if candidates is not None:
            points = _surviving(frame, analysis, infinite, candidates)
            return ScrewLoci(points, infinite.curves, infinite.planes)
    points = no_points(
        IsolatedStatus.UNRESOLVED,
        f"None of the {len(rows)} sets of four lines that were tried is singular at points and curves only, so that "
        "isolated points of all lines cannot be excluded.",
    )
    return ScrewLoci(points, infinite.curves, infinite.planes)


def best_subsets(frame: SceneFrame) -> npt.NDArray[np.intp]:
    """Return four-line subsets, those whose lines are least dependent first, shape (at most _SUBSETS, 4)."""
    subsets = np.array(list(islice(combinations(range(len(frame.direction)), 4), _CONSIDERED)))
    independence = np.linalg.svd(frame.plucker_matrix[subsets], compute_uv=False)[:, -1]
    # Three independent directions, or the perpendiculars of the lines are dependent for too many cameras.
    independence *= np.linalg.svd(frame.direction[subsets], compute_uv=False)[:, -1]
    return subsets[np.argsort(-independence, kind="stable")[:_SUBSETS]]


def _candidates(
    frame: SceneFrame,
    analysis: TransversalAnalysis,
    infinite: ScrewLoci,
    subset: list[int],
    ten: ComplexArray | None,
) -> ComplexArray | None:
    """Return points near which the singular ones of all lines are; None if the subset leaves a surface."""
    four = SceneFrame(frame.center, frame.length, False, frame.direction[subset], frame.point[subset])
    transversals = analyze_transversals(four)
    if transversals.family is TransversalFamily.EVERYWHERE:
        return None
    # A quadric or plane that is singular for all lines anyway does no harm.
    if transversals.family is TransversalFamily.REGULUS is not analysis.family:
        return None
    known = np.concatenate([analysis.planes, infinite.planes])
    if not all(_is_among(plane, known) for plane in transversals.planes):
        return None
    along = [_singular_along(frame, line) for line in transversals.lines if np.linalg.norm(line[:3]) > _ON_LOCUS]
    if ten is None:
        own = SceneFrame.recentered(four)
        distinct = len(distinct_rows(own))
        if distinct < 4 or singular_everywhere_reason(own, distinct) is not None:
            return None
        found = screws_of_four_lines(four, transversals, transversal_surfaces(four, transversals))
        listed = len(found.curves) or len(found.planes)
        if found.isolated.status is IsolatedStatus.UNRESOLVED or not all(
            _is_among(plane, known) for plane in found.planes
        ):
            return None
        if found.isolated.status is IsolatedStatus.POSITIVE_DIMENSIONAL and not listed:
            return None
        ten = found.isolated.center
        along += [_lowest_along(frame, curve) for curve in found.curves]
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


def _is_among(plane: Array, known: Array) -> bool:
    return any(min(np.abs(plane - own).max(), np.abs(plane + own).max()) <= _ON_LOCUS for own in known)


def _lowest_along(frame: SceneFrame, curve: Curve | ScrewCurve) -> ComplexArray:
    """Return places on a curve of four lines where all lines may be singular, shape (k, 3)."""
    if isinstance(curve, Curve) and curve.kind is Kind.STRAIGHT_LINE:
        direction, foot = curve.flat.axes[0], curve.flat.origin
        return _singular_along(frame, np.concatenate([direction, cross(foot, direction)]))
    points = curve.polyline(frame.center, _DRAWN * frame.length)
    points = frame.to_scene(points[np.isfinite(points).all(axis=1)])
    residual = singularity_residuals(frame.point, frame.direction, points)
    lower = (residual <= np.roll(residual, 1)) & (residual <= np.roll(residual, -1)) & (residual <= _LOW)
    rows = np.flatnonzero(lower)
    lowest: ComplexArray = points[rows[np.argsort(residual[rows])][:_LOWEST]].astype(complex)
    return lowest


def _surviving(
    frame: SceneFrame, analysis: TransversalAnalysis, infinite: ScrewLoci, candidates: ComplexArray
) -> IsolatedPoints:
    near = singularity_residuals(frame.point, frame.direction, candidates) <= _LOW
    near &= np.abs(candidates).max(axis=1, initial=0.0) < _FARTHEST
    start = candidates[near]
    listed = len(infinite.curves) or len(infinite.planes)
    nothing = no_points(IsolatedStatus.POSITIVE_DIMENSIONAL if listed else IsolatedStatus.NONE)
    if len(start) == 0:
        return nothing
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
        repeated = any(np.abs(center[i] - center[j]).max() <= _SAME for j in kept)
        if residual[i] <= RESIDUAL_TOLERANCE and not repeated and not _is_listed(frame, analysis, infinite, center[i]):
            kept.append(int(i))
    if not kept:
        return nothing
    found = center[kept]
    real = np.abs(found.imag).max(axis=1) <= _ON_LOCUS * (1.0 + np.abs(found).max(axis=1))
    found[real] = found[real].real
    status = IsolatedStatus.POSITIVE_DIMENSIONAL if listed else IsolatedStatus.FINITE
    return IsolatedPoints(status, "", found, real, residual[kept])


def _is_listed(frame: SceneFrame, analysis: TransversalAnalysis, infinite: ScrewLoci, center: ComplexArray) -> bool:
    """Return whether a point is on an observed line, a transversal, a plane or a curve that is known."""
    size = _ON_LOCUS * (1.0 + float(np.abs(center).max()))
    if is_on_known_locus(frame, analysis, center[np.newaxis]):
        return True
    if any(abs(complex(plane[:3] @ center + plane[3])) <= size for plane in infinite.planes):
        return True
    return bool(np.abs(center.imag).max() <= size) and is_on_curve(frame, infinite.curves, center.real)
