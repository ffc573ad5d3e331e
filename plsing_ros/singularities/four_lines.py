# SPDX-License-Identifier: Apache-2.0
"""All isolated points of four lines: the direct solver where the scene is generic, limits where it is special."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, BoolArray
from plsing_ros.singularities.homotopy import Limits, limits_of_ten_points
from plsing_ros.singularities.isolated_points import ComplexArray, TenPoints, solve_ten_points
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.surfaces import Surface
from plsing_ros.singularities.transversals import TransversalAnalysis

# Below this rank margin rounding decides how many points the direct solver sees.
_RANK_MARGIN = 1e-9


class IsolatedStatus(enum.Enum):
    """What is known about the isolated singular points of a scene."""

    FINITE = "finitely many isolated points, all found"
    NONE = "no isolated points"
    POSITIVE_DIMENSIONAL = "a curve or surface that is not filled with transversals is singular too"
    SURFACES = "the singular set consists of surfaces"
    EVERYWHERE = "every camera position is singular"
    UNRESOLVED = "not all isolated points could be determined"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, eq=False)
class IsolatedPoints:
    """Isolated points in scene coordinates.

    Attributes:
        status: What is known about them.
        note: In words, what became of the ten points of a generic scene; empty if all are there.
        center: Shape (k, 3), complex.
        real: Which are real, shape (k,).
        residual: Independent residuals, shape (k,).
    """

    status: IsolatedStatus
    note: str
    center: ComplexArray
    real: BoolArray
    residual: Array


def no_points(status: IsolatedStatus, note: str = "") -> IsolatedPoints:
    """Return an answer without points."""
    return IsolatedPoints(status, note, np.zeros((0, 3), dtype=complex), np.zeros(0, dtype=bool), np.zeros(0))


def isolated_points_of_four(
    frame: SceneFrame, analysis: TransversalAnalysis, surfaces: tuple[Surface, ...]
) -> IsolatedPoints:
    """Return the isolated points of four distinct lines that are not singular everywhere.

    Args:
        frame: The scene.
        analysis: Its transversals.
        surfaces: The surfaces filled with transversals.
    """
    ten = solve_ten_points(frame.direction[np.newaxis], frame.point[np.newaxis])
    if is_generic(ten)[0]:
        return IsolatedPoints(IsolatedStatus.FINITE, "", ten.center[0], ten.real[0], ten.residual[0])
    limits = limits_of_ten_points(frame, analysis, surfaces)
    return IsolatedPoints(_status(limits), _note(limits), limits.center, limits.real, limits.residual)


def is_generic(ten: TenPoints) -> BoolArray:
    """Return for which scenes the direct solver's answer is the whole answer, shape (S,)."""
    generic: BoolArray = ten.complete & (ten.rank_margin > _RANK_MARGIN)
    return generic


def _status(limits: Limits) -> IsolatedStatus:
    if limits.moving:
        return IsolatedStatus.POSITIVE_DIMENSIONAL
    if limits.unresolved:
        return IsolatedStatus.UNRESOLVED
    return IsolatedStatus.FINITE if len(limits.center) else IsolatedStatus.NONE


def _note(limits: Limits) -> str:
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
    return (
        f"Of the ten points of a general scene, {len(limits.center)} are left: " + ", ".join(parts) + "."
        if parts
        else ""
    )
