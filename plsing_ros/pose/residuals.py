# SPDX-License-Identifier: Apache-2.0
"""Residuals of image lines in standard deviations, for many poses at once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array, BoolArray
from plsing_ros.geometry import LineSet


@dataclass(frozen=True)
class LineNoise:
    """Standard deviations of independent Gaussian noise, of three possible origins that add up.

    Attributes:
        image: Of each image line: angle [rad] and offset l'_z.
        scene: Of each Plücker coordinate of the lines in the world frame, unit directions and moments [m].
        camera: Of each Plücker coordinate of the lines in the camera frame, from which the images are then made.
    """

    image: float
    scene: float = 0.0
    camera: float = 0.0


def residual_settings(noise: LineNoise, max_angle: float = math.pi / 2) -> Array:
    """Return what residuals depend on besides lines, shape (4,).

    Args:
        noise: Of images and lines.
        max_angle: Half of the field of view [rad], up to pi/2.
    """
    return np.array([noise.image, noise.scene, noise.camera, math.cos(max_angle)])


def known_lines(lines: LineSet) -> Array:
    """Return what residuals need of lines in the world, shape (n, 11).

    Direction, moment, and how well the line is known: pivot, position_std, direction_std.
    """
    return np.column_stack([lines.direction, lines.moment, lines.pivot, lines.position_std, lines.direction_std])


@dataclass(frozen=True, eq=False)
class Residuals:
    """What k poses make of n image lines.

    Attributes:
        table: Of _core.image_residuals, shape (k, 7, n).
        arguments: What it was made from.
    """

    table: Array
    arguments: tuple[Array, Array, Array, Array, Array]

    @property
    def raw(self) -> Array:
        """Angle [rad] and offset of the lines minus the observed ones, shape (k, 2, n)."""
        return self.table[:, :2]

    @property
    def value(self) -> Array:
        """The same, whitened: uncorrelated and in standard deviations."""
        return self.table[:, 2:4]

    @cached_property
    def squared(self) -> Array:
        """Squared Mahalanobis distance of each line, shape (k, n)."""
        squared: Array = self.table[:, 2] ** 2 + self.table[:, 3] ** 2
        return squared

    @property
    def log_determinant(self) -> Array:
        """Of each line's covariance, shape (k, n)."""
        return self.table[:, 6]

    @property
    def reversed(self) -> BoolArray:
        """Which lines are seen against their direction, shape (k, n)."""
        return np.asarray(self.table[:, 4] > 0.0)

    @property
    def hidden(self) -> BoolArray:
        """Which lines have no part in front of the camera and within its field of view, shape (k, n)."""
        return np.asarray(self.table[:, 5] > 0.0)

    @cached_property
    def jacobian(self) -> Array:
        """Derivative of value by the twist (v, omega) of the camera in its own frame, shape (k, 2, n, 6)."""
        return _core.image_jacobians(*self.arguments)


class ImageResiduals:
    """The residuals of one image as a function of the pose.

    Args:
        lines: Of known_lines, shape (n, 11).
        image_lines: Observed l', shape (n, 3).
        settings: Of residual_settings.
        covariances: Of each image line, as in LineObservation, shape (n, 3); None: as the settings say.

    Attributes:
        known: All of these, as the native core asks for them.
    """

    def __init__(self, lines: Array, image_lines: Array, settings: Array, covariances: Array | None = None) -> None:
        self.count = len(lines)
        seen = np.empty((len(lines), 6))
        seen[:, :3] = image_lines
        seen[:, 3:] = (settings[0] ** 2, 0.0, settings[0] ** 2) if covariances is None else covariances
        self.known: tuple[Array, Array, Array] = (lines, seen, settings[1:])

    def at(self, rotation: Array, translation: Array) -> Residuals:
        """Return the residuals of poses T_camera_world.

        Args:
            rotation: Shape (k, 3, 3).
            translation: Shape (k, 3) [m].
        """
        arguments = (*self.known, rotation, translation)
        return Residuals(_core.image_residuals(*arguments), arguments)
