# SPDX-License-Identifier: Apache-2.0
"""The motions a camera cannot see at a singular centre: translations and screws."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, cross
from plsing_ros.features.rank_basis import rank_bases
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.pose import checked_center

# Share of the largest singular value of the row-normalised xi up to which a motion counts as invisible.
_TOLERANCE = 1e-6

# Distance of a line to the centre, in the root mean square one, up to which the centre is on it.
_ON_LINE = 1e-12


class MotionKind(enum.Enum):
    """What a unobservable motion is."""

    TRANSLATION = "translation"
    ROTATION = "rotation"
    SCREW = "screw"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, eq=False)
class UnobservableMotion:
    """A motion of the camera that moves no image line, in the frame of the lines.

    Attributes:
        kind: TRANSLATION, SCREW, or ROTATION for a screw without pitch.
        linear: Velocity v of the camera centre, shape (3,) [m/s]; of unit length for a translation.
        angular: Angular velocity, shape (3,) [rad/s]; zero for a translation, else of unit length.
        axis_point: The point of the screw axis closest to the camera centre, shape (3,) [m]; the camera centre itself
            for a translation.
        pitch: Advance along the axis [m/rad]; infinite for a translation.
        residual: The singular value of the row-normalised xi that belongs to it, over the largest one.
    """

    kind: MotionKind
    linear: Array
    angular: Array
    axis_point: Array
    pitch: float
    residual: float

    def __str__(self) -> str:
        vector = self.linear if self.kind is MotionKind.TRANSLATION else self.angular
        text = f"{self.kind} along ({', '.join(f'{value:.4g}' for value in vector)})"
        if self.kind is MotionKind.TRANSLATION:
            return text
        point = ", ".join(f"{value:.4g}" for value in self.axis_point)
        return f"{text} about an axis through ({point}), pitch {self.pitch:.4g} m/rad"


def unobservable_motions(lines: LineSet, pose_or_center: Pose | npt.ArrayLike) -> tuple[UnobservableMotion, ...]:
    """Return a basis of the motions that move no image line: translations first, as many as there are.

    Args:
        lines: The observed lines.
        pose_or_center: The camera centre in the frame of the lines, shape (3,) [m], or T_world_camera.

    Returns:
        None at a regular centre, one at a general singular one, more at special ones.

    Raises:
        GeometryError: If the centre is not three finite numbers, or beyond 1e50 m.

    Source: remarks kern and singll, with the xi of docs/theory.md.
    """
    center = checked_center("pose_or_center", pose_or_center)
    point = lines.point
    distance = float(np.sqrt((cross(point - center, lines.direction) ** 2).sum(axis=1).mean()))
    unit = distance if distance > 0.0 else 1.0
    relative = (point - center) / unit
    xi = rank_bases(lines.direction, relative, np.zeros((1, 3)), normalized=True, on_line=_ON_LINE)[0]
    if len(xi) < 6:
        xi = np.concatenate([xi, np.zeros((6 - len(xi), 6))])
    _, singular_values, right = np.linalg.svd(xi)
    size = singular_values / (singular_values[0] if singular_values[0] > 0.0 else 1.0)
    lost = size <= _TOLERANCE
    kernel = right[lost]
    if len(kernel) == 0:
        return ()
    # Separate the combinations without rotation from the rest.
    _, turning, mix = np.linalg.svd(kernel[:, 3:].T)
    rank = int((turning > 1e-6).sum())
    separated = np.concatenate([mix[rank:], mix[:rank]]) @ kernel
    residual = float(size[lost].max())
    return tuple(
        _described(motion, unit, center, residual, i < len(kernel) - rank) for i, motion in enumerate(separated)
    )


def _described(motion: Array, unit: float, center: Array, residual: float, translation: bool) -> UnobservableMotion:
    """Turn a kernel vector in the unit of length of xi into metres and a screw."""
    linear, angular = motion[:3] * unit, motion[3:]
    if translation:
        linear = _signed(linear / np.linalg.norm(linear))
        return UnobservableMotion(MotionKind.TRANSLATION, linear, np.zeros(3), center.copy(), float("inf"), residual)
    speed = float(np.linalg.norm(angular))
    sign = 1.0 if angular[np.argmax(np.abs(angular))] > 0.0 else -1.0
    linear, angular = sign * linear / speed, sign * angular / speed
    pitch = float(linear @ angular)
    kind = MotionKind.ROTATION if abs(pitch) <= 1e-9 * unit else MotionKind.SCREW
    return UnobservableMotion(kind, linear, angular, center + cross(angular, linear), pitch, residual)


def _signed(vector: Array) -> Array:
    """Return vector or its opposite, with the largest component positive."""
    return vector if vector[np.argmax(np.abs(vector))] > 0.0 else -vector
