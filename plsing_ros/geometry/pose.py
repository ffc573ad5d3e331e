# SPDX-License-Identifier: Apache-2.0
"""Rigid poses, and the motion of a frame under a constant twist."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plsing_ros import _core
from plsing_ros.arrays import Array, checked_array, shaped_array
from plsing_ros.errors import GeometryError
from plsing_ros.geometry.rotations import exponential, quaternion_from_rotation, rotation_from_quaternion

_TOLERANCE = 1e-6

# Coordinates up to which products of a few lengths are still finite numbers.
FARTHEST = 1e50  # [m]
# Of a longer one, too few digits would be left for where the frame ends up.
_LONGEST_STEP = 1e9  # [m] or [rad]


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid transform T_a_b: p_a = rotation @ p_b + translation. The frames are in the variable's name.

    Attributes:
        rotation: Rotation matrix, shape (3, 3).
        translation: Origin of frame b in frame a, shape (3,) [m].

    Raises:
        GeometryError: If a value is not finite, a shape is wrong, rotation is not a rotation, or translation is beyond
            1e50 m.
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        rotation = shaped_array("rotation", self.rotation, (3, 3))
        translation = checked_position("translation", self.translation)
        if not _core.is_rotation(rotation, _TOLERANCE):
            checked_array("rotation", rotation, (3, 3))
            error = np.abs(rotation @ rotation.T - np.eye(3)).max()
            raise GeometryError(
                f"rotation {rotation.tolist()} is not a rotation matrix (R R^T differs from I by {error:.3g}, "
                f"determinant {np.linalg.det(rotation):.6g})"
            )
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @classmethod
    def from_quaternion(cls, translation: npt.ArrayLike, quaternion_xyzw: npt.ArrayLike) -> Pose:
        """Build a pose from a position [m], shape (3,), and a unit quaternion (x, y, z, w), shape (4,).

        Raises:
            GeometryError: If a value is not finite or the quaternion's length differs from 1 by more than 1e-3.
        """
        quaternion = checked_array("quaternion", quaternion_xyzw, (4,))
        length = math.hypot(*quaternion.tolist())
        if abs(length - 1.0) > 1e-3:
            raise GeometryError(f"quaternion {quaternion.tolist()} (x, y, z, w) has length {length:.6g}, expected 1")
        return cls(rotation_from_quaternion(quaternion), checked_position("translation", translation))

    @classmethod
    def look_at(cls, center: npt.ArrayLike, at: npt.ArrayLike, down: npt.ArrayLike = (0.0, 0.0, -1.0)) -> Pose:
        """Return T_world_camera of a camera (optical frame: z forward, y down) whose optical axis passes a point.

        Args:
            center: Camera centre in the world, shape (3,) [m].
            at: The point on the optical axis, in the world, shape (3,) [m].
            down: World direction that appears downwards in the image, of any length but zero, shape (3,).

        Raises:
            GeometryError: If the point is the camera centre, down is zero or along the optical axis, or one of them is
                not three finite numbers, up to 1e50 m.
        """
        origin = checked_position("center", center)
        forward = checked_position("at", at) - origin
        if not np.linalg.norm(forward) > 0.0:
            raise GeometryError(f"the camera at {origin.tolist()} cannot look at its own centre")
        z = forward / np.linalg.norm(forward)
        downwards = checked_position("down", down)
        x = np.cross(downwards, z)
        if np.linalg.norm(x) <= 1e-9 * np.linalg.norm(downwards):
            raise GeometryError(f"down = {downwards.tolist()} is zero or along the optical axis {z.tolist()}")
        x /= np.linalg.norm(x)
        return cls(np.column_stack([x, np.cross(z, x), z]), origin)

    @property
    def quaternion_xyzw(self) -> Array:
        """The rotation as a unit quaternion (x, y, z, w), shape (4,)."""
        return quaternion_from_rotation(self.rotation)

    def __str__(self) -> str:
        position = ", ".join(f"{each:.4g}" for each in self.translation)
        quaternion = ", ".join(f"{each:.4g}" for each in self.quaternion_xyzw)
        return f"pose: position ({position}) m, quaternion x, y, z, w ({quaternion})"

    def inverse(self) -> Pose:
        """Return T_b_a of this T_a_b."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: Pose) -> Pose:
        """T_a_c = T_a_b @ T_b_c."""
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def is_close(self, other: Pose, tolerance: float) -> bool:
        """Return whether every element of rotation and translation [m] differs by less than a tolerance."""
        apart = np.abs(self.translation - other.translation).max()
        return bool(max(apart, np.abs(self.rotation - other.rotation).max()) < tolerance)

    def integrate(self, twist: npt.ArrayLike, duration: float) -> Pose:
        """Return the pose of frame b after it moved with a constant twist, expressed in itself.

        Exact for any twist (no integration step error): T_a_b exp([twist] duration).

        Args:
            twist: (v, omega) of frame b in its own coordinates, shape (6,) [m/s, rad/s].
            duration: [s].

        Raises:
            GeometryError: If the twist is not finite, or a step of more than 1e9 m or rad.

        Source: the exponential of se(3); tested against scipy.linalg.expm.
        """
        velocity = checked_array("twist", twist, (6,))
        # Plain numbers may overflow without a warning.
        longest = max(abs(each * duration) for each in velocity.tolist())
        if not longest <= _LONGEST_STEP:
            raise GeometryError(
                f"twist {velocity.tolist()} over {duration:g} s is a step of {longest:.3g} m or rad; "
                f"allowed are {_LONGEST_STEP:g}"
            )
        step = velocity * duration
        turn, mean_turn = exponential(step[3:])
        # Renormalised through the quaternion, so that millions of steps do not drift off SO(3).
        rotation = rotation_from_quaternion(quaternion_from_rotation(self.rotation @ turn))
        translation = self.translation + self.rotation @ (mean_turn @ step[:3])
        return Pose(rotation, translation)


def checked_twist(name: str, value: npt.ArrayLike) -> Array:
    """Return a twist (v, omega) as a read-only array, shape (6,) [m/s, rad/s], after checking it.

    Args:
        name: What it is, for the message.
        value: Anything numpy turns into six floats.

    Raises:
        GeometryError: If value is not six finite numbers, or one is beyond 1e50 m/s or rad/s, whose squares overflow.
    """
    twist = checked_array(name, value, (6,))
    if max(map(abs, twist.tolist())) > FARTHEST:
        raise GeometryError(f"{name} is {twist.tolist()}; up to {FARTHEST:.0e} m/s or rad/s can be computed with")
    return twist


def checked_center(name: str, pose_or_center: Pose | npt.ArrayLike) -> Array:
    """Return a camera centre as checked_position does; of a pose T_world_camera its translation, shape (3,) [m].

    Raises:
        GeometryError: If it is not three finite numbers, or beyond FARTHEST.
    """
    if isinstance(pose_or_center, Pose):
        return pose_or_center.translation
    return checked_position(name, pose_or_center)


def checked_position(name: str, value: npt.ArrayLike) -> Array:
    """Return a position as a new, read-only array, shape (3,) [m], after checking it.

    Args:
        name: What it is, for the message.
        value: Anything numpy turns into three floats [m].

    Raises:
        GeometryError: If value is not three finite numbers, or beyond FARTHEST.
    """
    position = shaped_array(name, value, (3,))
    x, y, z = position.tolist()
    # Plain comparisons, because every cycle needs this; false for what is not a number.
    if not (-FARTHEST <= x <= FARTHEST and -FARTHEST <= y <= FARTHEST and -FARTHEST <= z <= FARTHEST):
        checked_array(name, position, (3,))
        raise GeometryError(f"{name} is {[x, y, z]} m; coordinates up to {FARTHEST:.0e} m can be computed with")
    return position
