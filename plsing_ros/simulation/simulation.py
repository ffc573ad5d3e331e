# SPDX-License-Identifier: Apache-2.0
"""The simulator's clockwork without ROS: which frame is current, and when the next one comes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import GeometryError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.parameters import SimulatorParameters
from plsing_ros.simulation.simulated_camera import SimulatedCamera

_SECOND = 1_000_000_000

# The first simulated time [ns]: one second, because a zero stamp means "not set" in ROS.
FIRST_STAMP = _SECOND


@dataclass(frozen=True, eq=False)
class Frame:
    """What the camera sees at one instant.

    Attributes:
        stamp: Its time [ns]; simulated in lockstep, of the node clock in realtime.
        step: Steps since the start or the latest reset.
        T_world_camera: Where the camera is.
        observation: What it sees.
        twist: The twist of the latest step, (v, omega) in the optical frame, shape (6,) [m/s, rad/s].
        reason: Why the camera waits for a usable twist, or empty.
    """

    stamp: int
    step: int
    T_world_camera: Pose
    observation: LineObservation
    twist: Array
    reason: str


class Simulation:
    """A simulated camera with a clock, driven by twists."""

    def __init__(self, parameters: SimulatorParameters) -> None:
        self._parameters = parameters
        self._camera = SimulatedCamera(
            parameters.lines(),
            parameters.start_pose(),
            parameters.camera_frame,
            parameters.noise,
            parameters.seed,
            parameters.noise_on,
        )
        self._stamp = FIRST_STAMP
        self._step = 0
        self._twist: Array | None = None
        self._twist_stamp = 0
        self._status_stamp = 0
        self._applied: Array = np.zeros(6)
        self._reason = "no twist received yet"
        self._idle = True
        self._observation = self._observe()

    def prepare(self, parameters: SimulatorParameters) -> Callable[[], None]:
        """Return what uses a changed scene and noise from the next frame on, and a changed start at the next reset.

        Raises:
            GeometryError: If the scene is too far away to be seen from there, or from where the camera is.
        """
        lines = parameters.lines()
        for pose in (self._camera.T_world_camera, parameters.start_pose()):
            lines.transformed(pose.inverse(), parameters.camera_frame)

        def put_in_force() -> None:
            self._camera.lines = lines
            self._camera.noise = parameters.noise
            self._camera.noise_on = parameters.noise_on
            self._parameters = parameters

        return put_in_force

    def reset(self) -> None:
        """Put the camera back to its start, at rest; the time goes on, so that stamps never go back."""
        self._camera.T_world_camera = self._parameters.start_pose()
        self._step = 0
        self._applied = np.zeros(6)
        self._reason = "no twist received since the reset"
        self._twist = None
        self._next_stamp()
        self._observation = self._observe()

    def receive_twist(self, twist: Array, stamp: int) -> None:
        """Take a twist (v, omega) in the optical frame, shape (6,), for the frame of that stamp [ns].

        In lockstep, a twist for another frame is left alone: it answers a frame that was published twice.
        """
        if self._parameters.mode == "lockstep" and stamp != self._stamp:
            return
        self._twist, self._twist_stamp = twist, stamp

    def refuse_twist(self, reason: str) -> None:
        """Remember that the latest twist cannot be used, and why: the camera stands still."""
        self._twist, self._reason = None, reason

    def receive_status(self, stamp: int) -> None:
        """Take note that the monitor has seen the frame of that stamp [ns]."""
        self._status_stamp = stamp

    def step_in_lockstep(self) -> bool:
        """Step if the twist, and where asked the status, for the current frame are there; return whether it did."""
        if self._twist is None or (self._parameters.wait_for_status and self._status_stamp != self._stamp):
            return False
        moved = self._move(self._twist)
        self._twist = None
        if moved:
            self._next_stamp()
            self._observation = self._observe()
        return moved

    def step_in_realtime(self, now: int) -> None:
        """Step by time_step up to now [ns] with the latest twist, or stand still if that is too old."""
        if self._twist is not None:
            age = (now - self._twist_stamp) / _SECOND
            if age <= self._parameters.twist_timeout:
                self._move(self._twist)
            else:
                self._applied = np.zeros(6)
                self._reason = f"latest twist is {age:.3g} s old, allowed are {self._parameters.twist_timeout:g} s"
        else:
            self._applied = np.zeros(6)
        self._stamp = now
        self._observation = self._observe()

    def idle_since_last_call(self) -> bool:
        """Return whether no step was made since this was last asked."""
        idle, self._idle = self._idle, True
        return idle

    def frame(self) -> Frame:
        """Return the current frame; the same, noise included, until the next step."""
        return Frame(
            self._stamp, self._step, self._camera.T_world_camera, self._observation, self._applied, self._reason
        )

    def _observe(self) -> LineObservation:
        seen = self._camera.observe()
        return dataclasses.replace(seen, lines_camera=None) if self._parameters.image_only else seen

    def _move(self, twist: Array) -> bool:
        try:
            self._camera.move(twist, self._parameters.time_step)
        except GeometryError as error:
            self.refuse_twist(str(error))
            return False
        self._step += 1
        self._applied, self._reason, self._idle = twist, "", False
        return True

    def _next_stamp(self) -> None:
        self._stamp += round(self._parameters.time_step * _SECOND)
