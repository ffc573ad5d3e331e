"""How the camera moves with respect to the singular set, and the closest approach ahead."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.singularities import DistanceArrays, Kind, LocusDistance, SingularSet

# Below this the camera is at rest, or its motion is across nothing.
_AT_REST = 1e-9  # [m/s]
# A locus left or approached by less than this share of the speed is neither: the camera moves along it.
_ALONG = 0.02
# Nearer in time than this to the closest point, the camera is passing.
_PASSING = 0.1  # [s]


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
        self._names, self._kinds = found.locus_names, found.locus_kinds
        observed = np.array([kind is Kind.OBSERVED_LINE for kind in self._kinds], dtype=bool)
        self._is_empty = bool(observed.all())
        # Added to distances, it leaves the observed lines out.
        self._left_out = np.where(observed, np.inf, 0.0)
        along = np.zeros((len(observed), 3))
        for i, transversal in enumerate(found.transversals):
            along[i] = transversal.direction
        self._along = along
        self._is_surface = np.array(
            [kind in (Kind.PLANE, Kind.QUADRIC, Kind.CUBIC) for kind in self._kinds], dtype=bool
        )
        self._has_surfaces = bool(self._is_surface.any())

    def nearest(self, arrays: DistanceArrays) -> LocusDistance | None:
        """Return the nearest part, or None if there is none."""
        if self._is_empty:
            return None
        row = int((arrays.distance + self._left_out).argmin())
        return LocusDistance(self._kinds[row], self._names[row], float(arrays.distance[row]), arrays.closest_point[row])

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
        if self._is_empty:
            return Trend.UNKNOWN, None
        speed = math.sqrt(float(velocity @ velocity))
        if speed < _AT_REST:
            return Trend.STEADY, None
        distance = arrays.distance
        # Only what moves the camera across a locus changes its distance, and the way to the closest point is across.
        closing = (arrays.closest_point - center) @ velocity
        along = self._along @ velocity
        square = speed * speed - along * along
        if self._has_surfaces:
            # To a plane the distance changes along its normal only.
            square = np.where(self._is_surface, (closing / np.maximum(distance, 1e-300)) ** 2, square)
        square[square <= (_ALONG * speed) ** 2] = np.inf
        time = closing / square
        nearest = int((distance + self._left_out).argmin())
        trend = Trend.STEADY
        if square[nearest] < math.inf:
            t = float(time[nearest])
            rate = float(closing[nearest]) / max(float(distance[nearest]), 1e-300)
            if abs(t) <= _PASSING:
                trend = Trend.PASSING
            elif abs(rate) > _ALONG * speed:
                trend = Trend.APPROACHING if t > 0.0 else Trend.LEAVING
        # Pythagoras: of the offset, what the motion does not close.
        least = distance * distance - time * closing + self._left_out
        least[(time <= 0.0) | (time > horizon)] = np.inf
        row = int(least.argmin())
        if not math.isfinite(least[row]):
            return trend, None
        return trend, Approach(
            self._kinds[row], self._names[row], math.sqrt(max(float(least[row]), 0.0)), float(time[row])
        )
