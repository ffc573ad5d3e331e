# SPDX-License-Identifier: Apache-2.0
"""The feature simulator without ROS: a free-flying camera that sees lines."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.parameters import SimulatorParameters
from plsing_ros.simulation.simulated_camera import SimulatedCamera
from plsing_ros.simulation.stepping import SteppedSimulation


class Simulation(SteppedSimulation):
    """A simulated camera with a clock, driven by twists.

    Attributes:
        observation: What the camera sees in the current frame; the same, noise included, until the next step.
    """

    observation: LineObservation

    def __init__(self, parameters: SimulatorParameters) -> None:
        super().__init__(parameters)
        self._parameters = parameters
        self._camera = SimulatedCamera(
            parameters.lines(),
            parameters.start_pose(),
            parameters.camera_frame,
            parameters.noise,
            parameters.seed,
            parameters.noise_on,
        )
        self.look()

    @property
    def T_world_camera(self) -> Pose:
        """Where the camera is."""
        return self._camera.T_world_camera

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
            self._parameters = self._stepping = parameters

        return put_in_force

    def go_to_start(self) -> None:
        """Put the camera back to its start."""
        self._camera.T_world_camera = self._parameters.start_pose()

    def carry_out(self, twist: Array, duration: float) -> Array:
        """Move the camera exactly as it is told."""
        self._camera.move(twist, duration)
        return twist

    def look(self) -> None:
        """Draw the noise of the current frame."""
        seen = self._camera.observe()
        self.observation = dataclasses.replace(seen, lines_camera=None) if self._parameters.image_only else seen
