# SPDX-License-Identifier: Apache-2.0
"""What singular_set finds: the parts of a singular set, their distances to a camera, and both in words."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plsing_ros import _core
from plsing_ros.arrays import Array, vector_text
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.pose import checked_center
from plsing_ros.singularities.cases import Case
from plsing_ros.singularities.curves import Curve
from plsing_ros.singularities.four_lines import IsolatedStatus
from plsing_ros.singularities.isolated_points import ComplexArray
from plsing_ros.singularities.loci import DistanceArrays, Kind, LocusDistance
from plsing_ros.singularities.locus import Everywhere, Locus, Part, StraightPart
from plsing_ros.singularities.nearest_transversal import NearestTransversal, nearest_transversal
from plsing_ros.singularities.proximity import Proximity, normal_condition, proximity
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.screw_curve import ScrewCurve
from plsing_ros.singularities.surfaces import Surface
from plsing_ros.singularities.transversals import Transversal, TransversalFamily
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
