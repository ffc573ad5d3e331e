"""What comes next: approach to the loci, trend of a number, and where the plain law leads."""

from __future__ import annotations

import enum
import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.geometry import LineSet
from plsing_ros.singularities import DistanceArrays, Kind, SingularSet

_SECOND = 1_000_000_000
# Below this the camera is at rest, or its motion is across nothing.
_AT_REST = 1e-9  # [m/s]
# A locus left or approached by less than this share of the speed is neither: the camera moves along it.
_ALONG = 0.02
# Nearer in time than this to the closest point, the camera is passing.
_PASSING = 0.1  # [s]
# The commanded twist follows the law if their cosine is above this.
_SAME_DIRECTION = 0.8
_LONGEST_STEP, _SHORTEST_STEP = 0.2, 0.02  # [s]
_FASTEST = 1e9  # [m/s]; every number that is published is finite

# vector @ _SKEW is [vector]x row by row.
_SKEW = np.zeros((3, 9))
_SKEW[0, 5], _SKEW[0, 7], _SKEW[1, 2], _SKEW[1, 6], _SKEW[2, 1], _SKEW[2, 3] = -1.0, 1.0, 1.0, -1.0, -1.0, 1.0
_IN_PLANE = np.array([1.0, 1.0, 0.0])
_LEAST_DEPTH = 1e-6  # [m]
_IDENTITY = np.eye(3)


class Trend(enum.IntEnum):
    """How the camera moves with respect to the nearest locus; values as in plsing_msgs/SingularityStatus."""

    UNKNOWN = 0
    STEADY = 1
    APPROACHING = 2
    LEAVING = 3
    PASSING = 4


@dataclass(frozen=True)
class Approach:
    """The closest approach ahead to a part of the singular set, if the motion goes on as it is.

    Attributes:
        kind: What it is.
        name: Its name, as in SingularSet.locus_names.
        distance: At the closest approach [m].
        time: Until then [s].
    """

    kind: Kind
    name: str
    distance: float
    time: float


class ApproachTable:
    """Closest approaches of straight motions to all parts of one singular set but the observed lines.

    Exact for lines, points and planes. For quadrics and cubics of first order: the tangent plane where the camera's
    perpendicular meets them.

    Source: new, docs/monitor.md.
    """

    def __init__(self, found: SingularSet) -> None:
        rows = [row for row, kind in enumerate(found.locus_kinds) if kind is not Kind.OBSERVED_LINE]
        self.rows = np.array(rows, dtype=np.intp)
        self.names = tuple(found.locus_names[row] for row in rows)
        self.kinds = tuple(found.locus_kinds[row] for row in rows)
        along = np.zeros((len(rows), 3))
        for i, transversal in enumerate(found.transversals):
            along[i] = transversal.direction
        self._along = along
        self._is_surface = np.array([kind in (Kind.PLANE, Kind.QUADRIC, Kind.CUBIC) for kind in self.kinds], dtype=bool)
        self._has_surfaces = bool(self._is_surface.any())

    def ahead(
        self, arrays: DistanceArrays, center: Array, velocity: Array, horizon: float
    ) -> tuple[Trend, Approach | None]:
        """Return the trend with respect to the nearest locus, and the closest approach within a time, if any is ahead.

        Args:
            arrays: Distances from the camera centre.
            center: Camera centre, shape (3,) [m].
            velocity: Of the centre, in the frame of the scene, shape (3,) [m/s].
            horizon: How far to look ahead [s].
        """
        if len(self.rows) == 0:
            return Trend.UNKNOWN, None
        offset = arrays.closest_point[self.rows] - center
        distance = arrays.distance[self.rows]
        nearest = int(distance.argmin())
        speed = math.sqrt(float(velocity @ velocity))
        if speed < _AT_REST:
            return Trend.STEADY, None
        # Only what moves the camera across a locus changes its distance.
        across = velocity - (self._along @ velocity)[:, np.newaxis] * self._along
        if self._has_surfaces:
            # To a plane the distance changes along its normal only.
            normal = offset / np.maximum(distance, 1e-300)[:, np.newaxis]
            toward = np.einsum("ij,j->i", normal, velocity)[:, np.newaxis] * normal
            across = np.where(self._is_surface[:, np.newaxis], toward, across)
        square = np.einsum("ij,ij->i", across, across)
        closing = np.einsum("ij,ij->i", offset, across)
        moving = square > (_ALONG * speed) ** 2
        time = np.where(moving, closing / np.where(moving, square, 1.0), 0.0)
        ahead = offset - time[:, np.newaxis] * across
        least = np.sqrt(np.einsum("ij,ij->i", ahead, ahead))
        trend = Trend.STEADY
        if moving[nearest]:
            t = float(time[nearest])
            rate = float(closing[nearest]) / max(float(distance[nearest]), 1e-300)
            if abs(t) <= _PASSING:
                trend = Trend.PASSING
            elif abs(rate) > _ALONG * speed:
                trend = Trend.APPROACHING if t > 0.0 else Trend.LEAVING
        least = np.where((time > 0.0) & (time <= horizon), least, np.inf)
        row = int(least.argmin())
        if not math.isfinite(least[row]):
            return trend, None
        return trend, Approach(self.kinds[row], self.names[row], float(least[row]), float(time[row]))


class Slope:
    """Rate of a number over its latest samples: the slope of the line that fits them best.

    Over the 10 samples of the default, noise of standard deviation s on each gives the rate a standard deviation of
    0.11 s per sampling interval, against 1.41 s of the difference of two.
    """

    def __init__(self, length: int) -> None:
        self._samples: deque[tuple[int, float]] = deque(maxlen=length)

    def clear(self) -> None:
        """Forget all samples."""
        self._samples.clear()

    def add(self, value: float, stamp: int) -> tuple[float, float] | None:
        """Return the rate [1/s] and its standard error with one more value at a stamp [ns].

        None with fewer than two different stamps; the error is infinite with fewer than four. A stamp that is not
        later than the last one changes nothing; after a gap of more than a second, what was before is forgotten.
        """
        if self._samples:
            step = stamp - self._samples[-1][0]
            if step <= 0:
                return None
            if step > _SECOND:
                self._samples.clear()
        self._samples.append((stamp, value))
        n = len(self._samples)
        if n < 2:
            return None
        times = [(each - stamp) / _SECOND for each, _ in self._samples]
        mean_time, mean = sum(times) / n, sum(each for _, each in self._samples) / n
        deviation = [(t - mean_time, each - mean) for t, (_, each) in zip(times, self._samples, strict=True)]
        spread = sum(t * t for t, _ in deviation)
        rate = sum(t * each for t, each in deviation) / spread
        if n < 4:
            return rate, math.inf
        rest = sum((each - rate * t) ** 2 for t, each in deviation)
        return rate, math.sqrt(rest / ((n - 2) * spread))


class LawPreview:
    """Runs the plain law ahead of the camera, one step in each cycle, and reports the fastest speed it meets.

    Once a preview has reached the horizon the next one starts from the present. What the camera sees and the twist
    that is really commanded are the only inputs: the gain is read off the twist, and a twist in another direction than
    the law's ends the preview, because it then says nothing about what comes.

    Source: new, docs/monitor.md.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget the preview: another goal, no twist, or other lines."""
        self._ids: tuple[int, ...] | None = None
        self._direction: Array = np.zeros((0, 3))
        self._moment: Array = np.zeros((0, 3))
        self._twist: Array = np.zeros(6)
        self._gain = self._dt = self._time = 0.0
        self._now: tuple[float, float] = (0.0, 0.0)
        self._complete: tuple[float, float] = (0.0, 0.0)

    def advance(self, lines: LineSet, desired: Array, twist: Array, horizon: float) -> tuple[float, float] | None:
        """Make a step and return the largest linear speed ahead [m/s] and the time to it [s], or None if not known.

        Args:
            lines: What the camera sees now, in its optical frame.
            desired: The image lines at the goal in the same order, shape (3n,).
            twist: The commanded twist, shape (6,).
            horizon: How far to look ahead [s].
        """
        if self._ids is not None and self._ids != lines.ids:
            self.clear()
        try:
            if self._ids is None:
                return self._start(lines, desired, twist)
            self._go_on(desired, horizon)
        except np.linalg.LinAlgError:
            # The preview ran into a singularity: as fast as it gets.
            self._now, self._time = (_FASTEST, self._time), horizon
        if self._time >= horizon:
            self._complete, self._ids = self._now, None
        return max(self._now, self._complete)

    def _start(self, lines: LineSet, desired: Array, twist: Array) -> tuple[float, float] | None:
        direction = law(lines.direction, lines.moment, desired)
        size, product, commanded = (float(a @ b) for a, b in ((direction,) * 2, (direction, twist), (twist,) * 2))
        if size <= 0.0 or product <= 0.0 or product * product < _SAME_DIRECTION**2 * size * commanded:
            self.clear()
            return None
        self._ids, self._direction, self._moment = lines.ids, lines.direction, lines.moment
        self._gain, self._dt, self._time = product / size, _LONGEST_STEP, 0.0
        self._twist = self._gain * direction
        self._now = (_linear_speed(self._twist), 0.0)
        return max(self._now, self._complete)

    def _go_on(self, desired: Array, horizon: float) -> None:
        self._direction, self._moment = _seen_after(self._direction, self._moment, self._twist * self._dt)
        self._time += self._dt
        twist = self._gain * law(self._direction, self._moment, desired)
        self._now = max(self._now, (_linear_speed(twist), self._time))
        # The next step changes the twist by about a third.
        change = _norm(twist - self._twist) / max(_norm(self._twist), 1e-300)
        self._dt *= 0.35 / max(change, 1e-9)
        self._dt = max(min(self._dt, _LONGEST_STEP, horizon - self._time), _SHORTEST_STEP)
        self._twist = twist


def law(direction: Array, moment: Array, desired: Array) -> Array:
    """Return the twist of the plain law for gain 1, shape (6,), by the normal equations: for previews only.

    They square the condition number: below 1e-8 the twist is only large, not right, and no more is asked of it. The
    same L as features.interaction_matrix, without its checks, because it is made once more in each cycle.

    Args:
        direction: Of n lines in the camera frame, shape (n, 3).
        moment: Likewise, shape (n, 3) [m].
        desired: Image lines at the goal, shape (3n,).

    Raises:
        numpy.linalg.LinAlgError: If L is singular to working precision, or a line has no image.
    """
    n = len(direction)
    depth = np.sqrt((moment * moment) @ _IN_PLANE)
    if not depth.min() > _LEAST_DEPTH:
        raise np.linalg.LinAlgError
    inverse = (1.0 / depth)[:, np.newaxis]
    image = moment * inverse
    change = np.empty((n, 3, 6))
    change[:, :, :3] = (direction @ _SKEW).reshape(n, 3, 3)
    change[:, :, 3:] = (moment @ _SKEW).reshape(n, 3, 3)
    change *= inverse[:, :, np.newaxis]
    along = (image * _IN_PLANE)[:, np.newaxis] @ change
    matrix = (change - image[:, :, np.newaxis] * along).reshape(-1, 6)
    twist: Array = -np.linalg.solve(matrix.T @ matrix, matrix.T @ (image.ravel() - desired))
    if not _norm(twist) < _FASTEST:
        raise np.linalg.LinAlgError
    return twist


def _seen_after(direction: Array, moment: Array, step: Array) -> tuple[Array, Array]:
    """Return lines in the frame of a camera that moved by the screw exp(step), shape (6,) [m, rad]."""
    x, y, z = step[3:].tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    if angle > 1e-4:
        first, second = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2
        third = (angle - math.sin(angle)) / angle**3
    else:
        first, second, third = 1.0, 0.5, 1.0 / 6.0
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    K2 = K @ K
    shift = step[:3] + second * (K @ step[:3]) + third * (K2 @ step[:3])
    # R^T of each row, with R = I + first K + second K^2.
    R = _IDENTITY + first * K + second * K2
    return direction @ R, (moment - cross(shift, direction)) @ R


def _norm(vector: Array) -> float:
    return math.sqrt(float(vector @ vector))


def _linear_speed(twist: Array) -> float:
    return min(_norm(twist[:3]), _FASTEST)
