"""Residuals of image lines in standard deviations, for many poses at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from plsing_ros.arrays import Array, BoolArray
from plsing_ros.pose.rotations import skew_matrices

_SMALLEST_DEPTH = 1e-12


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


# The lower triangular factor of the covariance of a line's angle and offset, inverted: entries (0, 0), (1, 0), (1, 1),
# each of shape (k, n); or one number that multiplies both, for image noise alone.
Whitening = tuple[Array, Array, Array] | float


@dataclass(frozen=True, eq=False)
class Residuals:
    """What k poses make of n image lines.

    Attributes:
        raw: Angle [rad] and offset of the line minus the observed ones, shape (k, 2, n).
        value: The same, whitened: uncorrelated and in standard deviations.
        whitening: Turns the one into the other.
        log_determinant: Of each line's covariance, shape (k, n).
        reversed: Which lines are seen against their direction, shape (k, n).
        visible: Which lines have a part in front of the camera and within its field of view, shape (k, n).
        line: Image lines at these poses, directed as they are seen, shape (k, 3, n).
        slant: Direction / delta of each line: components along the image line and along z, each (k, n) [1/m].
    """

    raw: Array
    value: Array
    whitening: Whitening
    log_determinant: Array
    reversed: BoolArray
    visible: BoolArray
    line: Array
    slant: tuple[Array, Array]

    def of_pose(self, i: int) -> Residuals:
        """Return those of one pose alone, k = 1."""
        one = slice(i, i + 1)
        return Residuals(
            self.raw[one],
            self.value[one],
            self.whitening if isinstance(self.whitening, float) else _sliced(self.whitening, one),
            self.log_determinant[one],
            self.reversed[one],
            self.visible[one],
            self.line[one],
            _sliced(self.slant, one),
        )

    @property
    def squared(self) -> Array:
        """Squared Mahalanobis distance of each line, shape (k, n)."""
        squared: Array = np.einsum("kin,kin->kn", self.value, self.value)
        return squared

    @cached_property
    def raw_jacobian(self) -> Array:
        """Derivative of raw by the twist (v, omega) of the camera in its own frame, shape (k, 6, 2, n)."""
        p, (s, vz) = self.line, self.slant
        px, py, rho = p[:, 0], p[:, 1], p[:, 2]
        jacobian = np.empty((len(p), 6, 2, p.shape[2]))
        np.multiply(p, vz[:, np.newaxis], out=jacobian[:, :3, 0])
        np.multiply(p, -s[:, np.newaxis], out=jacobian[:, :3, 1])
        np.multiply(p[:, :2], rho[:, np.newaxis], out=jacobian[:, 3:5, 0])
        jacobian[:, 5, 0] = -1.0
        q2 = 1.0 + rho * rho
        np.multiply(py, -q2, out=jacobian[:, 3, 1])
        np.multiply(px, q2, out=jacobian[:, 4, 1])
        jacobian[:, 5, 1] = 0.0
        return jacobian

    @cached_property
    def jacobian(self) -> Array:
        """Derivative of value by the same, shape (k, 6, 2, n)."""
        return whitened(self.raw_jacobian, self.whitening)


class ImageResiduals:
    """The residuals of one image as a function of the pose.

    Args:
        direction: Unit directions of the lines in the world, shape (n, 3).
        moment: Moments about the world's origin, shape (n, 3) [m].
        image_lines: Observed l', shape (n, 3).
        noise: Of what.
        largest_angle: Half of the field of view [rad], up to pi/2.
    """

    def __init__(
        self, direction: Array, moment: Array, image_lines: Array, noise: LineNoise, largest_angle: float = np.pi / 2
    ) -> None:
        self.count = len(direction)
        self.noise = noise
        self._lines = np.concatenate([direction, moment]).T
        self._image = image_lines.T
        self._least_cosine = np.cos(largest_angle)

    def at(self, rotation: Array, translation: Array) -> Residuals:
        """Return the residuals of poses T_camera_world.

        Args:
            rotation: Shape (k, 3, 3).
            translation: Shape (k, 3) [m].

        Source: eq. plucker2dline, and eq. MPlucker in the coordinates (angle, offset) of an image line: docs/pose.md.
        """
        n, k = self.count, len(rotation)
        turned = rotation @ self._lines
        u = turned[:, :, :n]
        m = skew_matrices(translation) @ u + turned[:, :, n:]
        ox, oy, oz = self._image
        depth = np.maximum(np.hypot(m[:, 0], m[:, 1]), _SMALLEST_DEPTH)
        agreement = ox * m[:, 0] + oy * m[:, 1]
        # From here on, each line is directed as it is seen.
        scale = np.copysign(1.0 / depth, agreement)
        p, v = m * scale[:, np.newaxis], u * scale[:, np.newaxis]
        px, py, rho = p[:, 0], p[:, 1], p[:, 2]
        raw = np.empty((k, 2, n))
        np.arctan2(ox * py - oy * px, agreement * scale, out=raw[:, 0])
        np.subtract(rho, oz, out=raw[:, 1])
        s, vz = px * v[:, 1] - py * v[:, 0], v[:, 2]
        log_determinant: Array
        if self.noise.scene == self.noise.camera == 0.0:
            whitening: Whitening = 1.0 / self.noise.image
            log_determinant = np.full((k, n), 4.0 * np.log(self.noise.image))
        else:
            along = np.einsum("ki,kin->kn", translation, v)
            whitening, log_determinant = self._whitening(depth, s, vz, 1.0 + rho * rho, along)
        return Residuals(
            raw,
            whitened(raw, whitening),
            whitening,
            log_determinant,
            agreement < 0.0,
            self._visible(s, u),
            p,
            (s, vz),
        )

    def _visible(self, s: Array, u: Array) -> BoolArray:
        """Return which lines can be seen; -s has the sign of the depth of the line's point closest to the camera.

        The half of a line in front of the camera is seen from its vanishing point to where it leaves through z = 0. If
        its closest point to the camera is in front, that half crosses the part of the image line closest to the
        axis; else only the side of the vanishing point is left. Derivation in docs/pose.md.
        """
        visible: BoolArray = (s < 0.0) | (np.abs(u[:, 2]) > self._least_cosine)
        return visible

    def _whitening(self, depth: Array, s: Array, vz: Array, q2: Array, along: Array) -> tuple[Whitening, Array]:
        """Return the whitening and the logarithm of the determinant of the covariance of angle and offset.

        Args:
            depth: delta of each line [m].
            s: Component of direction / delta along the image line.
            vz: z component of direction / delta.
            q2: 1 + rho^2.
            along: Translation times direction / delta.

        Source: docs/pose.md.
        """
        image, scene, camera = self.noise.image**2, self.noise.scene**2, self.noise.camera**2
        # Covariance by the moment of the line, and by its direction: in the plane normal to u only.
        by_moment = (scene + camera) * q2
        turn = depth * depth * q2
        first, second = s - vz * along, q2 * vz + s * along
        a = image + by_moment * vz * vz + scene * turn * first * first + camera * turn * s * s
        b = -by_moment * vz * s + scene * turn * first * second + camera * turn * s * q2 * vz
        d = image + by_moment * s * s + scene * turn * second * second + camera * turn * (q2 * vz) ** 2
        d_left = np.maximum(d - b * b / a, 1e-15 * d)
        one, two = 1.0 / np.sqrt(a), 1.0 / np.sqrt(d_left)
        return (one, -b / a * two, two), np.log(a * d_left)


def whitened(rows: Array, whitening: Whitening) -> Array:
    """Return angles and offsets in standard deviations.

    Args:
        rows: Shape (k, 2, n) or (k, 6, 2, n).
        whitening: As in Residuals, of the same poses or of others.
    """
    if isinstance(whitening, float):
        return rows * whitening
    first, mixed, second = whitening if rows.ndim == 3 else (w[:, np.newaxis] for w in whitening)
    result = np.empty_like(rows)
    np.multiply(rows[..., 0, :], first, out=result[..., 0, :])
    np.add(rows[..., 0, :] * mixed, rows[..., 1, :] * second, out=result[..., 1, :])
    return result


_Arrays = TypeVar("_Arrays", tuple[Array, Array], tuple[Array, Array, Array])


def _sliced(arrays: _Arrays, part: slice) -> _Arrays:
    return tuple(each[part] for each in arrays)  # type: ignore[return-value]
