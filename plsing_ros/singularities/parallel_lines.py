# SPDX-License-Identifier: Apache-2.0
"""Everything that is singular besides transversals in a scene with parallel or concurrent lines, in closed form.

Parallel lines leave at most two axis directions of unobservable screws (screw_axes.axes_of_parallel_lines), and the
centres of each are a point, a straight line, a plane or a conic, or two points. Nothing else can be singular off the
observed lines. Source: new, docs/theory.md section "Parallel lines".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.singularities.curves import Curve, conic_name
from plsing_ros.singularities.four_lines import IsolatedPoints, IsolatedStatus
from plsing_ros.singularities.isolated_points import ComplexArray
from plsing_ros.singularities.loci import Kind
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.screw_axes import (
    FlatSet,
    axes_of_concurrent_lines,
    axes_of_parallel_lines,
    centers_of_axis,
)
from plsing_ros.singularities.screw_curve import ScrewCurve
from plsing_ros.singularities.transversals import TransversalAnalysis

# Scene coordinates up to which a point is on a line or plane, and two of them are one.
_ON_LOCUS = 1e-8
# Places z of a flat set at which nothing special is expected.
_ANYWHERE = np.array([[-1.37, 0.86], [0.41, 1.93], [2.23, -0.77], [0.68, -2.12]])


@dataclass(frozen=True, eq=False)
class ScrewLoci:
    """Where a screw is unobservable, without what is filled with transversals or on observed lines.

    Attributes:
        isolated: The points, and what is known about them.
        curves: Straight lines and conics.
        planes: (a, b) of planes a . x + b = 0 that are singular as a whole, scene coordinates, shape (p, 4).
    """

    isolated: IsolatedPoints
    curves: tuple[Curve | ScrewCurve, ...]
    planes: Array


def screws_of_parallel_lines(frame: SceneFrame, analysis: TransversalAnalysis) -> ScrewLoci | None:
    """Return where a screw is unobservable in a scene with parallel or four concurrent lines; None without these.

    Args:
        frame: The scene, n >= 4 different lines, not all parallel.
        analysis: Its transversals.
    """
    axes = axes_of_parallel_lines(frame)
    if axes is None and len(frame.direction) > 4:
        axes = axes_of_concurrent_lines(frame)
    if axes is None:
        return None
    found = screws_of_axes(frame, analysis, axes)
    left = len(found.isolated.center)
    note = f"The parallel lines leave {left} of the ten points of general lines." if len(frame.point) == 4 else ""
    return replace(found, isolated=replace(found.isolated, note=note))


def screws_of_axes(frame: SceneFrame, analysis: TransversalAnalysis, axes: Array) -> ScrewLoci:
    """Return where a screw with one of some axis directions is unobservable.

    Args:
        frame: The scene, n >= 4 different lines.
        analysis: Its transversals.
        axes: Unit vectors, shape (k, 3).
    """
    points: list[ComplexArray] = []
    lines: list[FlatSet] = []
    conics: list[FlatSet] = []
    planes: list[Array] = []
    for axis in axes:
        flat = centers_of_axis(frame, axis)
        for part in [] if flat is None else _parts(flat):
            if isinstance(part, FlatSet):
                inside = part.origin + _ANYWHERE[:, : len(part.axes)] @ part.axes
                if part.whole and len(part.axes) == 2:
                    normal = cross(part.axes[0], part.axes[1])
                    planes.append(np.append(normal, -normal @ part.origin))
                elif part.whole:
                    lines += [] if is_on_known_locus(frame, analysis, inside) else [part]
                else:
                    conics.append(part)
            else:
                points.append(part)
    known = [plane for plane in planes if not any(_same_plane(plane, own) for own in analysis.planes)]
    free = [line for line in lines if not any(_in_plane(plane, line) for plane in known)]
    curves = _named(frame, free, conics)
    return ScrewLoci(_isolated(frame, analysis, points, known, curves), curves, np.array(known).reshape(-1, 4))


def _parts(flat: FlatSet) -> list[FlatSet | ComplexArray]:
    """Return what the centres of one axis are made of: flat sets, and points (3,)."""
    if flat.whole:
        return [flat.origin.astype(complex)] if len(flat.axes) == 0 else [flat]
    if len(flat.axes) == 1:
        (c, b), (_, a) = flat.quadric
        roots = np.roots([a, 2.0 * b, c]) if abs(a) > 1e-9 else np.array([-0.5 * c / b] if abs(b) > 1e-9 else [])
        return [flat.origin + root * flat.axes[0].astype(complex) for root in roots]
    return _parts_of_conic(flat)


def _parts_of_conic(flat: FlatSet) -> list[FlatSet | ComplexArray]:
    value, vector = np.linalg.eigh(flat.quadric)
    order = np.argsort(-np.abs(value))
    rank = int((np.abs(value) > 1e-9 * np.abs(value).max()).sum())
    if rank == 3:
        return [] if (value > 0.0).all() or (value < 0.0).all() else [flat]
    first, second = (np.sqrt(abs(value[i])) * vector[:, i] for i in order[:2])
    if rank == 2 and value[order[0]] * value[order[1]] > 0.0:
        # Two complex lines with one real point.
        h = vector[:, order[2]]
        place = h[1:] / h[0] if abs(h[0]) > 1e-9 else None
        return [] if place is None else [(flat.origin + place @ flat.axes).astype(complex)]
    found: list[FlatSet | ComplexArray] = []
    for line in [first] if rank == 1 else [first + second, first - second]:
        size = float(np.linalg.norm(line[1:]))
        if size > 1e-9:
            normal = line[1:] / size
            way = np.array([-normal[1], normal[0]])
            place = -line[0] / size * normal
            found.append(FlatSet(flat.origin + place @ flat.axes, (way @ flat.axes)[np.newaxis], np.zeros((2, 2))))
    return found


def _named(frame: SceneFrame, lines: list[FlatSet], conics: list[FlatSet]) -> tuple[Curve, ...]:
    found = [(Kind.STRAIGHT_LINE, "singular line", flat) for flat in lines]
    found += [(Kind.CONIC, conic_name(flat.quadric), flat) for flat in conics]
    named = []
    for i, (kind, word, flat) in enumerate(found):
        alike = [other for other, (_, name, _) in enumerate(found) if name == word]
        named.append(Curve(kind, word if len(alike) == 1 else f"{word} {alike.index(i) + 1}", frame, flat))
    return tuple(named)


def _isolated(
    frame: SceneFrame,
    analysis: TransversalAnalysis,
    points: list[ComplexArray],
    planes: list[Array],
    curves: tuple[Curve, ...],
) -> IsolatedPoints:
    kept: list[ComplexArray] = []
    for point in points:
        size = _ON_LOCUS * (1.0 + float(np.abs(point).max()))
        on_plane = any(abs(complex(plane[:3] @ point + plane[3])) <= size for plane in planes)
        repeated = any(np.abs(point - other).max() <= 100.0 * size for other in kept)
        if not (on_plane or repeated or is_on_known_locus(frame, analysis, point[np.newaxis])):
            kept.append(point)
    center = np.array(kept, dtype=complex).reshape(-1, 3)
    real = np.abs(center.imag).max(axis=1, initial=0.0) <= _ON_LOCUS * (1.0 + np.abs(center).max(axis=1, initial=0.0))
    center[real] = center[real].real
    if len(curves) or len(planes):
        status = IsolatedStatus.POSITIVE_DIMENSIONAL
    else:
        status = IsolatedStatus.FINITE if len(center) else IsolatedStatus.NONE
    return IsolatedPoints(status, "", center, real, singularity_residuals(frame.point, frame.direction, center))


def _same_plane(first: Array, second: Array) -> bool:
    return float(min(np.abs(first - second).max(), np.abs(first + second).max())) <= _ON_LOCUS


def _in_plane(plane: Array, line: FlatSet) -> bool:
    return bool(abs(plane[:3] @ line.origin + plane[3]) <= _ON_LOCUS and abs(plane[:3] @ line.axes[0]) <= _ON_LOCUS)


def is_on_known_locus(frame: SceneFrame, analysis: TransversalAnalysis, centers: ComplexArray | Array) -> bool:
    """Return whether all centres (k, 3) are on one observed line or transversal, or in one plane of transversals."""
    size = _ON_LOCUS * (1.0 + np.abs(centers).max(axis=1))
    observed = np.concatenate([frame.direction, frame.moment], axis=1)
    for line in np.concatenate([observed, analysis.lines]):
        if (np.linalg.norm(line[3:] - np.cross(centers, line[:3]), axis=1) <= size).all():
            return True
    return any((np.abs(centers @ plane[:3] + plane[3]) <= size).all() for plane in analysis.planes)
