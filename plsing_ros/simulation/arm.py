# SPDX-License-Identifier: Apache-2.0
"""A six-axis arm with a camera at its wrist: where the camera is, how it moves, and which joints put it somewhere."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from plsing_ros.arrays import Array, checked_array, cross
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import Pose
from plsing_ros.geometry.rotations import exponential, rotation_vector

JOINTS = tuple(f"joint_{i}" for i in range(1, 7))
# Of each joint in the frame of the link before: where its axis passes [m], and its direction.
OFFSETS = np.array([[0, 0, 0.16], [0, 0, 0.14], [0, 0, 0.42], [0, 0, 0.18], [0, 0, 0.2], [0, 0, 0.09]])
AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1]], dtype=float)
# The camera looks along the last axis.
CAMERA_OFFSET = np.array([0.0, 0.0, 0.07])
LIMITS = np.radians([350.0, 130.0, 150.0, 350.0, 125.0, 350.0])

_SEEDS = 24
_ITERATIONS = 60
_EXACT = 1e-9  # [m] and [rad]
# Where the search for joints begins: elbow and wrist bent to either side.
_BENT = np.array([0.0, 0.5, 1.4, 0.0, 1.0, 0.0])


@dataclass(frozen=True)
class Arm:
    """The arm, at a place in the scene.

    Attributes:
        T_world_base: Where its foot is; z is the first axis.
        limits: Of each joint to both sides of zero, where the arm stands upright, shape (6,) [rad].
    """

    T_world_base: Pose
    limits: Array = field(default_factory=lambda: LIMITS)

    def __post_init__(self) -> None:
        object.__setattr__(self, "limits", checked_array("the joint limits", self.limits, (6,)))

    def camera_pose(self, joints: Array) -> Pose:
        """Return T_world_camera, of the optical frame.

        Args:
            joints: Shape (6,) [rad].
        """
        return self._chain(joints)[0]

    def jacobian(self, joints: Array) -> Array:
        """Return the twist (v, omega) of the camera in its optical frame for each joint speed, shape (6, 6).

        Args:
            joints: Shape (6,) [rad].
        """
        pose, points, axes = self._chain(joints)
        levers = cross(axes, pose.translation - points)
        return np.vstack([pose.rotation.T @ levers.T, pose.rotation.T @ axes.T])

    def joints_for(self, T_world_camera: Pose, near: Array | None = None) -> Array:
        """Return joints that put the camera at a pose, shape (6,) [rad], by Newton's method from several starts.

        Args:
            T_world_camera: The pose.
            near: Joints to begin with, (6,); of several solutions one nearby is found then.

        Raises:
            GeometryError: If no joints within the limits are found.
        """
        toward = self.T_world_base.inverse() @ T_world_camera
        turn = float(np.arctan2(toward.translation[1], toward.translation[0]))
        random = np.random.default_rng(0)
        bent = _BENT + np.array([turn, 0.0, 0.0, 0.0, 0.0, 0.0])
        starts = [bent if near is None else near, bent, bent * [1, 1, 1, 1, -1, 1]]
        starts += [random.uniform(-0.8, 0.8) * self.limits * random.uniform(-1, 1, 6) for _ in range(_SEEDS)]
        for start in starts:
            joints = np.array(start, dtype=float)
            for _ in range(_ITERATIONS):
                off = _displacement(self.camera_pose(joints), T_world_camera)
                if np.abs(off).max() < _EXACT:
                    break
                matrix = self.jacobian(joints)
                damping = 1e-4 * min(float(np.abs(off).max()), 1.0)
                step = matrix.T @ np.linalg.solve(matrix @ matrix.T + damping * np.eye(6), off)
                joints += step * min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-12))
            joints = np.mod(joints + np.pi, 2.0 * np.pi) - np.pi
            off = _displacement(self.camera_pose(joints), T_world_camera)
            if np.abs(off).max() < 1e-6 and (np.abs(joints) <= self.limits).all():
                return joints
        x, y, z = np.round(T_world_camera.translation, 4).tolist()
        reach = float(np.linalg.norm(toward.translation))
        raise GeometryError(
            f"the arm cannot put the camera at ({x}, {y}, {z}) with this orientation: that is {reach:.2f} m from its "
            f"foot; it reaches {float(OFFSETS[2:, 2].sum() + CAMERA_OFFSET[2]):.2f} m from its shoulder, "
            f"{float(OFFSETS[:2, 2].sum()):.2f} m above the foot, within the limits of its joints"
        )

    def _chain(self, joints: Array) -> tuple[Pose, Array, Array]:
        """Return T_world_camera, and in the world a point on and the direction of each axis, shape (6, 3) each."""
        rotation, point = self.T_world_base.rotation, self.T_world_base.translation
        points, axes = np.empty((6, 3)), np.empty((6, 3))
        for i, angle in enumerate(joints):
            point = point + rotation @ OFFSETS[i]
            points[i], axes[i] = point, rotation @ AXES[i]
            rotation = rotation @ exponential(angle * AXES[i])[0]
        return Pose(rotation, point + rotation @ CAMERA_OFFSET), points, axes


def _displacement(here: Pose, there: Pose) -> Array:
    """Return the motion from one pose to another in the frame of the first, (position, rotation vector), (6,)."""
    off = here.inverse() @ there
    return np.concatenate([off.translation, rotation_vector(off.rotation)])
