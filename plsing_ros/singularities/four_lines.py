# SPDX-License-Identifier: Apache-2.0
"""What is known about the isolated singular points of a scene."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, BoolArray
from plsing_ros.singularities.isolated_points import ComplexArray, TenPoints

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


def is_generic(ten: TenPoints) -> BoolArray:
    """Return for which scenes the direct solver's answer is the whole answer, shape (S,)."""
    generic: BoolArray = ten.complete & (ten.rank_margin > _RANK_MARGIN)
    return generic
