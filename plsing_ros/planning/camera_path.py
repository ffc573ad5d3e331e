# SPDX-License-Identifier: Apache-2.0
"""A path for a camera: poses over time from a start to a target, smooth, within limits of speed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import Pose

# Intervals of the cubic spline that rounds the waypoints of the path.
_INTERVALS = 24
_KNOTS = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, _INTERVALS + 1), np.ones(3)])
# Greville abscissae: control points taken there reproduce a straight path, and its parameter, exactly.
_GREVILLE = np.array([_KNOTS[i + 1 : i + 4].mean() for i in range(_INTERVALS + 3)])
_NO_WAYPOINTS = np.zeros((0, 3))


@dataclass(frozen=True)
class SpeedLimits:
    """How fast a path may be gone.

    Attributes:
        linear: Largest |v| [m/s].
        angular: Largest |omega| [rad/s].
        ramp: Time from rest to full speed, and from full speed to rest [s].

    Raises:
        GeometryError: If one of them is not positive and finite.
    """

    linear: float = 0.1
    angular: float = 0.2
    ramp: float = 1.0

    def __post_init__(self) -> None:
        for name, unit in (("linear", "m/s"), ("angular", "rad/s"), ("ramp", "s")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise GeometryError(f"speed limit '{name}' is {value} {unit}; it must be positive and finite")


class CameraPath:
    """Poses of a camera over time, from a start at rest to a target at rest, with a continuous twist.

    In space the path is a polygon with rounded waypoints: the cubic spline with knots uniform in arc length and control
    points on the polygon (Schoenberg's approximation). It never leaves the convex hull of four neighbouring control
    points, is never faster than the polygon, and a straight polygon stays what it is. The orientation goes from start
    to target by the shortest turn, at a constant rate along the polygon; a tilt may be added that is zero at both ends.
    In time, the speed rises and falls linearly.

    Attributes:
        start: T_world_camera at the start.
        target: T_world_camera at the target.
        duration: [s]; zero if the target is the start.
        length: Of the polygon [m], no less than that of the path.
    """

    def __init__(
        self,
        start: Pose,
        target: Pose,
        limits: SpeedLimits,
        waypoints: npt.ArrayLike = _NO_WAYPOINTS,
        tilt: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Lay a path.

        Args:
            start: T_world_camera at the start.
            target: T_world_camera at the target.
            limits: How fast it may be gone.
            waypoints: Points that the path passes near, in order, in the scene frame, shape (k, 3) [m].
            tilt: Rotation vector added to the turn, in the camera frame, all of it half-way, shape (3,) [rad].

        Raises:
            GeometryError: If a waypoint or the tilt is not finite or has another shape.
        """
        between = checked_array("waypoints", waypoints, (None, 3))
        self.start, self.target = start, target
        self._tilt = checked_array("tilt", tilt, (3,))
        polygon = np.concatenate([[start.translation], between, [target.translation]])
        steps = np.linalg.norm(np.diff(polygon, axis=0), axis=1)
        self.length = float(steps.sum())
        place = np.concatenate([[0.0], np.cumsum(steps)])
        share = place / self.length if self.length > 0.0 else np.linspace(0.0, 1.0, len(place))
        control = np.column_stack([np.interp(_GREVILLE, share, polygon[:, axis]) for axis in range(3)])
        self._position = BSpline(_KNOTS, control, 3)
        self._velocity = self._position.derivative()
        self._first = Rotation.from_matrix(start.rotation.copy())
        self._turn = (self._first.inv() * Rotation.from_matrix(target.rotation.copy())).as_rotvec()
        turn = float(np.linalg.norm(self._turn)) + math.pi * float(np.linalg.norm(self._tilt))
        shortest = max(self.length / limits.linear, turn / limits.angular)
        # Speed rises to the limit during the ramp, or until the half of the path if that comes first.
        self._ramp = min(limits.ramp, math.sqrt(limits.ramp * shortest))
        self._rate = self._ramp / (limits.ramp * shortest) if shortest > 0.0 else 0.0
        self.duration = 1.0 / self._rate + self._ramp if shortest > 0.0 else 0.0

    def progress(self, time: float) -> float:
        """Return how much of the path is done at a time [s] since the start, in [0, 1]."""
        if time >= self.duration:
            return 1.0
        if time <= 0.0:
            return 0.0
        left = self.duration - time
        if min(time, left) >= self._ramp:
            return self._rate * (time - 0.5 * self._ramp)
        done = 0.5 * self._rate / self._ramp * min(time, left) ** 2
        return done if time < left else 1.0 - done

    def pose(self, time: float) -> Pose:
        """Return T_world_camera at a time [s] since the start; before it the start, after the end the target."""
        progress = self.progress(time)
        if progress == 0.0:
            return self.start
        if progress == 1.0:
            return self.target
        rotation, position = self.poses(np.array([progress]))
        return Pose(rotation[0], position[0])

    def twist(self, time: float) -> Array:
        """Return the camera's twist (v, omega) in its own frame at a time [s], shape (6,) [m/s, rad/s]."""
        if not 0.0 < time < self.duration:
            return np.zeros(6)
        progress = self.progress(time)
        rate = self._rate * min(1.0, time / self._ramp, (self.duration - time) / self._ramp)
        rotation, _ = self.poses(np.array([progress]))
        bump, slope = math.sin(math.pi * progress) ** 2, math.pi * math.sin(2.0 * math.pi * progress)
        turning = Rotation.from_rotvec(-bump * self._tilt).apply(self._turn) + slope * self._tilt
        twist: Array = rate * np.concatenate([rotation[0].T @ self._velocity(progress), turning])
        return twist

    def poses(self, progress: Array) -> tuple[Array, Array]:
        """Return rotations (k, 3, 3) and positions (k, 3) [m] of T_world_camera where so much is done, shape (k,)."""
        bump = np.sin(np.pi * progress) ** 2
        rotation = (
            self._first
            * Rotation.from_rotvec(progress[:, np.newaxis] * self._turn)
            * Rotation.from_rotvec(bump[:, np.newaxis] * self._tilt)
        )
        return rotation.as_matrix(), np.asarray(self._position(progress))

    def sampled(self, count: int) -> tuple[Pose, ...]:
        """Return count >= 2 poses at equal steps of progress, the first the start and the last the target."""
        rotation, position = self.poses(even_progress(count))
        inner = (Pose(rotation[i], position[i]) for i in range(1, count - 1))
        return (self.start, *inner, self.target)


def even_progress(count: int) -> Array:
    """Return count >= 2 equal steps of progress, from 0 to 1."""
    return np.linspace(0.0, 1.0, count, dtype=np.float64)
