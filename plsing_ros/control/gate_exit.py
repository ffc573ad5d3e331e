# SPDX-License-Identifier: Apache-2.0
"""The way out of a closed gate: slow motions after which the camera sees more of its own motion."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.command import Command, Mode
from plsing_ros.errors import PlsingError
from plsing_ros.features import interaction_conditioning
from plsing_ros.geometry import LineSet, Pose

# The fastest that a camera may leave with: |v| [m/s], and |omega| that moves a point 1 m away as fast [rad/s].
LEAVING_SPEED = 0.02
# How far ahead the condition is predicted [s], and by which share it must rise to be no rounding.
_AHEAD, _RISE = 1.0, 1e-3


def leave(command: Command, lines: LineSet, closed: str) -> Command:
    """Return what a closed gate leaves of a command: slow if it leads out, else zero and where out would be.

    Args:
        command: Of the law.
        lines: That it was made for, in the camera's optical frame.
        closed: Why the gate is closed.

    Source: new, docs/howto/thresholds.md.
    """
    if command.mode.moves:
        speed = max(float(np.linalg.norm(command.twist[:3])), float(np.linalg.norm(command.twist[3:])))
        share = min(1.0, LEAVING_SPEED / speed) if speed > 0.0 else 0.0
        twist = share * command.twist
        if share > 0.0 and _rises(lines, twist):
            return command._replace(
                reason=f"{closed}; leaving at {LEAVING_SPEED:g} m/s at most, {_direction_text(twist)}",
                twist=twist,
                output=share * command.output,
                saturated=True,
            )
    return Command(Mode.HALTED, f"{closed}; {_exit_text(lines)}")


def _direction_text(twist: Array) -> str:
    """Return where a twist leads, in words: its largest component."""
    row = int(np.argmax(np.abs(twist[:3])))
    sign = "+" if twist[row] >= 0.0 else "-"
    return f"along {sign}{'xyz'[row]} of the camera's optical frame"


def _exit_text(lines: LineSet) -> str:
    """Return along which axis of the camera the condition rises most, in words."""
    least, best, text = _condition(lines) * (1.0 + _RISE), 0.0, ""
    for row in range(3):
        for sign in (1.0, -1.0):
            twist = np.zeros(6)
            twist[row] = sign * LEAVING_SPEED
            gain = _condition(_moved(lines, twist)) - least
            if gain > best:
                best, text = gain, f"it may leave {_direction_text(twist)}"
    return text or "no straight motion of the camera leads out"


def _rises(lines: LineSet, twist: Array) -> bool:
    return _condition(_moved(lines, twist)) > _condition(lines) * (1.0 + _RISE)


def _moved(lines: LineSet, twist: Array) -> LineSet:
    """Return the lines in the camera frame after a twist, held for a second."""
    ahead = Pose(np.eye(3), np.zeros(3)).integrate(twist, _AHEAD)
    return lines.transformed(ahead.inverse(), lines.frame)


def _condition(lines: LineSet) -> float:
    try:
        return interaction_conditioning(lines).inverse_condition_number
    except PlsingError:
        # A line without an image: nowhere to go to.
        return 0.0
