"""What the camera sees at the goal of a task."""

from __future__ import annotations

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.servoing.target import MINIMUM_LINES, Target

_COLUMNS = (0, 1, 2, 3, 4, 5)


class Goal(Target):
    """A target with 3-D lines, of which lines may be seen that are not in it."""

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
        super().__init__(observation, what)

    def inverse_condition_number(self, ids: tuple[int, ...]) -> float | None:
        """Return the inverse condition number at the goal of those lines, or None if fewer than three are in it."""
        known = tuple(i for i in ids if i in self)
        return self.view(known, _COLUMNS).inverse_condition_number if len(known) >= MINIMUM_LINES else None

    def image_lines(self, ids: tuple[int, ...]) -> Array | None:
        """Return the image lines at the goal in the order of the ids, shape (n, 3), or None if it lacks one of them."""
        return self.view(ids, _COLUMNS).image.reshape(-1, 3) if ids and all(i in self for i in ids) else None
