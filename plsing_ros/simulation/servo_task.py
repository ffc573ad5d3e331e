# SPDX-License-Identifier: Apache-2.0
"""A servo experiment as data: scene, where from, where to, law, noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters.options import flatten_options
from plsing_ros.parameters.scene import scene_values
from plsing_ros.planning.detour import DetourOptions
from plsing_ros.planning.trajectory_detour import TrajectoryDetour, plan_trajectory
from plsing_ros.simulation.target_paths import FixedPoint, Path, View
from plsing_ros.singularities import singular_set

# The paper does not state it.
TIME_STEP = 0.04  # [s]

# A camera further from where it shall be than this has lost its path, and the run ends.
LOST = 100.0  # [m]


@dataclass(frozen=True, eq=False)
class ServoTask:
    """One run.

    Attributes:
        name: For tables and legends.
        lines: The scene.
        start: Camera centre at the start, shape (3,) [m].
        path: Where the camera shall be.
        view: How it is turned, at the start and on the path.
        gain: lambda [1/s].
        time_step: [s].
        noise: Standard deviation on each Plücker coordinate of the lines in the camera frame.
        noise_on: What has the noise, as the simulator's parameter.
        seed: Of the noise.
        arrived: Distance to a fixed target at which the run ends [m]; 0: it goes on until the path's duration is over.
        law: Parameters of the controller over the plain law, by ROS name.
        avoidance: How to change the path of a moving target where it comes near singular loci; errors are still those
            to the path. None: it stays as it is.
    """

    name: str
    lines: LineSet
    start: Array
    path: Path
    view: View
    gain: float
    time_step: float = TIME_STEP
    noise: float = 0.0
    noise_on: str = "lines"
    seed: int = 0
    arrived: float = 0.0
    law: Mapping[str, Any] = field(default_factory=dict)
    avoidance: DetourOptions | None = None

    @property
    def moving(self) -> bool:
        """Whether the target moves, so that s* is sent anew for each frame."""
        return not isinstance(self.path, FixedPoint)

    @property
    def max_steps(self) -> int:
        """Frames after which the run ends."""
        return round(self.path.duration / self.time_step) + 1

    @cached_property
    def followed(self) -> TrajectoryDetour:
        """What is sent as the target: the path, changed if it is to be."""
        if self.avoidance is None:
            return TrajectoryDetour(self.target_pose, ())
        singular = singular_set(self.lines)
        return plan_trajectory(singular, self.target_pose, self.path.duration, self.avoidance, self.start_pose())

    def start_pose(self) -> Pose:
        """Return T_world_camera at the start."""
        return self.view.pose(self.start)

    def target_pose(self, time: float) -> Pose:
        """Return T_world_camera where the camera shall be at a time [s]."""
        return self.view.pose(self.path.position(time))

    def target_observation(self, time: float, camera_frame: str) -> LineObservation:
        """Return what is sent as the target: what the camera would see where it shall be at a time [s]."""
        pose = self.followed.pose(time)
        return LineObservation.of_lines(self.lines.transformed(pose.inverse(), camera_frame))

    def simulator_values(self) -> dict[str, Any]:
        """Return the simulator's parameters by ROS name."""
        return {
            **scene_values(self.lines),
            **flatten_options({"start": self.start_pose()}),
            "mode": "lockstep",
            "time_step": self.time_step,
            "noise": self.noise,
            "noise_on": self.noise_on,
            "seed": self.seed,
        }

    def controller_values(self) -> dict[str, Any]:
        """Return the controller's parameters by ROS name."""
        return {
            **scene_values(self.lines),
            **flatten_options({"target": self.target_pose(0.0)}),
            "target.source": "topic" if self.moving else "pose",
            # The paper's paths lead through singular points, which the controller would refuse as targets.
            "target.min_inverse_condition_number": 0.0,
            "gain": self.gain,
            # Nor has the paper speed limits.
            "max_linear_speed": 0.0,
            "max_angular_speed": 0.0,
            **self.law,
        }
