"""One step of the plain law on bare arrays, for previews: the twist it commands, and what the camera sees after it."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import lapack

from plsing_ros import kernels
from plsing_ros.arrays import Array

_LEAST_DEPTH = 1e-9  # [m]
# Speeds and turns are not followed beyond this; every number that is published is finite.
FASTEST = 1e9  # [m/s], [rad/s]


def law(lines: Array, desired: Array) -> Array:
    """Return the twist of the plain law for gain 1, shape (6,): -pinv(L) (s - s*), without the checks of features.

    Args:
        lines: n lines in the camera frame, direction and moment, shape (2, n, 3).
        desired: Image lines at the goal, shape (n, 3).

    Raises:
        numpy.linalg.LinAlgError: If L is singular to working precision, or a line has no image.
    """
    direction, moment = lines
    interaction = np.empty((3 * len(moment), 6))
    if not kernels.interaction_matrix(direction, moment, interaction, _LEAST_DEPTH):
        raise np.linalg.LinAlgError
    error = (moment / np.hypot(moment[:, 0], moment[:, 1])[:, np.newaxis] - desired).ravel()
    # Least squares by QR, a third of the time of a singular value decomposition.
    _, solution, failed = lapack.dgels(interaction, error)
    twist: Array = -solution[:6]
    if failed or not twist @ twist < FASTEST**2:
        raise np.linalg.LinAlgError
    return twist


def lines_after(lines: Array, step: Array) -> Array:
    """Return lines (2, n, 3) in the frame of a camera that moved by the screw exp(step), shape (6,) [m, rad]."""
    vx, vy, vz, x, y, z = step.tolist()
    square = x * x + y * y + z * z
    if square > 1e-8:
        angle = math.sqrt(square)
        sine, cosine = math.sin(angle), math.cos(angle)
        a, b, c = sine / angle, (1.0 - cosine) / square, (angle - sine) / (square * angle)
    else:
        a, b, c = 1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    # R = I + a K + b K^2 and shift = (I + b K + c K^2) v with K = [omega]x and K^2 = omega omega^T - |omega|^2 I.
    diagonal = 1.0 - b * square
    rotation = np.array(
        [
            [diagonal + b * x * x, b * x * y - a * z, b * x * z + a * y],
            [b * x * y + a * z, diagonal + b * y * y, b * y * z - a * x],
            [b * x * z - a * y, b * y * z + a * x, diagonal + b * z * z],
        ]
    )
    keep, along = 1.0 - c * square, c * (x * vx + y * vy + z * vz)
    tx = keep * vx + b * (y * vz - z * vy) + along * x
    ty = keep * vy + b * (z * vx - x * vz) + along * y
    tz = keep * vz + b * (x * vy - y * vx) + along * z
    # Rows times this are u x t, so that the moments become l - t x u.
    moved = lines.copy()
    moved[1] += lines[0].dot(np.array([[0.0, -tz, ty], [tz, 0.0, -tx], [-ty, tx, 0.0]]))
    result: Array = moved.reshape(-1, 3).dot(rotation).reshape(lines.shape)
    return result
