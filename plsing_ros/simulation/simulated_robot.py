# SPDX-License-Identifier: Apache-2.0
"""A robot that carries a camera: it moves late, with a lag, and no faster than it can."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose

# Speeds beyond this are not followed, so that every number stays finite [m/s, rad/s].
_FASTEST = 1e6


class SimulatedRobot:
    """Carries out twists of the camera.

    Attributes:
        T_world_camera: Where the camera is.
    """

    def __init__(
        self,
        T_world_camera: Pose,
        period: float,
        latency: int = 0,
        jitter: float = 0.0,
        lag: float = 0.0,
        limits: tuple[float, float] = (math.inf, math.inf),
        generator: np.random.Generator | None = None,
    ) -> None:
        """Place it, at rest.

        Args:
            T_world_camera: Where the camera begins.
            period: Between two twists [s].
            latency: Twists after which one is carried out.
            jitter: Standard deviation of what comes on top of it, in twists.
            lag: Time constant of the speed [s].
            limits: Of |v| and |omega|; a faster twist is scaled down as a whole [m/s, rad/s].
            generator: Of the jitter.
        """
        self.T_world_camera = T_world_camera
        self._period, self._latency, self._jitter, self._lag = period, latency, jitter, lag
        self._limits = np.array(limits)
        self._generator = np.random.default_rng(0) if generator is None else generator
        self._twists: list[Array] = [np.zeros(6)]
        self._done = 0
        self._motion: Array = np.zeros(6)

    def step(self, twist: Array) -> None:
        """Take a twist (v, omega) in the optical frame, shape (6,) [m/s, rad/s], and move for one period."""
        self._twists.append(twist)
        late = self._latency + round(abs(self._jitter * self._generator.normal()))
        # A later twist never gives way to an earlier one.
        self._done = max(self._done, len(self._twists) - 1 - late)
        wanted = self._twists[self._done]
        speeds = np.linalg.norm(wanted.reshape(2, 3), axis=1)
        wanted = wanted * min(1.0, *(self._limits / np.maximum(speeds, 1e-12)))
        mean = wanted
        if self._lag > 0.0:
            left = math.exp(-self._period / self._lag)
            mean = wanted + (self._lag * (1.0 - left) / self._period) * (self._motion - wanted)
            self._motion = wanted + left * (self._motion - wanted)
        fastest = max(float(np.abs(mean).max()), 1e-12)
        self.T_world_camera = self.T_world_camera.integrate(mean * min(1.0, _FASTEST / fastest), self._period)
