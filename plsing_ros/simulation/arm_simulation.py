# SPDX-License-Identifier: Apache-2.0
"""The arm simulator without ROS: joints that follow twists, and what the camera at the wrist sees."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.errors import GeometryError, PlsingError
from plsing_ros.geometry import Pose
from plsing_ros.parameters.arm_simulator import ArmSimulatorParameters
from plsing_ros.simulation.arm import Arm
from plsing_ros.simulation.arm_motion import follow_twist
from plsing_ros.simulation.mujoco_renderer import MujocoRenderer
from plsing_ros.simulation.polygon_renderer import PolygonRenderer, random_patches
from plsing_ros.simulation.stepping import SteppedSimulation
from plsing_ros.tracking.camera import PinholeCamera

_TABLE = 0.25  # light that the table reflects
_DARKEST, _BRIGHTEST = 0.2, 0.9  # face


class ArmSimulation(SteppedSimulation):
    """An arm with a camera at its wrist before an object.

    Attributes:
        camera: The camera.
        joints: Of the arm, shape (6,) [rad].
        speeds: Of the joints in the latest step, shape (6,) [rad/s].
        image: What the camera sees in the current frame, (height, width), or (height, width, 3) in blue, green, red.
        renderer: What draws, as a sentence.
    """

    def __init__(self, parameters: ArmSimulatorParameters) -> None:
        """Put the arm at its start.

        Raises:
            PlsingError: If the arm cannot reach the start, or what draws is not installed.
        """
        super().__init__(parameters)
        self._parameters = parameters
        self._model = parameters.model()
        center = 0.5 * (parameters.width - 1), 0.5 * (parameters.height - 1)
        focal = parameters.focal_length
        self.camera = PinholeCamera(parameters.width, parameters.height, focal, focal, *center)
        self._arm = Arm(parameters.T_world_base)
        self._start = self._arm.joints_for(parameters.start_pose())
        self._random = np.random.default_rng(parameters.seed)
        self._levels = 255.0 * (np.arange(256) / 255.0) ** (1.0 / parameters.gamma)
        self._draw = self._make_renderer()
        self.go_to_start()
        self.look()

    @property
    def T_world_camera(self) -> Pose:
        """Where the camera is."""
        return self._arm.camera_pose(self.joints)

    def prepare(self, parameters: ArmSimulatorParameters) -> Callable[[], None]:
        """Return what uses changed light and limits from the next frame on, and a changed start at the next reset.

        Raises:
            GeometryError: If the arm cannot reach the start.
        """
        start = self._start
        if parameters.start_pose() != self._parameters.start_pose():
            start = self._arm.joints_for(parameters.start_pose())

        def put_in_force() -> None:
            self._start = start
            self._parameters = self._stepping = parameters

        return put_in_force

    def go_to_start(self) -> None:
        """Put the arm back to its start."""
        self.joints = self._start
        self.speeds: Array = np.zeros(6)

    def carry_out(self, twist: Array, duration: float) -> Array:
        """Move the joints with the twist, by the midpoint rule, and return what became of it."""
        if not np.isfinite(twist).all():
            raise GeometryError("the twist is not finite")
        speed = self._parameters.max_joint_speed
        half = self.joints + 0.5 * duration * follow_twist(self._arm, self.joints, twist, speed, duration).speeds
        motion = follow_twist(self._arm, half, twist, speed, duration)
        self.joints = np.clip(self.joints + duration * motion.speeds, -self._arm.limits, self._arm.limits)
        self.speeds, self.remark = motion.speeds, motion.reason
        carried: Array = self._arm.jacobian(half) @ motion.speeds
        return carried

    def look(self) -> None:
        """Draw the current frame, with its noise."""
        parameters = self._parameters
        light = np.minimum(parameters.light * self._draw(), 255.0)
        grey = np.interp(light, np.arange(256), self._levels)
        if parameters.image_noise > 0.0:
            shape = grey.shape[:2]
            noise = self._random.standard_normal(shape, dtype=np.float32) * np.float32(parameters.image_noise)
            grey = grey + (noise if grey.ndim == 2 else noise[..., np.newaxis])
        self.image: npt.NDArray[np.uint8] = np.clip(np.rint(grey), 0, 255).astype(np.uint8)

    def look_at(self, joints: Array) -> npt.NDArray[np.uint8] | None:
        """Return a picture of the arm from outside, (480, 640, 3) in red, green, blue; None where polygons are drawn.

        Args:
            joints: Of the arm, shape (6,) [rad].
        """
        return self._mujoco.render(joints, "outside") if self._mujoco is not None else None

    def close(self) -> None:
        """Give back what the pictures are drawn in."""
        if self._mujoco is not None:
            self._mujoco.close()

    def _make_renderer(self) -> Callable[[], Array]:
        """Choose what draws, and return what gives the light of the current frame, from 0 to 255 and above."""
        parameters, model = self._parameters, self._model
        random = np.random.default_rng(parameters.seed)
        lights = random.permutation(np.linspace(_DARKEST, _BRIGHTEST, len(model.faces))).tolist()
        patches = random_patches(model, parameters.texture, random)
        grey = parameters.encoding == "mono8"
        self._mujoco: MujocoRenderer | None = None
        self.renderer = "MuJoCo draws"
        if parameters.renderer != "polygons":
            try:
                mujoco = self._mujoco = MujocoRenderer(
                    model, self.camera, self._arm, lights, patches, _TABLE, parameters.samples
                )
            except PlsingError as error:
                if parameters.renderer == "mujoco":
                    raise
                self.renderer = f"OpenCV draws the object alone: {error}"
            else:

                def by_mujoco() -> Array:
                    picture = mujoco.render(self.joints, shadows=self._parameters.shadows)
                    return np.asarray(picture[..., 1] if grey else picture[..., ::-1], dtype=float)

                return by_mujoco
        else:
            self.renderer = "OpenCV draws the object alone"
        polygons = PolygonRenderer(model, self.camera, lights, _TABLE, patches, gamma=1.0)

        def by_polygons() -> Array:
            picture = polygons.render(self.T_world_camera.inverse()).astype(float)
            return picture if grey else np.repeat(picture[..., np.newaxis], 3, axis=2)

        return by_polygons
