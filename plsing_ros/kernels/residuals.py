"""Residuals of image lines and their derivatives, for many poses at once: twins of residuals.c."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.kernels.rotations import skew_matrices

# Rows of the table of image_residuals.
RESIDUAL_ROWS = 15
_SMALLEST_DEPTH = 1e-12


def image_residuals(
    lines: Array, image_lines: Array, settings: Array, rotation: Array, translation: Array, table: Array
) -> None:
    """Fill what k poses T_camera_world make of n image lines.

    Args:
        lines: Unit directions and moments [m] of the lines in the world frame, shape (n, 6).
        image_lines: Observed l', shape (n, 3).
        settings: Standard deviations of image lines, of Plücker coordinates in the world and in the camera frame; and
            the cosine of half of the field of view; shape (4,).
        rotation: Shape (k, 3, 3).
        translation: Shape (k, 3) [m].
        table: Filled, shape (k, RESIDUAL_ROWS, n); rows: angle [rad] and offset minus the observed ones; the same
            whitened; the whitening's entries (0, 0), (1, 0), (1, 1); the line as a vector, directed as it is seen (3);
            its direction / delta along the image line and along z [1/m]; 1 if it is seen against its direction; 1 if
            it has no part that can be seen; logarithm of its covariance's determinant.

    Source: eq. plucker2dline in the coordinates (angle, offset) of an image line, and its covariance: docs/pose.md.
    """
    n = len(lines)
    turned = rotation @ np.concatenate([lines[:, :3], lines[:, 3:]]).T
    u = turned[:, :, :n]
    m = skew_matrices(translation) @ u + turned[:, :, n:]
    ox, oy, oz = image_lines.T
    depth = np.maximum(np.hypot(m[:, 0], m[:, 1]), _SMALLEST_DEPTH)
    agreement = ox * m[:, 0] + oy * m[:, 1]
    # From here on, each line is directed as it is seen.
    scale = np.copysign(1.0 / depth, agreement)
    p, v = m * scale[:, np.newaxis], u * scale[:, np.newaxis]
    px, py, rho = p[:, 0], p[:, 1], p[:, 2]
    s, vz, along = px * v[:, 1] - py * v[:, 0], v[:, 2], np.einsum("ki,kin->kn", translation, v)
    table[:, 0] = np.arctan2(ox * py - oy * px, agreement * scale)
    table[:, 1] = rho - oz
    table[:, 7:10], table[:, 10], table[:, 11] = p, s, vz
    table[:, 12] = agreement < 0.0
    # -s has the sign of the depth of the line's point closest to the camera: docs/pose.md.
    table[:, 13] = ~((s < 0.0) | (np.abs(u[:, 2]) > settings[3]))
    image, scene, camera = settings[:3] ** 2
    q2 = 1.0 + rho * rho
    # Covariance by the moment of the line, and by its direction: in the plane normal to u only.
    by_moment, turn = (scene + camera) * q2, depth * depth * q2
    first, second = s - vz * along, q2 * vz + s * along
    a = image + by_moment * vz * vz + scene * turn * first * first + camera * turn * s * s
    b = -by_moment * vz * s + scene * turn * first * second + camera * turn * s * q2 * vz
    d = image + by_moment * s * s + scene * turn * second * second + camera * turn * (q2 * vz) ** 2
    d_left = np.maximum(d - b * b / a, 1e-15 * d)
    table[:, 4], table[:, 6] = 1.0 / np.sqrt(a), 1.0 / np.sqrt(d_left)
    table[:, 5] = -b / a * table[:, 6]
    table[:, 14] = np.log(a * d_left)
    table[:, 2:4] = whitened(table[:, :2], table[:, 4:7])


def image_jacobians(table: Array, raw: Array, value: Array) -> None:
    """Fill the derivatives of residuals by the twist (v, omega) of the camera in its own frame.

    Args:
        table: Of image_residuals, shape (k, RESIDUAL_ROWS, n).
        raw: Filled, of angle and offset, shape (k, 2, n, 6).
        value: Filled, of the same whitened, shape (k, 2, n, 6).

    Source: eq. MPlucker in the coordinates (angle, offset) of an image line: docs/pose.md.
    """
    p, s, vz = table[:, 7:10].swapaxes(1, 2), table[:, 10, :, np.newaxis], table[:, 11, :, np.newaxis]
    px, py, rho = p[..., 0], p[..., 1], p[..., 2]
    raw[:, 0, :, :3], raw[:, 1, :, :3] = vz * p, -s * p
    raw[:, 0, :, 3], raw[:, 0, :, 4], raw[:, 0, :, 5] = rho * px, rho * py, -1.0
    raw[:, 1, :, 3], raw[:, 1, :, 4], raw[:, 1, :, 5] = -(1.0 + rho * rho) * py, (1.0 + rho * rho) * px, 0.0
    value[:] = whitened(raw, table[:, 4:7, :, np.newaxis])


def whitened(raw: Array, whitening: Array) -> Array:
    """Return angles and offsets, shape (k, 2, n, ...), as uncorrelated numbers in standard deviations.

    Args:
        raw: Angles and offsets.
        whitening: Rows 4 to 6 of a table, shape (k, 3, n, ...).
    """
    first, mixed, second = whitening[:, 0], whitening[:, 1], whitening[:, 2]
    return np.stack([first * raw[:, 0], mixed * raw[:, 0] + second * raw[:, 1]], axis=1)
