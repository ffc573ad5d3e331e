"""What the camera sees at the goal of a task."""

from __future__ import annotations

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation, interaction_matrix, inverse_condition_number
from plsing_ros.servoing.target import MINIMUM_LINES


class Goal:
    """Image lines and inverse condition number at the goal, for whichever of its lines are seen at the moment."""

    def __init__(self, observation: LineObservation, what: str) -> None:
        """Take the goal's observation, with 3-D lines; `what` names it in messages.

        Raises:
            ObservationError: If it has fewer than three usable lines, or no 3-D lines.
        """
        if observation.lines_camera is None:
            raise ObservationError(
                f"{what}: no 3-D lines (directions and moments); without them the inverse condition number at the goal "
                "is not known"
            )
        if len(observation.lines_camera) < MINIMUM_LINES:
            raise ObservationError(
                f"{what}: only {len(observation.lines_camera)} usable line(s) ({list(observation.usable_ids)}) of "
                f"{len(observation.ids)}; at least {MINIMUM_LINES} are needed"
            )
        self._lines = observation.lines_camera
        self._image = observation.usable_image_lines
        self._row = {i: row for row, i in enumerate(observation.usable_ids)}
        # Of the ids asked for last: they change only when lines come in or out of sight.
        self._ids: tuple[int, ...] = ()
        self._inverse: float | None = None
        self._desired: Array | None = None

    def inverse_condition_number(self, ids: tuple[int, ...]) -> float | None:
        """Return the inverse condition number at the goal of those lines, or None if fewer than three are in it."""
        self._select(ids)
        return self._inverse

    def image_lines(self, ids: tuple[int, ...]) -> Array | None:
        """Return the image lines at the goal in the order of the ids, shape (n, 3), or None if it lacks one of them."""
        self._select(ids)
        return self._desired

    def _select(self, ids: tuple[int, ...]) -> None:
        if ids == self._ids:
            return
        rows = [self._row[i] for i in ids if i in self._row]
        self._ids, self._inverse, self._desired = ids, None, None
        if len(rows) >= MINIMUM_LINES:
            self._inverse = inverse_condition_number(interaction_matrix(self._lines.select(rows)))
        if len(rows) == len(ids):
            self._desired = self._image[rows]
