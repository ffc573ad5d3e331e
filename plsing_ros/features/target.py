# SPDX-License-Identifier: Apache-2.0
"""The target of a task, seen through whichever of its lines are in sight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation, decompose, interaction_matrix, smallest_over_largest

MINIMUM_LINES = 3


@dataclass(frozen=True, eq=False)
class TargetView:
    """What some lines look like at the target.

    Attributes:
        image: s*, shape (3k,).
        interaction: L at the target in the columns asked for, shape (3k, m), or None without 3-D lines.
        singular_values: Of that L, largest first, shape (m,), or None likewise.
    """

    image: Array
    interaction: Array | None
    singular_values: Array | None

    @property
    def inverse_condition_number(self) -> float | None:
        """Smallest over largest singular value, in [0, 1], or None if not known."""
        return None if self.singular_values is None else smallest_over_largest(self.singular_values.tolist())


class Target:
    """Desired image lines, with their 3-D lines where known.

    Attributes:
        observation: What the camera sees at the target.
        ids: Of the lines that have an image at the target.
        lines: Those lines in the camera frame at the target, or None if the source has image lines only.
    """

    def __init__(self, observation: LineObservation, what: str) -> None:
        """Take what the camera sees at the target; `what` names it in messages.

        Raises:
            ObservationError: If fewer than three of its lines are usable.
        """
        ids = observation.usable_ids
        if len(ids) < MINIMUM_LINES:
            raise ObservationError(
                f"{what}: only {len(ids)} usable line(s) ({list(ids)}) of {len(observation.ids)}; "
                f"at least {MINIMUM_LINES} are needed"
            )
        self.observation = observation
        self.ids = ids
        self._row = {i: row for row, i in enumerate(ids)}
        self._image = observation.usable_image_lines
        self.lines = observation.lines_camera
        # Of the ids asked for last: they change only when lines come in or out of sight.
        self._latest: tuple[tuple[int, ...], tuple[int, ...]] | None = None
        self._view: TargetView

    def __contains__(self, identity: int) -> bool:
        return identity in self._row

    def view(self, ids: tuple[int, ...], columns: tuple[int, ...]) -> TargetView:
        """Return the target seen through lines that are in it, in the order of the ids.

        Args:
            ids: At least one.
            columns: Of L: the degrees of freedom in use.
        """
        if self._latest == (ids, columns):
            return self._view
        rows = [self._row[i] for i in ids]
        interaction: Array | None = None
        singular_values: Array | None = None
        if self.lines is not None:
            interaction = interaction_matrix(self.lines.select(rows))[:, columns]
            singular_values = decompose(interaction).singular_values
        self._latest = ids, columns
        self._view = TargetView(np.ravel(self._image[rows]), interaction, singular_values)
        return self._view
