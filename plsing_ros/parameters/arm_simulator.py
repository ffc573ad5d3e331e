# SPDX-License-Identifier: Apache-2.0
"""Parameters of the arm simulator."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.geometry import Pose
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.scene import pose_from_parameters
from plsing_ros.parameters.stepping import SteppingParameters


@dataclass(frozen=True)
class ArmSimulatorParameters(SteppingParameters):
    """An arm with a camera at its wrist before the object of model.*, and how its images are drawn."""

    arm_position: tuple[float, ...] = parameter(
        (-0.45, 0.0, 0.0), "arm.position", "Foot of the arm, in the scene frame: x, y, z", unit="m", live=False
    )
    arm_orientation: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0, 1.0),
        "arm.orientation",
        "Orientation of the foot (z is the first axis), in the scene frame: unit quaternion x, y, z, w",
        live=False,
    )
    max_joint_speed: float = parameter(
        1.5,
        "arm.max_joint_speed",
        "Limit of each joint's speed; a faster motion is slowed down as a whole",
        unit="rad/s",
        minimum=1e-3,
        maximum=100.0,
    )
    width: int = parameter(640, "camera.width", "Of the image, in pixels", minimum=16, maximum=4096, live=False)
    height: int = parameter(480, "camera.height", "Of the image, in pixels", minimum=16, maximum=4096, live=False)
    focal_length: float = parameter(
        600.0, "camera.focal_length", "Of the camera, in pixels", minimum=10.0, maximum=1e5, live=False
    )
    encoding: str = parameter("mono8", "camera.encoding", "Of the image", choices=("mono8", "bgr8"), live=False)
    gamma: float = parameter(
        2.2,
        "gamma",
        "Exponent from grey levels to light; the line tracker must have the same",
        minimum=0.3,
        maximum=4.0,
        live=False,
    )
    light: float = parameter(
        1.0, "light", "Brightness of the light, as a factor: 0 is dark", minimum=0.0, maximum=100.0
    )
    image_noise: float = parameter(
        2.0, "image.noise", "Standard deviation of the noise of each pixel, in grey levels", minimum=0.0, maximum=128.0
    )
    texture: int = parameter(
        8,
        "texture",
        "Patches of another brightness on each face of four corners",
        minimum=0,
        maximum=200,
        live=False,
    )
    renderer: str = parameter(
        "auto",
        "renderer",
        "mujoco: MuJoCo draws object, table and arm; polygons: OpenCV draws the object alone; auto: mujoco where it is "
        "installed, else polygons",
        choices=("auto", "mujoco", "polygons"),
        live=False,
    )
    samples: int = parameter(
        4,
        "mujoco.samples",
        "Samples of each pixel, against stairs along edges; 0: one",
        minimum=0,
        maximum=16,
        live=False,
    )
    shadows: bool = parameter(
        False, "mujoco.shadows", "Whether the lamp casts shadows: too slow for real time without a graphics card"
    )
    seed: int = parameter(0, "seed", "Seed of texture and noise", minimum=0, maximum=2**31 - 1, live=False)

    def check(self) -> None:
        """Refuse an object, or a place of the arm, that is none."""
        super().check()
        self.model()
        _ = self.T_world_base

    @property
    def T_world_base(self) -> Pose:
        """Where the arm's foot is in the scene."""
        return pose_from_parameters("arm", self.arm_position, self.arm_orientation)
