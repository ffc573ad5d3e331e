# SPDX-License-Identifier: Apache-2.0
"""Paths that the paper lets a camera follow: where the camera shall be at each time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose


class Path(Protocol):
    """Where the camera centre shall be.

    Attributes:
        duration: How long the path takes [s].
    """

    @property
    def duration(self) -> float: ...

    def position(self, time: float) -> Array:
        """Return the camera centre at a time [s] since the start, in the scene frame, shape (3,) [m]."""
        ...


@dataclass(frozen=True)
class FixedPoint:
    """A target that does not move.

    Attributes:
        point: Camera centre, in the scene frame (x, y, z) [m].
        duration: How long a run to it may take [s].
    """

    point: tuple[float, float, float]
    duration: float

    def position(self, time: float) -> Array:  # noqa: ARG002
        """See Path."""
        return np.array(self.point)


@dataclass(frozen=True)
class CubicPath:
    """The curve (-s^3, s, 0.7 s) through a point, s = 0.04 t - 1.

    Attributes:
        middle: Where it is at s = 0 (x, y, z) [m].
        duration: [s].

    Source: eq. traj1_sing and traj2_nosing.
    """

    middle: tuple[float, float, float]
    duration: float = 50.0

    def position(self, time: float) -> Array:
        """See Path."""
        s = 0.04 * time - 1.0
        return np.add(self.middle, (-(s**3), s, 0.7 * s))


@dataclass(frozen=True)
class Quadrifolium:
    """A clover of four leaves in a plane x = constant.

    Attributes:
        middle: Its centre (x, y, z) [m].
        radius: Length of a leaf [m].
        duration: Of one round [s].

    Source: eq. quadrifolium.
    """

    middle: tuple[float, float, float]
    radius: float = 0.3
    duration: float = 20.0

    def position(self, time: float) -> Array:
        """See Path."""
        s = 2.0 * np.pi * time / self.duration
        length = self.radius * np.cos(2.0 * s)
        return np.add(self.middle, (0.0, length * np.cos(s), length * np.sin(s)))


@dataclass(frozen=True, eq=False)
class View:
    """How the camera is turned: the paper says only that all lines are visible, so it is a choice.

    Attributes:
        viewed: Point that the optical axis goes through, in the scene frame (x, y, z) [m].
        seen_from: Camera centre from which it does, for a constant orientation; None: it does from everywhere.
        roll: Turn about the optical axis [rad].
        tilt: Turn about the camera's x axis, before the roll [rad].
    """

    viewed: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seen_from: tuple[float, float, float] | None = None
    roll: float = 0.0
    tilt: float = 0.0

    def pose(self, center: Array) -> Pose:
        """Return T_world_camera of a camera at a centre, shape (3,) [m]."""
        return Pose(self._constant if self.seen_from is not None else self._rotation(center), center)

    @cached_property
    def _constant(self) -> Array:
        return self._rotation(np.array(self.seen_from))

    def _rotation(self, center: Array) -> Array:
        turned = Pose.look_at(center, self.viewed).integrate([0.0, 0.0, 0.0, self.tilt, 0.0, 0.0], 1.0)
        return turned.integrate([0.0, 0.0, 0.0, 0.0, 0.0, self.roll], 1.0).rotation
