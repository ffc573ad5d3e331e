# SPDX-License-Identifier: Apache-2.0
"""What a camera reports of the lines at one instant, checked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import cast

import numpy as np
import numpy.typing as npt

from plsing_ros import _core
from plsing_ros.arrays import Array, BoolArray, checked_array, shaped_array
from plsing_ros.errors import GeometryError, ObservationError, PlsingError
from plsing_ros.features.projection import degenerate_projections, have_images, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.levels import MessageWord

# Trackers round image lines to float32 at worst; a longer deviation from l'_x^2 + l'_y^2 = 1 is another normalisation.
_NORM_TOLERANCE = 1e-3
# All rows may be used.
_ALL = cast("BoolArray", None)


class LinesVerdict(MessageWord):
    """How far 3-D lines can be trusted; values as in plsing_msgs/LineFeatureArray."""

    GIVEN = 0
    OK = 1
    POOR = 2
    AMBIGUOUS = 3


@dataclass(frozen=True, eq=False)
class LineObservation:
    """Image lines with their ids and, where known, their 3-D lines in the camera frame.

    Attributes:
        ids: Distinct ids, one for each row.
        image_lines: l' of each line, shape (n, 3); rows that are not usable hold zeros.
        usable: Which rows may be used, shape (n,): in sight, and projected without degeneracy.
        lines_camera: The usable rows' 3-D lines in the camera's optical frame, in order; None if the source has image
            lines only, or if no row is usable.
        verdict: How far lines_camera can be trusted.
        verdict_reason: Why, in words; empty if GIVEN or OK.
        lines_source: What lines_camera were computed from, "image" or "filter" (see PoseEstimate); empty if GIVEN.
        covariances: Of each image line's angle phi and offset l'_z, with (l'_x, l'_y) = (cos phi, sin phi): (phi phi,
            phi offset, offset offset) [rad^2, rad, -], shape (n, 3); rows that are not usable hold anything finite;
            None if not known.
        ends: Both ends of each line's segment on the image plane z = 1, (X1, Y1, X2, Y2), shape (n, 4): of the part
            that is seen, or of all of it; a row of zeros where nothing is known; None if nothing is of any line.
        usable_ids: Ids of the usable rows, in order.
        usable_image_lines: Their image lines, shape (k, 3).
        usable_covariances: Their covariances, shape (k, 3), or None.

    Raises:
        ObservationError: If a value is not finite, lengths differ, ids repeat, a usable image line is not normalised,
            a usable covariance is not positive definite, or the 3-D lines do not have the ids of the usable rows.
    """

    ids: tuple[int, ...]
    image_lines: Array
    usable: BoolArray = _ALL
    lines_camera: LineSet | None = None
    verdict: LinesVerdict = LinesVerdict.GIVEN
    verdict_reason: str = ""
    lines_source: str = ""
    covariances: Array | None = None
    ends: Array | None = None
    usable_ids: tuple[int, ...] = field(init=False, repr=False)
    usable_image_lines: Array = field(init=False, repr=False)
    usable_covariances: Array | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        n = len(self.ids)
        if not isinstance(self.ids, tuple):
            object.__setattr__(self, "ids", tuple(map(int, self.ids)))
        if len(set(self.ids)) != n:
            repeated = min(i for i, times in Counter(self.ids).items() if times > 1)
            raise ObservationError(f"line id {repeated} occurs more than once in one observation; ids must be distinct")
        image = shaped_array("image_lines", self.image_lines, (n, 3), ObservationError)
        usable = np.ones(n, dtype=bool) if self.usable is None else np.array(self.usable, dtype=bool)
        if usable.shape != (n,):
            raise ObservationError(f"usable has shape {usable.shape}, expected ({n},)")
        usable.setflags(write=False)
        object.__setattr__(self, "image_lines", image)
        object.__setattr__(self, "usable", usable)
        used, seen = self.ids, image
        uses = usable.tolist()
        if False in uses:
            used, seen = tuple(compress(self.ids, uses)), image[usable]
            seen.setflags(write=False)
            checked_array("image_lines", image, (None, 3), ObservationError)
        if not _core.are_image_lines(seen, _NORM_TOLERANCE):
            _refuse(self.ids, image, usable)
        object.__setattr__(self, "usable_ids", used)
        object.__setattr__(self, "usable_image_lines", seen)
        object.__setattr__(self, "usable_covariances", self._checked_covariances())
        if self.ends is not None:
            object.__setattr__(self, "ends", checked_array("ends", self.ends, (n, 4), ObservationError))
        if self.lines_camera is not None and self.lines_camera.ids != self.usable_ids:
            raise ObservationError(f"3-D lines have ids {self.lines_camera.ids}, expected {self.usable_ids}")

    def __str__(self) -> str:
        rows = [
            f"  line {i}: " + (f"image line ({', '.join(f'{x:.4g}' for x in row)})" if use else "not usable")
            for i, row, use in zip(self.ids, self.image_lines.tolist(), self.usable, strict=True)
        ]
        lines = "no 3-D lines" if self.lines_camera is None else "3-D lines known"
        return "\n".join([f"{len(self.ids)} image lines, {len(self.usable_ids)} usable, {lines}", *rows])

    @classmethod
    def from_image_lines(
        cls,
        ids: Sequence[int],
        image_lines: npt.ArrayLike,
        covariances: npt.ArrayLike | None = None,
        ends: npt.ArrayLike | None = None,
    ) -> LineObservation:
        """Return what a tracker without depth sees: image lines alone, all of them usable.

        Args:
            ids: One distinct integer for each line.
            image_lines: Rows l' with l'_x X + l'_y Y + l'_z = 0 on the image plane z = 1, shape (n, 3): of unit length
                as normals, or with l'_x^2 + l'_y^2 = 1. The sign is that of the line's direction.
            covariances: Of angle and offset of each line, as for the class, shape (n, 3); None if not known.
            ends: Of each line's segment, as for the class, shape (n, 4); None if not known.

        Raises:
            ObservationError: If a value is not finite, lengths differ, ids repeat, or a row has no direction.
        """
        rows = checked_array("image_lines", image_lines, (len(ids), 3), ObservationError)
        length = np.hypot(rows[:, 0], rows[:, 1])
        if (length <= 0.0).any():
            row = int(np.argmin(length))
            raise ObservationError(
                f"image line {ids[row]} is {rows[row].tolist()}; with l'_x = l'_y = 0 it is no line in the image"
            )
        known = None if covariances is None else np.asarray(covariances)
        segments = None if ends is None else np.asarray(ends)
        return cls(tuple(ids), rows / length[:, np.newaxis], covariances=known, ends=segments)

    def _checked_covariances(self) -> Array | None:
        """Lock the covariances and return those of the usable rows."""
        if self.covariances is None:
            return None
        n = len(self.ids)
        covariances = checked_array("covariances", self.covariances, (n, 3), ObservationError)
        object.__setattr__(self, "covariances", covariances)
        rows = covariances if len(self.usable_ids) == n else covariances[self.usable]
        for line, (first, mixed, second) in zip(self.usable_ids, rows.tolist(), strict=True):
            if not (first > 0.0 and second > 0.0 and mixed * mixed < first * second):
                raise ObservationError(
                    f"the covariance of image line {line} is {[first, mixed, second]} (angle, both, offset); variances "
                    "must be positive, and the square of their covariance smaller than their product"
                )
        rows.setflags(write=False)
        return rows

    @classmethod
    def of_lines(cls, lines_camera: LineSet) -> LineObservation:
        """Return what a camera sees of 3-D lines given in its optical frame; degenerate projections are not usable."""
        if have_images(lines_camera):
            everywhere = np.ones(len(lines_camera), dtype=bool)
            return cls(lines_camera.ids, project_lines(lines_camera).reshape(-1, 3), everywhere, lines_camera)
        usable = ~degenerate_projections(lines_camera)
        image = np.zeros((len(lines_camera), 3))
        seen = lines_camera.select(np.flatnonzero(usable)) if usable.any() else None
        if seen is not None:
            image[usable] = project_lines(seen).reshape(-1, 3)
        return cls(lines_camera.ids, image, usable, seen)

    def select(self, rows: Sequence[int]) -> LineObservation:
        """Return some of the rows, in the order given."""
        ids = tuple(self.ids[row] for row in rows)
        lines = self.lines_camera
        if lines is not None:
            kept = [self.usable_ids.index(i) for i in ids if i in self.usable_ids]
            lines = lines.select(kept) if kept else None
        image, usable = self.image_lines[list(rows)], self.usable[list(rows)]
        covariances = None if self.covariances is None else self.covariances[list(rows)]
        ends = None if self.ends is None else self.ends[list(rows)]
        return replace(
            self, ids=ids, image_lines=image, usable=usable, lines_camera=lines, covariances=covariances, ends=ends
        )

    @classmethod
    def from_rows(
        cls,
        ids: tuple[int, ...],
        image_lines: Array,
        directions: Array | None,
        moments: Array | None,
        visible: BoolArray,
        frame: str,
        covariances: Array | None = None,
        verdict: LinesVerdict = LinesVerdict.GIVEN,
        verdict_reason: str = "",
        lines_source: str = "",
        ends: Array | None = None,
    ) -> LineObservation:
        """Build an observation from rows as a message has them, 3-D rows of unusable lines included.

        Args:
            ids: n ids.
            image_lines: Shape (n, 3).
            directions: Unit directions in the camera frame, shape (n, 3), or None.
            moments: Moments in the camera frame [m], shape (n, 3), or None.
            visible: Which rows may be used, shape (n,).
            frame: Name of the camera's optical frame.
            covariances: Of image lines, as for the class, shape (n, 3), or None.
            verdict: As for the class.
            verdict_reason: Likewise.
            lines_source: Likewise.
            ends: Likewise.

        Raises:
            ObservationError: As for the class, and if a 3-D line is not one.
        """
        said = (verdict, verdict_reason, lines_source, covariances, ends)
        # Many times as fast as numpy's count for the few there are.
        count = visible.tolist().count(True)
        if directions is None or moments is None or count == 0:
            return cls(ids, image_lines, visible, None, *said)
        try:
            if count == len(visible):
                seen = LineSet(directions, moments, frame, ids)
            else:
                # The rows that are left out, too.
                _refuse_if_not_lines(directions, moments, len(ids))
                if len(visible) != len(ids):
                    raise ObservationError(f"visible has {len(visible)} values for {len(ids)} ids")
                seen_ids = tuple(i for i, use in zip(ids, visible, strict=True) if use)
                seen = LineSet(directions[visible], moments[visible], frame, seen_ids)
            if have_images(seen):
                return cls(ids, image_lines, visible, seen, *said)
            # A camera centre on a line: the publisher may not have noticed.
            usable, degenerate = np.array(visible), degenerate_projections(seen)
            usable[np.flatnonzero(visible)[degenerate]] = False
            kept = np.flatnonzero(~degenerate)
            return cls(ids, image_lines, usable, seen.select(kept) if len(kept) else None, *said)
        except ObservationError:
            raise
        except PlsingError as error:
            _refuse_if_not_lines(directions, moments, len(ids))
            raise ObservationError(f"3-D lines of the observation: {error}") from None


def checked_observation(observation: LineObservation) -> LineObservation:
    """Return the argument; ObservationError if it is something else."""
    if not isinstance(observation, LineObservation):
        raise ObservationError(
            f"observation is a {type(observation).__name__}; expected a LineObservation, as from project or "
            "LineObservation.from_image_lines"
        )
    return observation


def project(lines: LineSet, T_world_camera: Pose) -> LineObservation:
    """Return what a camera at a pose sees of lines in the world: ids, image lines, and 3-D lines in the camera.

    Lines whose projection is degenerate (through the camera centre, or in its plane z = 0) are not usable.

    Raises:
        GeometryError: If one of the two is something else.
    """
    if not isinstance(lines, LineSet) or not isinstance(T_world_camera, Pose):
        raise GeometryError(
            f"project takes a LineSet and a Pose, not {type(lines).__name__} and {type(T_world_camera).__name__}"
        )
    return LineObservation.of_lines(lines.transformed(T_world_camera.inverse(), "camera"))


def _refuse_if_not_lines(directions: Array, moments: Array, n: int) -> None:
    checked_array("directions", directions, (n, 3), ObservationError)
    checked_array("moments", moments, (n, 3), ObservationError)


def _refuse(ids: tuple[int, ...], image_lines: Array, usable: BoolArray) -> None:
    """Raise the error that names what is wrong with image lines, if it is not that of rows that are not usable."""
    checked_array("image_lines", image_lines, (None, 3), ObservationError)
    off = np.abs(np.hypot(image_lines[:, 0], image_lines[:, 1]) - 1.0) * usable
    if len(ids) and off.max() > _NORM_TOLERANCE:
        row = int(np.argmax(off))
        raise ObservationError(
            f"image line {ids[row]} is {image_lines[row].tolist()}; it must be normalised so that l'_x^2 + l'_y^2 = 1"
        )
