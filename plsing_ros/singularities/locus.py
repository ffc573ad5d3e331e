# SPDX-License-Identifier: Apache-2.0
"""A named part of a singular set: what it is, how far away, how exact, and how wide the trouble beside it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.pose import checked_center
from plsing_ros.singularities.curves import Curve
from plsing_ros.singularities.loci import Kind
from plsing_ros.singularities.meshing import surface_triangles
from plsing_ros.singularities.proximity import conditions_at, halton_shell, normal_condition
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.screw_curve import ScrewCurve
from plsing_ros.singularities.surfaces import Surface

# Samples of a locus, and how far beside it, in scene lengths, its slope is taken.
_SAMPLES, _BESIDE = 40, 1e-3
# Steps of first order to a surface, at most; more than a few only where its gradient vanishes nearby.
_PROJECTIONS = 50
# The share of the normal inverse condition number below which a camera is in the width of a locus.
_WIDTH_SHARE = 0.1
# Scene lengths from the scene's centre up to which loci are drawn if nothing else is said.
_DRAWN = 3.0


@dataclass(frozen=True, eq=False)
class StraightPart:
    """A straight line, or a point if its direction is zero, in the frame of the lines.

    Attributes:
        point: Shape (3,) [m].
        direction: Unit vector or zero, shape (3,).
    """

    point: Array
    direction: Array

    def closest_point(self, center: Array) -> Array:
        """Return its point closest to a centre, shape (3,) [m]."""
        closest: Array = self.point + ((center - self.point) @ self.direction) * self.direction
        return closest

    def polyline(self, middle: Array, radius: float) -> Array:
        """Return the two ends of its part in a ball, or the point itself; empty outside the ball, shape (k, 3) [m]."""
        closest = self.closest_point(middle)
        square = radius**2 - float(((closest - middle) ** 2).sum())
        if square < 0.0:
            return np.zeros((0, 3))
        ways = np.array([[-1.0], [1.0]]) if self.direction.any() else np.array([[0.0]])
        points: Array = closest + np.sqrt(square) * ways * self.direction
        return points


class Everywhere:
    """All camera centres."""

    def closest_point(self, center: Array) -> Array:
        """Return the centre itself."""
        return center


Part = StraightPart | Surface | Curve | ScrewCurve | Everywhere


@dataclass(frozen=True, eq=False)
class Locus:
    """Camera centres at which a motion is unobservable, exactly or as far as is known of measured lines.

    Attributes:
        name: As in SingularSet.locus_names.
        kind: What it is.
        part: Its geometry, in the frame of the lines.
        exactness: By how many tolerances the lines must change, root mean square over the conditions, for the locus to
            be exactly singular; 0 for exact lines.
        lines: The lines it belongs to, as they were measured.
        exact_lines: Lines for which it is exactly singular; None if they were not computed.
    """

    name: str
    kind: Kind
    part: Part
    exactness: float
    lines: LineSet = field(repr=False)
    exact_lines: LineSet | None = field(repr=False)

    def __str__(self) -> str:
        return (
            f"{self.name}: {self.exactness:.2g} tolerances from exact, 1/cond down to "
            f"{self.lowest_relative_condition:.1e} of normal, below a tenth within {self.half_width:.3g} m"
        )

    def closest_point(self, pose_or_center: Pose | npt.ArrayLike) -> Array:
        """Return the point closest to a camera centre, shape (3,) [m]; to first order for quadrics and cubics.

        Args:
            pose_or_center: T_world_camera, or the camera centre, shape (3,) [m]; in the frame of the lines.

        Raises:
            GeometryError: If the centre is not three finite numbers, or beyond 1e50 m.
        """
        center = checked_center("pose_or_center", pose_or_center)
        if isinstance(self.part, Surface):
            return self.part.first_order_closest_point(center)
        return self.part.closest_point(center)

    def distance(self, pose_or_center: Pose | npt.ArrayLike) -> float:
        """Return the distance of a camera centre from closest_point [m]."""
        center = checked_center("pose_or_center", pose_or_center)
        return float(np.linalg.norm(self.closest_point(center) - center))

    def polyline(self, middle: npt.ArrayLike | None = None, radius: float | None = None) -> Array:
        """Return points along the part of a line or curve in a ball, for drawing, shape (k, 3) [m].

        A row of NaN separates branches; an isolated point is one point; empty for surfaces, and outside the ball.

        Args:
            middle: Of the ball, in the frame of the lines, shape (3,) [m]; None: the scene's centre.
            radius: [m]; None: three scene lengths.
        """
        if isinstance(self.part, Surface | Everywhere):
            return np.zeros((0, 3))
        return self.part.polyline(*self._ball(middle, radius))

    def mesh(self, middle: npt.ArrayLike | None = None, radius: float | None = None, resolution: int = 32) -> Array:
        """Return triangles of the part of a surface in a cube, for drawing, shape (k, 3, 3) [m]; empty if it is none.

        Args:
            middle: Of the cube, in the frame of the lines, shape (3,) [m]; None: the scene's centre.
            radius: Half the cube's edge [m]; None: three scene lengths.
            resolution: Cells along each edge, >= 1.
        """
        if not isinstance(self.part, Surface):
            return np.zeros((0, 3, 3))
        return surface_triangles(self.part, *self._ball(middle, radius), resolution)

    def _ball(self, middle: npt.ArrayLike | None, radius: float | None) -> tuple[Array, float]:
        frame = self._frame
        center = frame.center if middle is None else checked_center("middle", middle)
        return center, _DRAWN * frame.length if radius is None else radius

    @cached_property
    def samples(self) -> Array:
        """Points of the locus, those within about three scene lengths of the scene's centre first, shape (k, 3) [m]."""
        frame = self._frame
        starts = frame.from_scene(halton_shell()[:_SAMPLES])
        points = np.array([self._projected(start) for start in starts])
        near = np.linalg.norm(points - frame.center, axis=1) <= 4.0 * frame.length
        return points[near] if near.any() else points

    def _projected(self, start: Array) -> Array:
        for _ in range(_PROJECTIONS if isinstance(self.part, Surface) else 1):
            start, before = self.closest_point(start), start
            if np.abs(start - before).max() <= 1e-15 * self._frame.length:
                break
        return start

    @cached_property
    def residual(self) -> float:
        """The largest of the independent residuals (singularity_residuals) of the measured lines at samples."""
        frame = self._frame
        samples = frame.to_scene(self.samples)
        return float(singularity_residuals(frame.point, frame.direction, samples).max())

    @cached_property
    def lowest_relative_condition(self) -> float:
        """The lowest inverse condition number of the measured lines at samples, over the scene's normal one."""
        frame = self._frame
        normal = normal_condition(frame)
        return float(conditions_at(frame, frame.to_scene(self.samples)).min() / normal) if normal > 0.0 else 0.0

    @cached_property
    def half_width(self) -> float:
        """The distance within which the inverse condition number is below a tenth of the scene's normal one [m].

        The median over the samples; infinite where every centre is singular.
        """
        frame = self._frame
        normal = normal_condition(frame)
        if isinstance(self.part, Everywhere) or normal == 0.0:
            return float("inf")
        scene = frame if self.exact_lines is None else SceneFrame.of(self.exact_lines)
        beside = self.samples + _BESIDE * frame.length * halton_shell()[: len(self.samples)]
        distance = np.array([self.distance(each) for each in beside])
        slope = conditions_at(scene, scene.to_scene(beside)) / np.maximum(distance, 1e-300)
        return float(np.median(_WIDTH_SHARE * normal / np.maximum(slope, 1e-300)))

    @cached_property
    def _frame(self) -> SceneFrame:
        return SceneFrame.of(self.lines)
