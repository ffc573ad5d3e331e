# SPDX-License-Identifier: Apache-2.0
"""singular_set(lines): everything at which a camera that observes n lines loses a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plsing_ros.arrays import Array, vector_text
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet
from plsing_ros.geometry.pose import FARTHEST
from plsing_ros.singularities.cases import Case, classify
from plsing_ros.singularities.curves import Curve
from plsing_ros.singularities.degenerate_scenes import distinct_rows, singular_everywhere_reason
from plsing_ros.singularities.four_lines import IsolatedPoints, IsolatedStatus, no_points
from plsing_ros.singularities.ideal_scene import ideal_scene
from plsing_ros.singularities.isolated_points import ComplexArray
from plsing_ros.singularities.many_lines import screws_of_many_lines
from plsing_ros.singularities.near_transversals import near_transversals
from plsing_ros.singularities.parallel_lines import screws_of_parallel_lines
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.screw_curve import ScrewCurve
from plsing_ros.singularities.singular_centers import SingularSet
from plsing_ros.singularities.special_loci import screws_of_four_lines
from plsing_ros.singularities.surfaces import Surface, plane_surface, three_line_cubic, transversal_surfaces
from plsing_ros.singularities.transversals import (
    Transversal,
    TransversalAnalysis,
    TransversalFamily,
    analyze_transversals,
    finite_transversals,
    named_transversals,
    observed_rows,
    order_of_loci,
    places_along,
)

# Scene lengths: a transversal of measured lines that far away is that of lines that are nearly parallel, and one that
# near to a locus of the exact lines is that locus.
_FAR, _BESIDE = 10.0, 0.1


def singular_set(lines: LineSet) -> SingularSet:
    """Return all singular camera centres of n lines, exactly or within the tolerances of the lines.

    Any number of lines is answered; fewer than three, parallel or concurrent lines are singular everywhere, which is
    an answer, not an error. For lines with standard deviations the set is that of the nearest scene with the parallels,
    right angles, planes and cylinders that they have within these (ideal_scene), and lines that meet five or more lines
    within them are transversals, too (near_transversals).

    Args:
        lines: n >= 1 lines in any frame that is fixed to them.

    Raises:
        GeometryError: If a line is farther than 1e50 m from the origin, so that products of lengths overflow.

    Source: sections "Singularities in P4L" and "P5L"; the isolated points are new (docs/theory.md).
    """
    largest = np.abs(lines.moment).max()
    if not largest < FARTHEST:
        row = int(np.abs(lines.moment).max(axis=1).argmax())
        raise GeometryError(
            f"line {lines.ids[row]}: its moment is {largest:.3g} m; up to {FARTHEST:.0e} m can be computed with"
        )
    scene = ideal_scene(lines)
    singular = _singular_set_of(scene.lines)
    if lines.exact:
        return singular
    frame = SceneFrame.of(lines)
    known = [replace(each, exactness=scene.exactness) for each in singular.transversals]
    if len(lines) > 4 and not singular.singular_everywhere:
        known += [each for each in near_transversals(lines) if not _is_known(each, singular)]
    points = np.reshape([each.point for each in known], (-1, 3))
    directions = np.reshape([each.direction for each in known], (-1, 3))
    places = places_along(frame.to_scene(points), directions)
    residual = singularity_residuals(frame.point, frame.direction, places).reshape(-1, 2)
    order = order_of_loci(singular.frame.to_scene(points), directions)
    transversals = [
        replace(known[i], name=f"transversal {rank}", residual=float(residual[i].max()))
        for rank, i in enumerate(order, start=1)
    ]
    return replace(
        singular,
        lines=lines,
        transversals=tuple(transversals),
        exactness=scene.exactness,
        isolated_point_residuals=_residuals(frame, singular.isolated_points),
        isolated_complex_residuals=_residuals(frame, singular.isolated_points_complex),
    )


def _residuals(frame: SceneFrame, points: Array | ComplexArray) -> Array:
    return singularity_residuals(frame.point, frame.direction, (points - frame.center) / frame.length)


def _is_known(line: Transversal, singular: SingularSet) -> bool:
    """Return whether a line is far away, or its part in the scene near one observed line or locus of a singular set."""
    frame = singular.frame
    if np.linalg.norm(line.point - frame.center) > _FAR * frame.length:
        return True
    places = line.point + frame.length * np.array([[-1.0], [0.0], [1.0]]) * line.direction
    distances = np.array([singular.distance_arrays(place).distance for place in places])
    return bool((distances.max(axis=0) <= _BESIDE * frame.length).any())


def _singular_set_of(lines: LineSet) -> SingularSet:
    """Return the singular set of lines that are taken as exact."""
    frame = SceneFrame.of(lines)
    rows = distinct_rows(frame)
    reason = singular_everywhere_reason(frame, len(rows))
    if reason is not None:
        return _assembled(
            lines,
            frame,
            Case.SINGULAR_EVERYWHERE,
            TransversalAnalysis(TransversalFamily.EVERYWHERE, np.zeros((0, 6)), np.zeros((0, 4))),
            (),
            (),
            (),
            no_points(IsolatedStatus.EVERYWHERE, reason),
        )
    reduced = frame if len(rows) == len(lines) else SceneFrame.of(lines.select(rows))
    analysis = analyze_transversals(reduced)
    foot, direction = finite_transversals(analysis)
    observed = observed_rows(reduced, foot, direction)
    at_infinity = len(analysis.lines) > len(foot)
    if observed:
        listed = np.array(observed) < 0
        foot, direction = foot[listed], direction[listed]
    surfaces = transversal_surfaces(reduced, analysis)
    case = classify(reduced, analysis.family)
    curves: tuple[Curve | ScrewCurve, ...] = ()
    if len(rows) == 3:
        cubic = three_line_cubic(reduced)
        surfaces += (cubic,) if cubic is not None else ()
        isolated = no_points(IsolatedStatus.SURFACES)
    else:
        screws = screws_of_parallel_lines(reduced, analysis)
        if screws is None and len(rows) == 4:
            screws = screws_of_four_lines(reduced, analysis, surfaces)
        elif screws is None:
            screws = screws_of_many_lines(reduced, analysis)
        isolated, curves = screws.isolated, screws.curves
        surfaces += tuple(
            plane_surface(reduced, screws.planes[i], f"singular plane {i + 1}") for i in range(len(screws.planes))
        )
    residual = singularity_residuals(reduced.point, reduced.direction, places_along(foot, direction))
    transversals = named_transversals(reduced, foot, direction, residual)
    if observed or at_infinity:
        words = _words_on_transversals(lines, at_infinity, [lines.ids[rows[row]] for row in observed if row >= 0])
        isolated = replace(isolated, note=" ".join([isolated.note, *words]).strip())
    return _assembled(lines, reduced, case, analysis, transversals, surfaces, curves, isolated)


def _words_on_transversals(lines: LineSet, at_infinity: bool, observed: list[int]) -> list[str]:
    """Return sentences on the transversals that are not listed: at infinity, and observed lines (ids) themselves."""
    words = []
    if at_infinity:
        normal = np.linalg.svd(lines.direction)[2][2]
        normal = normal * np.sign(normal[np.abs(normal).argmax()])
        words.append(
            "One line that meets all of them is at infinity, where no camera gets: they are parallel to the planes "
            f"across {vector_text(normal)}."
        )
    return words + [f"Line {number} itself meets all others." for number in observed]


def _assembled(
    lines: LineSet,
    frame: SceneFrame,
    case: Case,
    analysis: TransversalAnalysis,
    transversals: tuple[Transversal, ...],
    surfaces: tuple[Surface, ...],
    curves: tuple[Curve | ScrewCurve, ...],
    isolated: IsolatedPoints,
) -> SingularSet:
    """Name and order everything that was found, and turn scene coordinates into those of the lines."""
    flags = isolated.real.tolist()
    rows = [i for i, real in enumerate(flags) if real]
    order = [rows[i] for i in order_of_loci(isolated.center[rows].real)]
    order += [i for i, real in enumerate(flags) if not real]
    points: ComplexArray = isolated.center[order] * frame.length + frame.center
    residuals = isolated.residual[order]
    return SingularSet(
        lines=lines,
        case=case,
        family=analysis.family,
        transversals=transversals,
        isolated_status=isolated.status,
        isolated_points=points[: len(rows)].real.copy(),
        isolated_point_residuals=residuals[: len(rows)],
        isolated_points_complex=points,
        isolated_complex_residuals=residuals,
        surfaces=surfaces,
        curves=curves,
        singular_everywhere=case is Case.SINGULAR_EVERYWHERE,
        note=isolated.note,
        frame=frame,
        exact_lines=lines,
    )
