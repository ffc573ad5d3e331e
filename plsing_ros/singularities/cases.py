# SPDX-License-Identifier: Apache-2.0
"""The paper's table of cases, with a sentence for each that a person can read."""

from __future__ import annotations

import enum

import numpy as np

from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.transversals import TransversalFamily

_ANGLE_TOLERANCE = 1e-9


class Case(enum.Enum):
    """Which row of the table of cases a scene belongs to. str(case) is the sentence."""

    SINGULAR_EVERYWHERE = "The interaction matrix is rank-deficient at every camera position."
    P3L_SKEW = (
        "Three skew lines: singular when the camera is on the hyperboloid through the lines, or on the cubic surface "
        "where the perpendiculars from the camera to the lines are coplanar."
    )
    P3L_SPECIAL = (
        "Three lines that are not skew: singular when the camera is on a quadric that is not a hyperboloid of one "
        "sheet, or on the cubic surface where the perpendiculars from the camera to the lines are coplanar."
    )
    P4L_HYPERBOLIC = (
        "Four lines in a hyperbolic congruence: singular on two lines that meet all four, and at up to ten real points."
    )
    P4L_PARABOLIC = (
        "Four lines in a parabolic congruence: singular on one line that meets all four, and at up to ten real points."
    )
    P4L_ELLIPTIC = "Four lines in an elliptic congruence: no line meets all four; singular at up to ten real points."
    P4L_ORTHOGONAL_PARALLEL = (
        "Four lines, three mutually orthogonal and the fourth parallel to one of them: singular on the two lines that "
        "meet all four, and nowhere else if they are in general position."
    )
    P5L_REGULAR = "Five lines in a regular linear complex: no line meets all five, so no singularity unless at a point."
    P5L_SINGULAR = "Five lines in a singular linear complex: singular on the line that meets all five."
    P5L_ORTHOGONAL_PARALLEL = (
        "Five lines, each parallel or orthogonal to the others: no singularity in general, a line or a point in "
        "special positions."
    )
    PNL_REGULAR = "Six or more lines that no line meets all of: no singularity unless at a point."
    PNL_TRANSVERSAL = "All lines are met by common lines: singular when the camera is on one of these."
    REGULUS = "The lines belong to one regulus: singular when the camera is anywhere on its quadric."
    PLANAR = "All transversals fill planes: singular when the camera is anywhere in one of these planes."

    def __str__(self) -> str:
        return self.value


_CONGRUENCES = {
    TransversalFamily.TWO: Case.P4L_HYPERBOLIC,
    TransversalFamily.DOUBLE: Case.P4L_PARABOLIC,
    TransversalFamily.COMPLEX_PAIR: Case.P4L_ELLIPTIC,
}


def classify(frame: SceneFrame, family: TransversalFamily) -> Case:
    """Return the row of the table for three or more distinct lines that are not singular everywhere.

    Args:
        frame: The distinct lines.
        family: What meets them all.

    Source: table "Different cases of singularities in P4L and P5L"; rows REGULUS, PLANAR and PNL are new.
    """
    n = len(frame.direction)
    if n == 3:
        return Case.P3L_SKEW if family is TransversalFamily.REGULUS else Case.P3L_SPECIAL
    if family is TransversalFamily.REGULUS:
        return Case.REGULUS
    if family in (TransversalFamily.PENCIL, TransversalFamily.TWO_PENCILS, TransversalFamily.PLANE):
        return Case.PLANAR
    if n <= 5 and _orthogonal_or_parallel(frame):
        return Case.P4L_ORTHOGONAL_PARALLEL if n == 4 else Case.P5L_ORTHOGONAL_PARALLEL
    if n == 4:
        return _CONGRUENCES.get(family, Case.PNL_TRANSVERSAL)
    none = family in (TransversalFamily.NONE, TransversalFamily.COMPLEX_PAIR)
    if n == 5:
        if none:
            return Case.P5L_REGULAR
        return Case.P5L_SINGULAR if family is TransversalFamily.ONE else Case.PNL_TRANSVERSAL
    return Case.PNL_REGULAR if none else Case.PNL_TRANSVERSAL


def _orthogonal_or_parallel(frame: SceneFrame) -> bool:
    """Return whether all pairs are parallel or orthogonal and three of the lines mutually orthogonal."""
    cosine = frame.cosine
    # A line neither nearly parallel nor nearly orthogonal to the first: no need to look closer.
    if any(1e-3 < value < 0.999 for value in cosine[0].tolist()):
        return False
    # 1 - cosine is half the squared angle: compare sines, which see small angles.
    sine = np.sqrt(np.maximum(0.0, 1.0 - cosine**2))
    special = (cosine <= _ANGLE_TOLERANCE) | (sine <= np.sqrt(_ANGLE_TOLERANCE))
    if not special.all():
        return False
    return bool(np.linalg.matrix_rank(frame.direction, tol=0.5) == 3)
