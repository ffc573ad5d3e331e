# SPDX-License-Identifier: Apache-2.0
"""A free-flying camera that sees lines and moves as it is told."""

from __future__ import annotations

import dataclasses

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation, degenerate_projections, image_depth
from plsing_ros.geometry import LineSet, Pose


class SimulatedCamera:
    """Pose of a camera, what it sees of a scene, and its exact motion under constant twists.

    Attributes:
        lines: The scene, in the world frame.
        T_world_camera: Where the camera is.
    """

    def __init__(
        self,
        lines: LineSet,
        T_world_camera: Pose,
        frame: str,
        noise: float = 0.0,
        seed: int = 0,
        noise_on: str = "both",
    ) -> None:
        """Place a camera.

        Args:
            lines: The scene, in the world frame.
            T_world_camera: Start pose of the optical frame.
            frame: Name of the optical frame.
            noise: Standard deviation of the noise of noisy_lines, on the lines in the camera frame.
            seed: Seed of the one generator that all noise comes from.
            noise_on: "lines": only the 3-D lines have the noise, "image": only the image lines, "both": the image lines
                are those of the noisy 3-D lines.
        """
        self.lines = lines
        self.T_world_camera = T_world_camera
        self.noise = noise
        self.noise_on = noise_on
        self._frame = frame
        self._generator = np.random.default_rng(seed)

    def observe(self) -> LineObservation:
        """Return what the camera sees now; draws new noise at every call."""
        lines = self.lines.transformed(self.T_world_camera.inverse(), self._frame)
        if self.noise == 0.0:
            return LineObservation.of_lines(lines)
        noisy = noisy_lines(lines, self.noise, self._generator)
        if self.noise_on == "lines":
            return _mixed(lines, noisy)
        seen = LineObservation.of_lines(noisy) if self.noise_on == "both" else _mixed(noisy, lines)
        return dataclasses.replace(seen, covariances=image_covariances(lines, self.noise))

    def move(self, twist: Array, duration: float) -> None:
        """Move with a constant twist (v, omega) in the optical frame, shape (6,) [m/s, rad/s], for duration [s].

        Raises:
            GeometryError: If the twist is not finite, or the camera would leave the range of finite numbers; it then
                stays where it was.
        """
        self.T_world_camera = self.T_world_camera.integrate(twist, duration)


def noisy_lines(lines: LineSet, noise: float, generator: np.random.Generator) -> LineSet:
    """Return lines after independent Gaussian noise on their Plücker coordinates (unit directions, moments [m]).

    The directions are brought back to unit length and the moments made orthogonal to them.
    """
    direction = lines.direction + generator.normal(scale=noise, size=(len(lines), 3))
    moment = lines.moment + generator.normal(scale=noise, size=(len(lines), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    moment -= np.einsum("ij,ij->i", moment, direction)[:, np.newaxis] * direction
    return LineSet(direction, moment, lines.frame, lines.ids)


def image_covariances(lines_camera: LineSet, noise: float) -> Array:
    """Return the covariance of angle and offset of each image line that the noise of noisy_lines makes.

    Args:
        lines_camera: n lines in the camera's optical frame.
        noise: Standard deviation, above 0.

    Returns:
        (angle angle, angle offset, offset offset) of each line, shape (n, 3); the identity where there is no image.

    Source: first-order propagation, docs/pose.md.
    """
    seen = ~degenerate_projections(lines_camera)
    depth = np.where(seen, image_depth(lines_camera), 1.0)
    p, v = lines_camera.moment / depth[:, np.newaxis], lines_camera.direction / depth[:, np.newaxis]
    along, q = p[:, 0] * v[:, 1] - p[:, 1] * v[:, 0], np.sqrt(1.0 + p[:, 2] ** 2)
    factors = noise * np.stack(
        [
            q[:, np.newaxis] * np.stack([v[:, 2], -along], axis=1),
            (depth * q)[:, np.newaxis] * np.stack([along, q**2 * v[:, 2]], axis=1),
        ]
    )
    covariance = np.einsum("kni,knj->nij", factors, factors)
    rows = np.stack([covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]], axis=1)
    return np.where(seen[:, np.newaxis], rows, np.array([1.0, 0.0, 1.0]))


def _mixed(of_image: LineSet, in_space: LineSet) -> LineObservation:
    """Return the image lines of one set of lines with the 3-D lines of another."""
    seen = LineObservation.of_lines(of_image)
    usable = seen.usable & ~degenerate_projections(in_space)
    kept = in_space.select(np.flatnonzero(usable)) if usable.any() else None
    return LineObservation(seen.ids, seen.image_lines * usable[:, np.newaxis], usable, kept)
