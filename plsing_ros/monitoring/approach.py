# SPDX-License-Identifier: Apache-2.0
"""How the camera moves with respect to the singular set, and the closest approach ahead."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.levels import MessageWord
from plsing_ros.singularities import Curve, DistanceArrays, Kind, LocusDistance, SingularSet

# Below this the camera is at rest, or its motion is across nothing.
_AT_REST = 1e-9  # [m/s]
# A locus left or approached by less than this share of the speed is neither: the camera moves along it.
_ALONG = 0.02
# Nearer in time than this to the closest point, the camera is passing.
_PASSING = 0.1  # [s]
# Roles for _core.closest_approach: of lines and points the closest place on the path counts, of surfaces where the path
# goes through, and observed lines do not count.
_LINE_OR_POINT, _SURFACE, _LEFT_OUT = 0.0, 1.0, -1.0


class Trend(MessageWord):
    """How the camera moves with respect to the nearest locus; values as in plsing_msgs/SingularityStatus."""

    UNKNOWN = 0
    STEADY = 1
    APPROACHING = 2
    LEAVING = 3
    PASSING = 4


class Approach(NamedTuple):
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

    def __init__(self, singular: SingularSet) -> None:
        self._names, self._kinds = singular.locus_names, singular.locus_kinds
        self._role = np.array([_role(kind) for kind in self._kinds])
        # Observed lines are next to each other.
        self._left_out = self._kinds.index(Kind.OBSERVED_LINE), len(singular.lines)
        self._is_empty = len(self._kinds) == len(singular.lines)
        self._direction = np.zeros((len(self._kinds), 3))
        self._direction[: len(singular.transversals)] = singular.transversal_lines[1]
        for row, curve in enumerate(singular.curves, start=len(self._kinds) - len(singular.curves)):
            if isinstance(curve, Curve) and curve.kind is Kind.STRAIGHT_LINE:
                self._direction[row] = curve.axes[0]

    def nearest(self, arrays: DistanceArrays) -> LocusDistance | None:
        """Return the nearest part, or None if there is none."""
        if self._is_empty:
            return None
        distance, (first, count) = arrays.distance.tolist(), self._left_out
        del distance[first : first + count]
        least = min(distance)
        row = distance.index(least)
        if row >= first:
            row += count
        return LocusDistance(self._kinds[row], self._names[row], least, arrays.closest_point[row])

    def ahead(
        self, arrays: DistanceArrays, T_world_camera: Pose, twist: Array, horizon: float
    ) -> tuple[Trend, Approach | None]:
        """Return the trend with respect to the nearest locus, and the closest approach within a time, if any is ahead.

        Args:
            arrays: Distances from the camera centre.
            T_world_camera: Where the camera is.
            twist: Its motion, in its frame, shape (6,) [m/s, rad/s]; the turn does not matter.
            horizon: How far to look ahead [s].
        """
        if self._is_empty:
            return Trend.UNKNOWN, None
        row, nearest_time, nearest_rate, time, distance = _core.closest_approach(
            arrays.closest_point,
            arrays.distance,
            self._direction,
            self._role,
            T_world_camera.rotation,
            T_world_camera.translation,
            twist,
            horizon,
            _AT_REST,
            _ALONG,
        )
        if abs(nearest_time) <= _PASSING:
            trend = Trend.PASSING
        elif abs(nearest_rate) > _ALONG:
            trend = Trend.APPROACHING if nearest_time > 0.0 else Trend.LEAVING
        else:
            trend = Trend.STEADY
        return trend, None if row < 0 else Approach(self._kinds[row], self._names[row], distance, time)


def _role(kind: Kind) -> float:
    """Return the role of a kind of locus in _core.closest_approach."""
    if kind is Kind.OBSERVED_LINE:
        return _LEFT_OUT
    return _SURFACE if kind in (Kind.PLANE, Kind.QUADRIC, Kind.CUBIC) else _LINE_OR_POINT
