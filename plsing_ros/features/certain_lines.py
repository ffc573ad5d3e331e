# SPDX-License-Identifier: Apache-2.0
"""Which lines a law goes by that does not weigh them: all but those that are far less certain than most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.features.decomposition import decompose
from plsing_ros.features.interaction import interaction_matrix
from plsing_ros.features.observation import LineObservation
from plsing_ros.geometry import LineSet

# Fewer lines are never left: four decide a pose, and where few are left, a singularity is nearer.
_ENOUGH = 6


class _Limits(NamedTuple):
    """When a line is left out: above this standard deviation, and as long as the others show the camera's motion.

    Attributes:
        deviation: Over that of the line in the middle.
        condition: Inverse condition number of L without the line, over that with all lines.
    """

    deviation: float
    condition: float


# A line is left out by the first and comes back only by the second, so that it does not flicker.
_LEAVE, _STAY = _Limits(5.0, 0.8), _Limits(3.0, 0.6)


class CertainLines:
    """Chooses lines in frame after frame.

    In a pseudo-inverse each line counts alike, so that one with an error of k times the others' adds as much error as
    k^2 of them. Without it the twist is better, unless the others show some motion much worse.

    Attributes:
        left_out: Ids of the lines that were left out in the latest frame, in order.

    Source: new, docs/controller.md.
    """

    def __init__(self) -> None:
        self.left_out: tuple[int, ...] = ()

    def rows(self, lines: LineSet, covariances: Array | None, columns: Sequence[int]) -> list[int] | None:
        """Return the rows of the lines to go by in one more frame, in order; None: all of them.

        Args:
            lines: In the camera's optical frame.
            covariances: Of angle and offset of each image line (angle angle, angle offset, offset offset), on z = 1,
                shape (n, 3) [rad^2, rad, 1]; None if they are not known.
            columns: Of L, from 0 to 5: the degrees of freedom in use.

        Raises:
            GeometryError: If a line has no image, and another one is far less certain than most.
        """
        before, self.left_out = self.left_out, ()
        n = len(lines)
        if covariances is None or n <= _ENOUGH:
            return None
        # What is expected of |l' - its true value|^2, which the law's error is made of.
        squares = [angle + offset for angle, _, offset in covariances.tolist()]
        middle = sorted(squares)[n // 2]
        if max(squares) <= _STAY.deviation**2 * middle:
            return None
        limits = [_STAY if i in before else _LEAVE for i in lines.ids]
        kept = list(range(n))
        all_rows = interaction_matrix(lines)[:, columns].reshape(n, 3, -1)
        whole = _inverse_condition_number(all_rows)
        for row in sorted(kept, key=lambda each: -squares[each]):
            if len(kept) <= _ENOUGH:
                break
            if squares[row] > limits[row].deviation ** 2 * middle:
                others = [each for each in kept if each != row]
                if _inverse_condition_number(all_rows[others]) >= limits[row].condition * whole:
                    kept = others
        if len(kept) == n:
            return None
        self.left_out = tuple(i for row, i in enumerate(lines.ids) if row not in kept)
        return kept

    def of_observation(self, observation: LineObservation, columns: Sequence[int]) -> LineObservation:
        """Return one more frame with the lines that are left out not usable.

        Args:
            observation: What the camera sees; as it is if it has no 3-D lines.
            columns: As for rows.

        Raises:
            GeometryError: Likewise.
        """
        lines = observation.lines_camera
        rows = None if lines is None else self.rows(lines, observation.usable_covariances, columns)
        if lines is None or rows is None:
            return observation
        usable = observation.usable & ~np.isin(observation.ids, self.left_out)
        return replace(observation, usable=usable, lines_camera=lines.select(rows))

    @property
    def text(self) -> str:
        """Which lines are left out, as a clause, or ""."""
        if not self.left_out:
            return ""
        plural = "s" if len(self.left_out) > 1 else ""
        return f"line{plural} {', '.join(map(str, self.left_out))} left out: far less certain than the others"


def _inverse_condition_number(rows: Array) -> float:
    """Return that of the rows of some lines, shape (n, 3, k)."""
    return decompose(rows.reshape(-1, rows.shape[2])).inverse_condition_number
