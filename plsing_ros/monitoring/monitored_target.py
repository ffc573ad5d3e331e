# SPDX-License-Identifier: Apache-2.0
"""What the camera sees at the target of a task."""

from __future__ import annotations

from typing import NamedTuple

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.features.target import MINIMUM_LINES, Target

_ALL_COLUMNS = (0, 1, 2, 3, 4, 5)


class TargetConditions(NamedTuple):
    """What is known of some lines at the target.

    Attributes:
        inverse_condition_number: Of those that are in the target, or None if these are fewer than three.
        image_lines: Of all in their order, shape (n, 3), or None if the target lacks one of them.
    """

    inverse_condition_number: float | None
    image_lines: Array | None


NOT_KNOWN = TargetConditions(None, None)


class MonitoredTarget(Target):
    """A target with 3-D lines, of which lines may be seen that are not in it."""

    def __init__(self, observation: LineObservation, what: str, columns: tuple[int, ...] = _ALL_COLUMNS) -> None:
        """Take the target's observation, with 3-D lines.

        Args:
            observation: What the camera sees there.
            what: Names it in messages.
            columns: Of L, whose condition counts.

        Raises:
            ObservationError: If it has fewer than three usable lines, or no 3-D lines.
        """
        if observation.lines_camera is None:
            raise ObservationError(
                f"{what}: no 3-D lines (directions and moments); without them the inverse condition number "
                "at the target is not known"
            )
        super().__init__(observation, what)
        self._columns = columns
        self._latest_at: tuple[tuple[int, ...], TargetConditions] | None = None

    def at(self, ids: tuple[int, ...]) -> TargetConditions:
        """Return what is known of lines at the target; computed when the ids change."""
        if self._latest_at is None or self._latest_at[0] != ids:
            self._latest_at = (ids, self._look_up(ids))
        return self._latest_at[1]

    def _look_up(self, ids: tuple[int, ...]) -> TargetConditions:
        known = tuple(i for i in ids if i in self)
        if len(known) < MINIMUM_LINES:
            return NOT_KNOWN
        view = self.view(known, self._columns)
        return TargetConditions(view.inverse_condition_number, view.image.reshape(-1, 3) if known == ids else None)
