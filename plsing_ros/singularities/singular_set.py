"""singular_set(lines): everything at which a camera that observes n lines loses a motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plsing_ros import _core
from plsing_ros.arrays import Array, vector_text
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.pose import FARTHEST, checked_center
from plsing_ros.singularities.cases import Case, classify
from plsing_ros.singularities.curves import Curve
from plsing_ros.singularities.degenerate_scenes import distinct_rows, singular_everywhere_reason
from plsing_ros.singularities.four_lines import IsolatedPoints, IsolatedStatus, isolated_points_of_four, no_points
from plsing_ros.singularities.isolated_points import ComplexArray
from plsing_ros.singularities.loci import DistanceArrays, Kind, LocusDistance
from plsing_ros.singularities.many_lines import isolated_points_of_many
from plsing_ros.singularities.nearest_transversal import NearestTransversal, nearest_transversal
from plsing_ros.singularities.parallel_lines import screws_of_parallel_lines
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.surfaces import Surface, plane_surface, three_line_cubic, transversal_surfaces
from plsing_ros.singularities.transversals import (
    Transversal,
    TransversalAnalysis,
    TransversalFamily,
    analyze_transversals,
    finite_transversals,
    named_transversals,
    order_of_loci,
    places_along,
)
from plsing_ros.singularities.unobservable_motion import UnobservableMotion, unobservable_motions


@dataclass(frozen=True, eq=False)
class SingularSet:
    """The camera centres at which n lines lose a motion, in the frame of the lines.

    Attributes:
        lines: The lines.
        case: Row of the table of cases; str(case) is a sentence.
        family: What meets all lines.
        transversals: The single lines that meet all lines, closest to the scene's centre first.
        isolated_status: What is known about isolated points.
        isolated_points: The real ones, shape (k, 3) [m], closest to the scene's centre first.
        isolated_point_residuals: Independent residual of each real one (singularity_residuals), shape (k,).
        isolated_points_complex: All of them, the real ones first and in the same order, shape (m, 3).
        isolated_complex_residuals: Independent residual of each of those, shape (m,).
        surfaces: Planes, quadrics and cubics that are singular as a whole.
        curves: Straight lines and conics at which a screw is unobservable.
        singular_everywhere: Whether every camera centre is singular.
        note: What became of the isolated points of a general scene, or why every centre is singular; empty if there is
            nothing to add.
        frame: The scene coordinates everything was computed in.
    """

    lines: LineSet
    case: Case
    family: TransversalFamily
    transversals: tuple[Transversal, ...]
    isolated_status: IsolatedStatus
    isolated_points: Array
    isolated_point_residuals: Array
    isolated_points_complex: ComplexArray
    isolated_complex_residuals: Array
    surfaces: tuple[Surface, ...]
    curves: tuple[Curve, ...]
    singular_everywhere: bool
    note: str
    frame: SceneFrame

    @cached_property
    def description(self) -> str:
        """What was found, in words."""
        if self.singular_everywhere:
            return f"{self.case} Here {self.note}."
        parts = [str(self.case), f"Found: {self.family};"]
        if self.surfaces:
            parts.append(f"surfaces: {', '.join(surface.name for surface in self.surfaces)};")
        if self.curves:
            parts.append(f"curves: {', '.join(curve.name for curve in self.curves)};")
        if self.isolated_status is not IsolatedStatus.SURFACES:
            count = f"{len(self.isolated_points)} real of {len(self.isolated_points_complex)} isolated points"
            parts.append(f"{count} ({self.isolated_status}).")
        return " ".join([*parts, self.note]).rstrip(" ;")

    def __str__(self) -> str:
        rows = [self.description, ""]
        for transversal in self.transversals:
            rows.append(
                f"{transversal.name}: through {vector_text(transversal.point)} m along "
                f"{vector_text(transversal.direction)}, residual {transversal.residual:.1e}"
            )
        for number, (point, residual) in enumerate(
            zip(self.isolated_points.tolist(), self.isolated_point_residuals, strict=True), start=1
        ):
            rows.append(f"isolated point {number}: {vector_text(point)} m, residual {residual:.1e}")
        return "\n".join([*rows, *map(str, self.surfaces), *map(str, self.curves)])

    @cached_property
    def locus_names(self) -> tuple[str, ...]:
        """Names of the transversals, isolated points, observed lines, surfaces and curves, in this order."""
        names = [transversal.name for transversal in self.transversals]
        names += [f"isolated point {i}" for i in range(1, len(self.isolated_points) + 1)]
        names += [f"line {i}" for i in self.lines.ids]
        return (*names, *(surface.name for surface in self.surfaces), *(curve.name for curve in self.curves))

    @cached_property
    def locus_kinds(self) -> tuple[Kind, ...]:
        """What each of locus_names is."""
        kinds = [Kind.TRANSVERSAL] * len(self.transversals) + [Kind.ISOLATED_POINT] * len(self.isolated_points)
        kinds += [Kind.OBSERVED_LINE] * len(self.lines)
        return (*kinds, *(surface.kind for surface in self.surfaces), *(curve.kind for curve in self.curves))

    @cached_property
    def transversal_lines(self) -> tuple[Array, Array]:
        """A point [m] and the unit direction of each transversal, shapes (k, 3)."""
        single = self.transversals
        return np.reshape([t.point for t in single], (-1, 3)), np.reshape([t.direction for t in single], (-1, 3))

    @cached_property
    def lines_and_points(self) -> tuple[Array, Array]:
        """A point [m] and the unit direction of all that is no surface or curve, shapes (m, 3).

        In the order of locus_names; a point is a line whose direction is zero.
        """
        (point, direction), points, lines = self.transversal_lines, self.isolated_points, self.lines
        no_direction = np.zeros_like(points)
        return np.concatenate([point, points, lines.point]), np.concatenate([direction, no_direction, lines.direction])

    def distance_arrays(self, pose_or_center: Pose | npt.ArrayLike) -> DistanceArrays:
        """Return the distances to all parts of the set in the order of locus_names; for every control cycle.

        The order never changes for one set: transversals, isolated points, observed lines, surfaces, curves.

        Args:
            pose_or_center: The camera centre in the frame of the lines, shape (3,) [m], or T_world_camera.

        Raises:
            GeometryError: If the centre is not three finite numbers, or beyond 1e50 m.
        """
        center = checked_center("pose_or_center", pose_or_center)
        point, direction = self.lines_and_points
        closest, distance = _core.closest_points(point, direction, center)
        if self.surfaces or self.curves:
            near = [surface.first_order_closest_point(center) for surface in self.surfaces]
            near += [curve.closest_point(center) for curve in self.curves]
            closest = np.concatenate([closest, near])
            distance = np.concatenate([distance, np.linalg.norm(closest[len(distance) :] - center, axis=1)])
        return DistanceArrays(distance, closest)

    def distances(self, pose_or_center: Pose | npt.ArrayLike) -> list[LocusDistance]:
        """Return the distances to all parts of the set, nearest first; equal ones in the order of locus_names.

        Args:
            pose_or_center: The camera centre in the frame of the lines, shape (3,) [m], or T_world_camera.

        Raises:
            GeometryError: If the centre is not three finite numbers, or beyond 1e50 m.
        """
        arrays = self.distance_arrays(pose_or_center)
        distance = arrays.distance.tolist()
        return [
            LocusDistance(self.locus_kinds[i], self.locus_names[i], distance[i], arrays.closest_point[i])
            for i in sorted(range(len(distance)), key=distance.__getitem__)
        ]

    def nearest_locus(self, pose_or_center: Pose | npt.ArrayLike) -> LocusDistance | None:
        """Return the distance to the nearest part other than the observed lines, or None if there is none.

        Args:
            pose_or_center: The camera centre in the frame of the lines, shape (3,) [m], or T_world_camera.

        Raises:
            GeometryError: If the centre is not three finite numbers, or beyond 1e50 m.
        """
        rows = [i for i, kind in enumerate(self.locus_kinds) if kind is not Kind.OBSERVED_LINE]
        arrays = self.distance_arrays(pose_or_center)
        if not rows:
            return None
        i = min(rows, key=arrays.distance.__getitem__)
        return LocusDistance(
            self.locus_kinds[i], self.locus_names[i], float(arrays.distance[i]), arrays.closest_point[i]
        )

    @cached_property
    def nearest_transversal(self) -> NearestTransversal:
        """The line that comes nearest to meeting all lines, with how far it misses each."""
        return nearest_transversal(SceneFrame.of(self.lines))

    def unobservable_motions(self, pose_or_center: Pose | npt.ArrayLike) -> tuple[UnobservableMotion, ...]:
        """Return the motions that move no image line at a camera centre, see unobservable_motions."""
        return unobservable_motions(self.lines, pose_or_center)


def singular_set(lines: LineSet) -> SingularSet:
    """Return all singular camera centres of n lines.

    Any number of lines is answered; fewer than three, parallel or concurrent lines are singular everywhere, which is
    an answer, not an error.

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
    surfaces = transversal_surfaces(reduced, analysis)
    case = classify(reduced, analysis.family)
    curves: tuple[Curve, ...] = ()
    if len(rows) == 3:
        cubic = three_line_cubic(reduced)
        surfaces += (cubic,) if cubic is not None else ()
        isolated = no_points(IsolatedStatus.SURFACES)
    elif (screws := screws_of_parallel_lines(reduced, analysis)) is not None:
        isolated, curves = screws.isolated, screws.curves
        surfaces += tuple(
            plane_surface(reduced, screws.planes[i], f"singular plane {i + 1}") for i in range(len(screws.planes))
        )
    elif len(rows) == 4:
        isolated = isolated_points_of_four(reduced, analysis, surfaces)
    else:
        isolated = isolated_points_of_many(reduced, analysis)
    residual = singularity_residuals(reduced.point, reduced.direction, places_along(foot, direction))
    transversals = named_transversals(reduced, foot, direction, residual)
    return _assembled(lines, reduced, case, analysis, transversals, surfaces, curves, isolated)


def _assembled(
    lines: LineSet,
    frame: SceneFrame,
    case: Case,
    analysis: TransversalAnalysis,
    transversals: tuple[Transversal, ...],
    surfaces: tuple[Surface, ...],
    curves: tuple[Curve, ...],
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
    )
