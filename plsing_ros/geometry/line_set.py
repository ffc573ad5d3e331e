# SPDX-License-Identifier: Apache-2.0
"""n oriented straight lines in Plücker coordinates."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from plsing_ros import _core
from plsing_ros.arrays import Array, checked_array, cross, shaped_array
from plsing_ros.errors import GeometryError
from plsing_ros.geometry.pose import Pose, checked_position

# Rounding of (direction, moment) through a float64 message and back stays far below this; a row that violates it
# does not come from rounding.
_TOLERANCE = 1e-6
_EXACT: Array = np.zeros(())


@dataclass(frozen=True, eq=False)
class LineSet:
    """n >= 1 oriented lines (u, l): unit direction u and moment l = x cross u of any point x on the line.

    (u, l) and (-u, -l) are the same line seen with the other orientation; their image lines have opposite signs, so
    the orientation is kept through every operation (docs/conventions.md).

    Attributes:
        direction: Unit directions, shape (n, 3).
        moment: Moments about the frame's origin, shape (n, 3) [m].
        frame: Name of the frame the coordinates are in.
        ids: One distinct integer for each line; 1 to n if not given.
        position_std: How well each line is known: standard deviation of its pivot in each direction across it,
            shape (n,) [m]; one number is that of all lines.
        direction_std: Standard deviation of its direction about each axis across it, with the pivot in place,
            shape (n,) [rad]; one number is that of all lines.
        pivots: The point of each line that these errors are about, shape (n, 3) [m]; None: the point closest to the
            frame's origin.

    Raises:
        GeometryError: If a value is not finite, a shape is wrong, a direction is not of unit length, a moment is not
            orthogonal to its direction, an id is repeated or no integer, or a standard deviation is negative. The
            message names the line by id.

    Source: section "Recalls on the interaction model related to image lines".
    """

    direction: Array
    moment: Array
    frame: str
    ids: tuple[int, ...] = ()
    position_std: Array = field(default_factory=lambda: _EXACT, kw_only=True)
    direction_std: Array = field(default_factory=lambda: _EXACT, kw_only=True)
    pivots: Array | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        direction = shaped_array("direction", self.direction, (None, 3))
        n = len(direction)
        if n == 0:
            raise GeometryError("no lines given; at least one is needed")
        moment = shaped_array("moment", self.moment, (n, 3))
        ids = _checked_ids(tuple(self.ids), n)
        if not _core.are_lines(direction, moment, _TOLERANCE):
            _refuse(direction, moment, ids)
        for name, value in (("direction", direction), ("moment", moment), ("ids", ids)):
            object.__setattr__(self, name, value)
        for name in ("position_std", "direction_std"):
            object.__setattr__(self, name, _checked_std(name, getattr(self, name), ids))
        if self.pivots is not None:
            object.__setattr__(self, "pivots", shaped_array("pivots", self.pivots, (n, 3)))

    @classmethod
    def from_points_directions(
        cls,
        points: npt.ArrayLike,
        directions: npt.ArrayLike,
        frame: str = "world",
        ids: Sequence[int] = (),
        position_std: npt.ArrayLike = 0.0,
        direction_std: npt.ArrayLike = 0.0,
    ) -> LineSet:
        """Build lines from a point on each and a direction of any length.

        Args:
            points: A point on each line, shape (n, 3) [m]; errors of the lines are about these points.
            directions: Directions, shape (n, 3), any length but zero; their sign orients the lines.
            frame: Frame of both.
            ids: One distinct integer for each line; 1 to n if not given.
            position_std: How well the points are known across the lines, one number or shape (n,) [m].
            direction_std: How well the directions are known, one number or shape (n,) [rad].

        Raises:
            GeometryError: If a value is not finite, a shape is wrong, a direction is zero, a point is beyond 1e50 m, an
                id is repeated or no integer, or a standard deviation is negative.
        """
        point = checked_array("points", points, (None, 3))
        direction = checked_array("directions", directions, (len(point), 3))
        checked_ids = _checked_ids(tuple(ids), len(point))
        for line, position in zip(checked_ids, point, strict=True):
            checked_position(f"the point of line {line}", position)
        # Two divisions, so that neither a tiny nor a huge direction under- or overflows on the way to unit length.
        largest = np.abs(direction).max(axis=1, keepdims=True) if len(direction) else np.ones((0, 1))
        if (largest == 0.0).any():
            raise GeometryError(
                f"line {checked_ids[int(np.argmin(largest))]}: its direction is zero; give any other vector along it"
            )
        unit = direction / largest
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
        return cls(
            unit,
            cross(point, unit),
            frame,
            checked_ids,
            position_std=np.asarray(position_std),
            direction_std=np.asarray(direction_std),
            pivots=point,
        )

    def __len__(self) -> int:
        return len(self.direction)

    def __str__(self) -> str:
        rows = [
            f"  line {i}: through ({', '.join(f'{x:.4g}' for x in point)}) m "
            f"along ({', '.join(f'{x:.4g}' for x in direction)})"
            for i, point, direction in zip(self.ids, self.point.tolist(), self.direction.tolist(), strict=True)
        ]
        return "\n".join([f"{len(self)} lines in frame {self.frame}", *rows])

    @cached_property
    def point(self) -> Array:
        """The point of each line closest to the frame's origin, shape (n, 3) [m]."""
        return cross(self.direction, self.moment)

    @cached_property
    def pivot(self) -> Array:
        """The point of each line that its errors are about, shape (n, 3) [m]."""
        return self.point if self.pivots is None else self.pivots

    @cached_property
    def exact(self) -> bool:
        """Whether all lines are known exactly."""
        exact = _zeros(len(self.ids))
        return self.position_std is exact and self.direction_std is exact

    def transformed(self, T_target_source: Pose, frame: str) -> LineSet:
        """Return the same lines in another frame.

        Args:
            T_target_source: Maps coordinates in this set's frame to the target frame.
            frame: Name of the target frame.

        Source: u' = R u, l' = R l + t cross R u (new point x' = R x + t in l' = x' cross u').
        """
        rotation, translation = T_target_source.rotation, T_target_source.translation
        direction = self.direction @ rotation.T
        x, y, z = translation.tolist()
        # direction @ this is translation cross direction.
        across = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        moment = self.moment @ rotation.T + direction @ across
        if self.exact:
            # Nothing is about their pivots, and every cycle comes here.
            return LineSet(direction, moment, frame, self.ids)
        return LineSet(
            direction,
            moment,
            frame,
            self.ids,
            position_std=self.position_std,
            direction_std=self.direction_std,
            pivots=self.pivot @ rotation.T + translation,
        )

    def select(self, rows: Sequence[int] | npt.NDArray[np.intp]) -> LineSet:
        """Return the lines of the given rows, in that order, with their ids."""
        chosen = [int(row) for row in rows]
        if chosen == list(range(len(self.ids))):
            return self
        return LineSet(
            self.direction[chosen],
            self.moment[chosen],
            self.frame,
            tuple(self.ids[row] for row in chosen),
            position_std=self.position_std[chosen],
            direction_std=self.direction_std[chosen],
            pivots=None if self.pivots is None else self.pivots[chosen],
        )

    def reversed(self) -> LineSet:
        """Return the same lines with the opposite orientation."""
        return dataclasses.replace(self, direction=-self.direction, moment=-self.moment)


def _refuse(direction: Array, moment: Array, ids: tuple[int, ...]) -> None:
    """Raise the error that says what is wrong with rows that are not lines."""
    checked_array("direction", direction, (None, 3))
    checked_array("moment", moment, (None, 3))
    unit_error = np.abs(np.einsum("ij,ij->i", direction, direction) - 1.0)
    if (unit_error > _TOLERANCE).any():
        row = int(np.argmax(unit_error))
        raise GeometryError(
            f"line {ids[row]}: direction {direction[row].tolist()} has length "
            f"{np.linalg.norm(direction[row]):.6g}, expected 1"
        )
    skewness = np.abs(np.einsum("ij,ij->i", direction, moment))
    row = int(np.argmax(skewness - _TOLERANCE * (1.0 + np.abs(moment).max(axis=1))))
    raise GeometryError(
        f"line {ids[row]}: moment {moment[row].tolist()} is not orthogonal to its direction "
        f"{direction[row].tolist()} (their product is {skewness[row]:.3g}), so it is not a line"
    )


def _checked_std(name: str, value: Array, ids: tuple[int, ...]) -> Array:
    """Return one standard deviation for each line, of one for all or one for each."""
    exact = _zeros(len(ids))
    if value is _EXACT or value is exact:
        return exact
    if value.ndim == 0:
        value = np.full(len(ids), value, dtype=float)
    std = checked_array(name, value, (len(ids),))
    if not std.any():
        return exact
    if (std < 0.0).any():
        row = int(np.argmin(std))
        raise GeometryError(f"line {ids[row]}: {name} is {std[row]}; it must be at least 0")
    return std


@lru_cache(maxsize=64)
def _zeros(n: int) -> Array:
    zeros = np.zeros(n)
    zeros.setflags(write=False)
    return zeros


@lru_cache(maxsize=64)
def _checked_ids(ids: tuple[int, ...], n: int) -> tuple[int, ...]:
    if len(ids) == 0:
        return tuple(range(1, n + 1))
    if len(ids) != n:
        raise GeometryError(f"{len(ids)} ids for {n} lines; give one id for each line")
    if len(set(ids)) != n:
        repeated = next(i for i, times in Counter(ids).items() if times > 1)
        raise GeometryError(f"id {repeated} is given to more than one line; ids must be distinct")
    try:
        whole = tuple(int(i) for i in ids)
    except (TypeError, ValueError, OverflowError):
        whole = ()
    if whole != ids:
        raise GeometryError(f"ids are {list(ids)}; they must be integers")
    return whole
