# SPDX-License-Identifier: Apache-2.0
"""Since when a run goes on, how far from the target it began, and how long the camera has been there."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from plsing_ros import _core
from plsing_ros.geometry import Pose

_SECOND = 1_000_000_000
# A camera that was not told to move for this long rests: what comes next is another run [ns].
_REST = _SECOND
# Standard deviations that the start may be off by.
_DEVIATIONS = 3.0


class RunClock:
    """The present run: it begins anew when the camera rests, and when it has arrived.

    Attributes:
        start: Stamp of its first features [ns], or None.
        start_distance: From the target then [m], as far as is known by now.
        distance: From the target now [m].
        first_speeds: (|v|, |omega|) of the law's first command; negative as long as they are not known.
        run: Number of the run; a camera that rests stays in one.
        arrived_for: How long the camera has been within 5 cm and 2 degrees of the target [s].
    """

    def __init__(self) -> None:
        self.run = 0
        self.restart()

    def restart(self) -> None:
        """Begin with another task."""
        self.start: int | None = None
        self.start_distance = self.distance = 0.0
        self.first_speeds = (-1.0, -1.0)
        self.arrived_for = 0.0
        self.run += 1
        self._rested = False
        self._arrived_since: int | None = None
        self._moved: int | None = None
        self._speed = self._gone = self._most = 0.0

    def note_motion(self, stamp: int, speed: float) -> None:
        """Take note that the camera was told to move at a speed [m/s] for the features of a stamp [ns]."""
        if self._moved is not None:
            self._gone += self._speed * max(stamp - self._moved, 0) / _SECOND
        self._moved, self._speed = stamp, speed

    def update(
        self,
        stamp: int,
        here: Pose,
        target: Pose,
        used: Sequence[int] = (1, 1, 1, 1, 1, 1),
        deviation: float = 0.0,
    ) -> float:
        """Return the time since the run's start [s].

        Args:
            stamp: Of the features [ns].
            here: T_world_camera now.
            target: T_world_camera at the target.
            used: Degrees of freedom that the law controls; along the others the camera is neither near nor far.
            deviation: Standard deviation of the position here [m].
        """
        distance, angle = distance_between(here, target, used)
        self.distance = distance
        rests = self._moved is None or stamp - self._moved > _REST
        if not (distance <= _core.ARRIVED_DISTANCE and angle <= _core.ARRIVED_ANGLE):
            self._arrived_since = None
        elif self._arrived_since is None:
            self._arrived_since = stamp
        self.arrived_for = 0.0 if self._arrived_since is None else (stamp - self._arrived_since) / _SECOND
        if self.start is None or rests or self.arrived_for >= _core.ARRIVED_TIME or stamp < self.start:
            self.start, self.start_distance, self.first_speeds = stamp, distance, (-1.0, -1.0)
            self.arrived_for, self._arrived_since, self._gone = 0.0, None, 0.0
            self._most = distance + _DEVIATIONS * deviation
            if not (rests and self._rested):
                self.run += 1
        if all(used):
            # Where the first pose was uncertain, a later one tells that the camera cannot have begun so near.
            gone = self._gone + self._speed * max(stamp - (self._moved or stamp), 0) / _SECOND
            self.start_distance = max(self.start_distance, min(distance - gone, self._most))
        self._rested = rests
        return (stamp - self.start) / _SECOND


def distance_between(here: Pose, target: Pose, used: Sequence[int]) -> tuple[float, float]:
    """Return distance [m] and angle [rad] between two cameras, along the degrees of freedom in use (of the camera)."""
    if all(used):
        cosine = 0.5 * (float(here.rotation.ravel().dot(target.rotation.ravel())) - 1.0)
        # Plain numbers, because every cycle needs this.
        away = math.dist(here.translation.tolist(), target.translation.tolist())
        return away, math.acos(min(max(cosine, -1.0), 1.0))
    mask = np.array(used, dtype=float)
    shift = here.rotation.T @ (here.translation - target.translation) * mask[:3]
    turn = Rotation.from_matrix(target.rotation.T @ here.rotation).as_rotvec() * mask[3:]
    return float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
