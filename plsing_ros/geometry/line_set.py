"""n oriented straight lines in Plücker coordinates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from plsing_ros import kernels
from plsing_ros.arrays import Array, checked_array, cross, shaped_array
from plsing_ros.errors import GeometryError
from plsing_ros.geometry.pose import Pose, checked_position

# Rounding of (direction, moment) through a float64 message and back stays far below this; a row that violates it
# does not come from rounding.
_TOLERANCE = 1e-6


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

    Raises:
        GeometryError: If a value is not finite, a shape is wrong, a direction is not of unit length, a moment is not
            orthogonal to its direction, or an id is repeated or no integer. The message names the line by id.

    Source: section "Recalls on the interaction model related to image lines".
    """

    direction: Array
    moment: Array
    frame: str
    ids: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        direction = shaped_array("direction", self.direction, (None, 3))
        n = len(direction)
        if n == 0:
            raise GeometryError("no lines given; at least one is needed")
        moment = shaped_array("moment", self.moment, (n, 3))
        ids = _checked_ids(tuple(self.ids), n)
        if not kernels.are_lines(direction, moment, _TOLERANCE):
            _refuse(direction, moment, ids)
        for name, value in (("direction", direction), ("moment", moment), ("ids", ids)):
            object.__setattr__(self, name, value)

    @classmethod
    def from_points_directions(
        cls,
        points: npt.ArrayLike,
        directions: npt.ArrayLike,
        frame: str = "world",
        ids: Sequence[int] = (),
    ) -> LineSet:
        """Build lines from a point on each and a direction of any length.

        Args:
            points: A point on each line, shape (n, 3) [m].
            directions: Directions, shape (n, 3), any length but zero; their sign orients the lines.
            frame: Frame of both.
            ids: One distinct integer for each line; 1 to n if not given.

        Raises:
            GeometryError: If a value is not finite, a shape is wrong, a direction is zero, a point is beyond 1e50 m, or
                an id is repeated or no integer.
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
        return cls(unit, cross(point, unit), frame, checked_ids)

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
        return LineSet(direction, moment, frame, self.ids)

    def select(self, rows: Sequence[int] | npt.NDArray[np.intp]) -> LineSet:
        """Return the lines of the given rows, in that order, with their ids."""
        chosen = [int(row) for row in rows]
        if chosen == list(range(len(self.ids))):
            return self
        return LineSet(self.direction[chosen], self.moment[chosen], self.frame, tuple(self.ids[row] for row in chosen))

    def reversed(self) -> LineSet:
        """Return the same lines with the opposite orientation."""
        return LineSet(-self.direction, -self.moment, self.frame, self.ids)


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
