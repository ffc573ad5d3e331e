# SPDX-License-Identifier: Apache-2.0
"""Singular loci as messages, with the shapes to draw them by."""

from __future__ import annotations

import array
import math

import numpy as np
from std_msgs.msg import Header

from plsing_msgs.msg import SingularLoci, SingularLocus
from plsing_ros.arrays import Array
from plsing_ros.nodes.conversions import LOCUS_KINDS, flat
from plsing_ros.singularities import Kind, SingularSet
from plsing_ros.singularities.locus import Locus
from plsing_ros.singularities.surfaces import Surface

# Cells along each edge of the cube that a surface is cut in: enough to see it, and some 100 kB.
_CELLS = 16


def loci_message(singular: SingularSet, head: Header) -> SingularLoci:
    """Return the singular set of a scene."""
    lines, (points, directions) = singular.lines, singular.transversal_lines
    return SingularLoci(
        header=head,
        line_ids=list(lines.ids),
        line_points=flat(lines.point),
        line_directions=flat(lines.direction),
        description=singular.description,
        transversal_names=[each.name for each in singular.transversals],
        transversal_points=flat(points),
        transversal_directions=flat(directions),
        transversal_residuals=flat(np.array([each.residual for each in singular.transversals])),
        isolated_point_names=[
            name
            for name, kind in zip(singular.locus_names, singular.locus_kinds, strict=True)
            if kind is Kind.ISOLATED_POINT
        ],
        isolated_points=flat(singular.isolated_points),
        isolated_point_residuals=flat(singular.isolated_point_residuals),
        loci=[locus_message(each, head.frame_id) for each in singular.loci],
    )


def locus_message(locus: Locus, frame: str) -> SingularLocus:
    """Return one locus of a scene, whose frame it is."""
    message = SingularLocus(
        kind=LOCUS_KINDS[locus.kind],
        name=locus.name,
        frame_id=frame,
        exactness=locus.exactness,
        segments=flat(locus_segments(locus)),
        triangles=flat(locus.mesh(resolution=_CELLS)),
    )
    message.half_width_valid = math.isfinite(locus.half_width)
    if message.half_width_valid:
        message.half_width = locus.half_width
    if isinstance(locus.part, Surface):
        message.exponents = array.array("B", np.ravel(locus.part.exponents).tolist())
        message.coefficients = flat(locus.part.coefficients)
    return message


def locus_segments(locus: Locus, middle: Array | None = None, radius: float | None = None) -> Array:
    """Return both ends of segments along a line or curve, shape (2k, 3) [m]; an isolated point alone, wherever, (1, 3).

    Args:
        locus: Empty for a surface.
        middle: Of the ball that it is drawn in, shape (3,) [m]; None: the scene's centre.
        radius: Of the ball [m]; None: three scene lengths.
    """
    if locus.kind is Kind.ISOLATED_POINT:
        return locus.closest_point(np.zeros(3))[np.newaxis]
    points = locus.polyline(middle, radius)
    pairs = np.stack([points[:-1], points[1:]], axis=1)
    segments: Array = pairs[np.isfinite(pairs).all(axis=(1, 2))].reshape(-1, 3)
    return segments
