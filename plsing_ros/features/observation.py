"""What a camera reports of the lines at one instant, checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, BoolArray, checked_array
from plsing_ros.errors import ObservationError, PlsingError
from plsing_ros.features.projection import degenerate_projections, project_lines
from plsing_ros.geometry import LineSet

# Trackers round image lines to float32 at worst; a longer deviation from l'_x^2 + l'_y^2 = 1 is another normalisation.
_NORM_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class LineObservation:
    """Image lines with their ids and, where known, their 3-D lines in the camera frame.

    Attributes:
        ids: Distinct ids, one for each row.
        image_lines: l' of each line, shape (n, 3); rows that are not usable hold zeros.
        usable: Which rows may be used, shape (n,): in sight, and projected without degeneracy.
        lines_camera: The usable rows' 3-D lines in the camera's optical frame, in order; None if the source has image
            lines only, or if no row is usable.

    Raises:
        ObservationError: If a value is not finite, lengths differ, ids repeat, a usable image line is not normalised,
            or the 3-D lines do not have the ids of the usable rows.
    """

    ids: tuple[int, ...]
    image_lines: Array
    usable: BoolArray
    lines_camera: LineSet | None

    def __post_init__(self) -> None:
        n = len(self.ids)
        if len(set(self.ids)) != n:
            repeated = sorted({i for i in self.ids if self.ids.count(i) > 1})
            raise ObservationError(
                f"line id {repeated[0]} occurs more than once in one observation; ids must be distinct"
            )
        image = checked_array("image_lines", self.image_lines, (n, 3), ObservationError)
        usable = np.array(self.usable, dtype=bool)
        if usable.shape != (n,):
            raise ObservationError(f"usable has shape {usable.shape}, expected ({n},)")
        off = np.abs(np.hypot(image[:, 0], image[:, 1]) - 1.0) * usable
        if n and off.max() > _NORM_TOLERANCE:
            row = int(np.argmax(off))
            raise ObservationError(
                f"image line {self.ids[row]} is {image[row].tolist()}; it must be normalised so that "
                "l'_x^2 + l'_y^2 = 1"
            )
        if self.lines_camera is not None and self.lines_camera.ids != self.usable_ids:
            raise ObservationError(f"3-D lines have ids {self.lines_camera.ids}, expected {self.usable_ids}")
        usable.setflags(write=False)
        object.__setattr__(self, "image_lines", image)
        object.__setattr__(self, "usable", usable)

    @property
    def usable_ids(self) -> tuple[int, ...]:
        """Ids of the usable rows, in order."""
        return tuple(i for i, use in zip(self.ids, self.usable, strict=True) if use)

    @property
    def usable_image_lines(self) -> Array:
        """Image lines of the usable rows, in order, shape (k, 3)."""
        return self.image_lines[self.usable]

    @classmethod
    def of_lines(cls, lines_camera: LineSet) -> LineObservation:
        """Return what a camera sees of 3-D lines given in its optical frame; degenerate projections are not usable."""
        usable = ~degenerate_projections(lines_camera)
        image = np.zeros((len(lines_camera), 3))
        seen = lines_camera.select(np.flatnonzero(usable)) if usable.any() else None
        if seen is not None:
            image[usable] = project_lines(seen).reshape(-1, 3)
        return cls(lines_camera.ids, image, usable, seen)

    @classmethod
    def from_rows(
        cls,
        ids: tuple[int, ...],
        image_lines: Array,
        directions: Array | None,
        moments: Array | None,
        visible: BoolArray,
        frame: str,
    ) -> LineObservation:
        """Build an observation from rows as a message has them, 3-D rows of unusable lines included.

        Args:
            ids: n ids.
            image_lines: Shape (n, 3).
            directions: Unit directions in the camera frame, shape (n, 3), or None.
            moments: Moments in the camera frame [m], shape (n, 3), or None.
            visible: Which rows may be used, shape (n,).
            frame: Name of the camera's optical frame.

        Raises:
            ObservationError: As for the class, and if a 3-D line is not one.
        """
        if directions is None or moments is None or not visible.any():
            return cls(ids, image_lines, visible, None)
        seen_ids = tuple(i for i, use in zip(ids, visible, strict=True) if use)
        try:
            seen = LineSet(directions[visible], moments[visible], frame, seen_ids)
            usable = np.array(visible)
            # A camera centre on a line: the publisher may not have noticed.
            degenerate = degenerate_projections(seen)
            if degenerate.any():
                usable[np.flatnonzero(visible)[degenerate]] = False
                kept = np.flatnonzero(~degenerate)
                return cls(ids, image_lines, usable, seen.select(kept) if len(kept) else None)
        except PlsingError as error:
            raise ObservationError(f"3-D lines of the observation: {error}") from None
        return cls(ids, image_lines, usable, seen)
