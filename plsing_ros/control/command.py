# SPDX-License-Identifier: Apache-2.0
"""What the controller decides in one cycle."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.levels import MessageWord

_ZERO = np.zeros(6)
_ZERO.setflags(write=False)


class Mode(MessageWord):
    """What the controller is doing; values as in plsing_msgs/ControllerState."""

    WAITING = 0
    SERVOING = 1
    CONVERGED = 2
    HALTED = 3
    DISABLED = 4
    STALLED = 5
    REFUSED = 6

    @property
    def moves(self) -> bool:
        """Whether the law's twist is commanded; zero otherwise."""
        return self in (Mode.SERVOING, Mode.CONVERGED, Mode.STALLED)


class Command(NamedTuple):
    """What to do now.

    Attributes:
        mode: What the controller is doing.
        reason: Why, in words; empty while servoing as the law asks.
        twist: (v, omega) of the camera in its optical frame, shape (6,) [m/s, rad/s]; always finite, zero unless the
            mode moves; not to be published while waiting.
        output: The same motion as the twist of the tool, in tool_frame, shape (6,); the twist itself without one.
        error_norm: |s - s*|, 0 if unknown.
        gain: lambda of this cycle [1/s], 0 if unknown.
        inverse_condition_number: Of the matrix that was inverted, 0 if unknown.
        singular_values: Of the matrix that was inverted, largest first, shape (6,); zeros if unknown, and beyond the
            degrees of freedom in use.
        damping: Applied to the smallest singular value, in its units.
        scale: What the guard left of the law's speed, in [0, 1].
        saturated: Whether the twist was scaled down to the speed limits.
        path_progress: How much of a planned path is done, in [0, 1]; 0 without one.
    """

    mode: Mode
    reason: str = ""
    twist: Array = _ZERO
    output: Array = _ZERO
    error_norm: float = 0.0
    gain: float = 0.0
    inverse_condition_number: float = 0.0
    singular_values: Array = _ZERO
    damping: float = 0.0
    scale: float = 1.0
    saturated: bool = False
    path_progress: float = 0.0

    def __str__(self) -> str:
        why = f": {self.reason}" if self.reason else ""
        speeds = (math.hypot(*self.twist[:3]), math.hypot(*self.twist[3:]))
        return f"{self.mode.name}{why}; |v| {speeds[0]:.3g} m/s, |omega| {speeds[1]:.3g} rad/s"
