# SPDX-License-Identifier: Apache-2.0
"""singular_set(lines): everything at which a camera that observes n lines loses a motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
from plsing_ros.singularities.four_lines import IsolatedPoints, IsolatedStatus, no_points
from plsing_ros.singularities.ideal_scene import ideal_scene
from plsing_ros.singularities.isolated_points import ComplexArray
from plsing_ros.singularities.loci import DistanceArrays, Kind, LocusDistance
from plsing_ros.singularities.locus import Everywhere, Locus, Part, StraightPart
from plsing_ros.singularities.many_lines import screws_of_many_lines
from plsing_ros.singularities.near_transversals import near_transversals
from plsing_ros.singularities.nearest_transversal import NearestTransversal, nearest_transversal
from plsing_ros.singularities.parallel_lines import screws_of_parallel_lines
from plsing_ros.singularities.proximity import Proximity, normal_condition, proximity
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.screw_curve import ScrewCurve
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
from plsing_ros.singularities.unobservable_motion import UnobservableMotion, unobservable_motions

# Scene lengths: a transversal of measured lines that far away is that of lines that are nearly parallel, and one that
# near to a locus of the exact lines is that locus.
_FAR, _BESIDE = 10.0, 0.1


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
        curves: Straight lines, conics and other curves at which a screw is unobservable.
        singular_everywhere: Whether every camera centre is singular.
        note: What became of the isolated points of a general scene, or why every centre is singular; empty if there is
            nothing to add.
        frame: The scene coordinates everything was computed in.
        exact_lines: The lines that everything is exact for: lines themselves if they are known exactly, else the
            nearest ones with the structure that lines have within their tolerances (ideal_scene).
        exactness: By how many tolerances those differ from lines, root mean square over the relations between them.

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
    curves: tuple[Curve | ScrewCurve, ...]
    singular_everywhere: bool
    note: str
    frame: SceneFrame
    exact_lines: LineSet
    exactness: float = 0.0

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
        rows += [*map(str, self.surfaces), *map(str, self.curves)]
        if not self.lines.exact:
            rows += ["", *self._tolerance_text]
        return "\n".join(rows)

    @cached_property
    def _tolerance_text(self) -> list[str]:
        """What the tolerances of the lines have to do with it, a sentence and a row for each locus."""
        position, direction = self.lines.position_std.max(), self.lines.direction_std.max()
        known = f"with {1e3 * position:.3g} mm and {1e3 * direction:.3g} mrad"
        if self.singular_everywhere:
            return [f"{known} this scene is, as far as is known of its lines, singular at every camera centre"]
        if not self.loci:
            return [f"{known} no singular point, line or surface is known; z tells how near any camera is to one"]
        return [f"{known} this scene is, as far as is known of its lines, singular in:"] + [
            f"  {locus}" for locus in self.loci
        ]

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

    def proximity(
        self,
        pose_or_center: Pose | npt.ArrayLike,
        image_std: float = 1e-3,
        ids: tuple[int, ...] | None = None,
        covariances: Array | None = None,
    ) -> Proximity:
        """Return how near a camera is to a singular centre, whether or not a locus is known there; for every cycle.

        Args:
            pose_or_center: T_world_camera, or the camera centre, shape (3,) [m]; in the frame of the lines.
            image_std: Error of the image lines [rad] that the standard deviations of the pose are for.
            ids: Of the lines that the camera sees; None: all.
            covariances: Of angle and offset of each of these image lines (LineObservation.covariances), shape (n, 3),
                that the standard deviations of the pose are for in place of image_std; needs a pose.

        Raises:
            GeometryError: If the centre is not three finite numbers or beyond 1e50 m, image_std is not positive, or
                covariances come without a pose or in another shape.
        """
        lines = self.lines if ids is None or ids == self.lines.ids else self._with_ids(ids)
        return proximity(lines, self._measured_frame, self.normal_condition, pose_or_center, image_std, covariances)

    def _with_ids(self, ids: tuple[int, ...]) -> LineSet:
        """Return the lines of some ids, which are mostly those of the call before."""
        lines = self._latest_lines.get(ids)
        if lines is None:
            rows = {line: row for row, line in enumerate(self.lines.ids)}
            lines = self.lines.select([rows[line] for line in ids])
            self._latest_lines.clear()
            self._latest_lines[ids] = lines
        return lines

    @cached_property
    def _latest_lines(self) -> dict[tuple[int, ...], LineSet]:
        return {}

    @cached_property
    def normal_condition(self) -> float:
        """Median inverse condition number one to three scene lengths away: what a relative condition is relative to."""
        return normal_condition(self._measured_frame)

    @cached_property
    def _measured_frame(self) -> SceneFrame:
        return SceneFrame.of(self.lines)

    @cached_property
    def loci(self) -> tuple[Locus, ...]:
        """All parts in the order of locus_names, without the observed lines; one part if every centre is singular.

        What tools judge a choice of lines by: each has distance(pose), half_width [m] and exactness, and draws itself
        (polyline, mesh); proximity says the same at any pose without a list.
        """
        if self.singular_everywhere:
            return (self._locus("everywhere", Kind.EVERYWHERE, Everywhere(), self.exactness),)
        parts: list[tuple[Part, float]] = [(StraightPart(t.point, t.direction), t.exactness) for t in self.transversals]
        parts += [(StraightPart(point, np.zeros(3)), self.exactness) for point in self.isolated_points]
        parts += [(surface, self.exactness) for surface in self.surfaces]
        parts += [(curve, self.exactness) for curve in self.curves]
        named = [
            (name, kind)
            for name, kind in zip(self.locus_names, self.locus_kinds, strict=True)
            if kind is not Kind.OBSERVED_LINE
        ]
        return tuple(
            self._locus(name, kind, part, exactness)
            for (name, kind), (part, exactness) in zip(named, parts, strict=True)
        )

    def _locus(self, name: str, kind: Kind, part: Part, exactness: float) -> Locus:
        return Locus(name, kind, part, exactness, self.lines, self.exact_lines)

    @cached_property
    def nearest_transversal(self) -> NearestTransversal:
        """The line that comes nearest to meeting all lines, with how far it misses each."""
        return nearest_transversal(self._measured_frame)

    def unobservable_motions(self, pose_or_center: Pose | npt.ArrayLike) -> tuple[UnobservableMotion, ...]:
        """Return the motions that move no image line at a camera centre, see unobservable_motions."""
        return unobservable_motions(self.exact_lines, pose_or_center)


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
