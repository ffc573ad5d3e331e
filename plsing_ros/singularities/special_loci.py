# SPDX-License-Identifier: Apache-2.0
"""Where a screw is unobservable in a scene without parallel lines: points, and curves and planes of special scenes.

Where the ten points of four lines are not ten, their limits from general scenes are the isolated ones, and three kinds
of sets are infinite: those of one axis direction (screw_axes), curves along which the axis turns (moving_screws), and
planes. Source: new, docs/theory.md sections "Special scenes" and "Witness points".
"""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array, BoolArray
from plsing_ros.singularities.curves import Curve
from plsing_ros.singularities.four_lines import IsolatedPoints, IsolatedStatus, is_generic
from plsing_ros.singularities.homotopy import Limits, limits_of_ten_points
from plsing_ros.singularities.isolated_points import RESIDUAL_TOLERANCE, ComplexArray, TenPoints, solve_ten_points
from plsing_ros.singularities.moving_screws import axis_curves
from plsing_ros.singularities.parallel_lines import ScrewLoci, is_on_known_locus, screws_of_axes
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.screw_axes import axes_of_flat_loci
from plsing_ros.singularities.screw_curve import ScrewCurve
from plsing_ros.singularities.surfaces import Surface, plane_surface
from plsing_ros.singularities.transversals import TransversalAnalysis

# Scene coordinates, over one plus the distance from the centre, up to which points are one or on a curve or plane.
_SAME = 1e-5

NO_PLANES = np.zeros((0, 4))


def screws_of_four_lines(
    frame: SceneFrame, analysis: TransversalAnalysis, surfaces: tuple[Surface, ...], ten: TenPoints | None = None
) -> ScrewLoci:
    """Return where a screw is unobservable for four different lines without parallels that are not all concurrent.

    Args:
        frame: The scene.
        analysis: Its transversals.
        surfaces: The surfaces filled with transversals.
        ten: The direct solver's answer, if it is known.
    """
    ten = ten or solve_ten_points(frame.direction[np.newaxis], frame.point[np.newaxis])
    if is_generic(ten)[0]:
        points = IsolatedPoints(IsolatedStatus.FINITE, "", ten.center[0], ten.real[0], ten.residual[0])
        return ScrewLoci(points, (), NO_PLANES)
    infinite = infinite_loci(frame, analysis)
    planes = tuple(plane_surface(frame, plane, "") for plane in infinite.planes)
    limits = limits_of_ten_points(frame, analysis, surfaces + planes)
    return ScrewLoci(_merged(frame, limits, infinite), infinite.curves, infinite.planes)


def infinite_loci(frame: SceneFrame, analysis: TransversalAnalysis) -> ScrewLoci:
    """Return the curves and planes at which a screw is unobservable, and the points of the axes that were tried.

    Args:
        frame: The scene, n >= 4 different lines, no two parallel, not all concurrent.
        analysis: Its transversals.
    """
    fixed = screws_of_axes(frame, analysis, axes_of_flat_loci(frame))

    def is_known(center: ComplexArray) -> bool:
        return is_on_known_locus(frame, analysis, center[np.newaxis]) or any(
            abs(complex(plane[:3] @ center + plane[3])) <= _SAME * (1.0 + np.abs(center).max())
            for plane in fixed.planes
        )

    turning = [ScrewCurve("", frame, form) for form in axis_curves(frame, is_known)]
    real = [curve for curve in turning if curve.exists]
    named = [
        ScrewCurve("curve" if len(real) == 1 else f"curve {number}", frame, curve.form)
        for number, curve in enumerate(real, start=1)
    ]
    return ScrewLoci(fixed.isolated, (*fixed.curves, *named), fixed.planes)


def is_on_curve(frame: SceneFrame, curves: tuple[Curve | ScrewCurve, ...], center: Array) -> bool:
    """Return whether a real centre (3,), in scene coordinates, is on one of some curves."""
    place, reach = frame.from_scene(center), _SAME * (1.0 + float(np.abs(center).max()))
    for curve in curves:
        if isinstance(curve, ScrewCurve):
            on = curve.contains(center, reach)
        else:
            on = float(np.linalg.norm(curve.closest_point(place) - place)) <= reach * frame.length
        if on:
            return True
    return False


def _merged(frame: SceneFrame, limits: Limits, infinite: ScrewLoci) -> IsolatedPoints:
    """Return the isolated points of both, each once, without those on the curves."""
    own = infinite.isolated
    center: ComplexArray = np.concatenate([limits.center, own.center]).reshape(-1, 3)
    real: BoolArray = np.concatenate([limits.real, own.real])
    residual: Array = np.concatenate([limits.residual, own.residual])
    kept: list[int] = []
    for i in range(len(center)):
        place: ComplexArray = center[i]
        size = _SAME * (1.0 + float(np.abs(place).max()))
        repeated = any(float(np.abs(place - center[j]).max()) <= size for j in kept)
        on_curve = bool(real[i]) and is_on_curve(frame, infinite.curves, place.real)
        if residual[i] <= RESIDUAL_TOLERANCE and not repeated and not on_curve:
            kept.append(i)
    if limits.moving or infinite.curves or len(infinite.planes):
        status = IsolatedStatus.POSITIVE_DIMENSIONAL
    elif limits.unresolved:
        status = IsolatedStatus.UNRESOLVED
    else:
        status = IsolatedStatus.FINITE if kept else IsolatedStatus.NONE
    return IsolatedPoints(status, _note(limits, len(kept)), center[kept], real[kept], residual[kept])


def _note(limits: Limits, left: int) -> str:
    dimension = {1: "a curve", 2: "a surface"}.get(limits.tangent_dimension, "a curve or surface")
    counted = [
        (int((limits.multiplicity - 1).sum()), "coincide with others"),
        (limits.at_infinity, "at infinity"),
        (limits.on_lines, "on observed lines"),
        (limits.on_transversals, "on transversals"),
        (limits.moving, f"spread over {dimension} of singular positions"),
        (limits.unresolved, "not resolved"),
    ]
    parts = [f"{count} {where}" for count, where in counted if count]
    if not parts:
        return ""
    return f"Of the ten points of a general scene, {left} are left: " + ", ".join(parts) + "."
