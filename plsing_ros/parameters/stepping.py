# SPDX-License-Identifier: Apache-2.0
"""Parameters that the simulators share: where the camera starts, and how time passes."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.geometry import Pose
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.scene import SceneParameters, pose_from_parameters
from plsing_ros.parameters.transform import TransformParameters


@dataclass(frozen=True)
class SteppingParameters(SceneParameters, TransformParameters):
    """The scene, where a simulated camera starts in it, and when it steps."""

    start_position: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "start.position", "Camera centre at the start, in the scene frame: x, y, z", unit="m"
    )
    start_orientation: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0, 1.0),
        "start.orientation",
        "Orientation of the optical frame at the start, in the scene frame: unit quaternion x, y, z, w",
    )
    mode: str = parameter(
        "realtime",
        "mode",
        "realtime: a step each time_step of the node clock with the latest twist; lockstep: a step when the twist "
        "stamped like the current frame has come, as fast as the machine allows",
        choices=("realtime", "lockstep"),
        live=False,
    )
    time_step: float = parameter(
        0.04, "time_step", "Time between two frames", unit="s", minimum=1e-4, maximum=10.0, live=False
    )
    twist_timeout: float = parameter(
        0.2,
        "twist_timeout",
        "realtime: the camera stands still when the latest twist is older than this",
        unit="s",
        minimum=1e-3,
        maximum=60.0,
    )
    publish_clock: bool = parameter(
        False,
        "publish_clock",
        "lockstep: publish the simulated time on /clock, for nodes with use_sim_time",
        live=False,
    )
    wait_for_status: bool = parameter(
        False, "wait_for_status", "lockstep: wait for the singularity_status of the current frame, too", live=False
    )
    resend_period: float = parameter(
        0.2,
        "resend_period",
        "lockstep: publish the current frame again when its twist has not come after this time of the wall clock",
        unit="s",
        minimum=0.01,
        maximum=60.0,
        live=False,
    )

    def check(self) -> None:
        """Refuse a scene or a start pose that is not one."""
        super().check()
        self.start_pose()

    def start_pose(self) -> Pose:
        """Return T_world_camera at the start."""
        return pose_from_parameters("start", self.start_position, self.start_orientation)
