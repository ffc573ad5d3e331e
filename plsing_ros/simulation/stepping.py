# SPDX-License-Identifier: Apache-2.0
"""A simulator's clockwork without ROS: which frame is current, when the next one comes, and which twist leads there."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import GeometryError
from plsing_ros.parameters.stepping import SteppingParameters

_SECOND = 1_000_000_000

# The first simulated time [ns]: one second, because a zero stamp means "not set" in ROS.
FIRST_STAMP = _SECOND


class SteppedSimulation:
    """Base of simulators that are driven by twists, in lockstep or in real time.

    Attributes:
        stamp: Time of the current frame [ns]; simulated in lockstep, of the node clock in realtime.
        step: Steps since the start or the latest reset.
        twist: The twist of the latest step, (v, omega) in the optical frame, shape (6,) [m/s, rad/s].
        reason: Why the camera waits for a usable twist, or empty.
        remark: What kept it from following the latest twist exactly, or empty.
    """

    def __init__(self, parameters: SteppingParameters) -> None:
        self._stepping = parameters
        self.stamp = FIRST_STAMP
        self.step = 0
        self.twist: Array = np.zeros(6)
        self.reason = "no twist received yet"
        self.remark = ""
        self._received: Array | None = None
        self._received_stamp = 0
        self._status_stamp = 0
        self._idle = True

    def carry_out(self, twist: Array, duration: float) -> Array:
        """Move with a twist for a time [s], and return the twist that was carried out.

        Raises:
            GeometryError: If that is impossible; nothing has moved then.
        """
        raise NotImplementedError

    def look(self) -> None:
        """Take the picture of the current frame."""
        raise NotImplementedError

    def go_to_start(self) -> None:
        """Put the camera back to its start."""
        raise NotImplementedError

    def reset(self) -> None:
        """Put the camera back to its start, at rest; the time goes on, so that stamps never go back."""
        self.go_to_start()
        self.step = 0
        self.twist = np.zeros(6)
        self.reason, self.remark = "no twist received since the reset", ""
        self._received = None
        self._next_stamp()
        self.look()

    def receive_twist(self, twist: Array, stamp: int) -> None:
        """Take a twist (v, omega) in the optical frame, shape (6,), for the frame of that stamp [ns].

        In lockstep, a twist for another frame is left alone: it answers a frame that was published twice.
        """
        if self._stepping.mode == "lockstep" and stamp != self.stamp:
            return
        self._received, self._received_stamp = twist, stamp

    def refuse_twist(self, reason: str) -> None:
        """Remember that the latest twist cannot be used, and why: the camera stands still."""
        self._received, self.reason = None, reason

    def receive_status(self, stamp: int) -> None:
        """Take note that the monitor has seen the frame of that stamp [ns]."""
        self._status_stamp = stamp

    def step_in_lockstep(self) -> bool:
        """Step if the twist, and where asked the status, for the current frame are there; return whether it did."""
        if self._received is None or (self._stepping.wait_for_status and self._status_stamp != self.stamp):
            return False
        moved = self._move(self._received)
        self._received = None
        if moved:
            self._next_stamp()
            self.look()
        return moved

    def step_in_realtime(self, now: int) -> None:
        """Step by time_step up to now [ns] with the latest twist, or stand still if that is too old."""
        if self._received is not None:
            age = (now - self._received_stamp) / _SECOND
            if age <= self._stepping.twist_timeout:
                self._move(self._received)
            else:
                self.twist = np.zeros(6)
                self.reason = f"latest twist is {age:.3g} s old, allowed are {self._stepping.twist_timeout:g} s"
        else:
            self.twist = np.zeros(6)
        self.stamp = now
        self.look()

    def idle_since_last_call(self) -> bool:
        """Return whether no step was made since this was last asked."""
        idle, self._idle = self._idle, True
        return idle

    def _move(self, twist: Array) -> bool:
        try:
            self.twist = self.carry_out(twist, self._stepping.time_step)
        except GeometryError as error:
            self.refuse_twist(str(error))
            return False
        self.step += 1
        self.reason, self._idle = "", False
        return True

    def _next_stamp(self) -> None:
        self.stamp += round(self._stepping.time_step * _SECOND)
