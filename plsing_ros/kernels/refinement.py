"""Damped, weighted steps of camera poses towards their image lines, for many poses at once: twin of refinement.c."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.kernels.residuals import RESIDUAL_ROWS, image_jacobians, image_residuals, whitened
from plsing_ros.kernels.rotations import rotations_near

_FIRST_DAMPING = 1e-6
_MOST_DAMPING = 1e10
# A step that promises to lower the sum of squared residuals, in standard deviations, by less than this share is the
# last: Newton's steps then leave the square of it.
_SMALLEST_GAIN = 1e-6
_LONGEST_TURN = 0.5  # [rad]
# By how much the cost may exceed the lowest one on the way: -2 log likelihood, with the covariances' determinants.
_SLACK = 1.0
_DIAGONAL = np.arange(6)


def refine_poses(
    lines: Array,
    image_lines: Array,
    settings: Array,
    weight: Array,
    rotation: Array,
    translation: Array,
    gain: Array,
    final: Array,
    iterations: int,
) -> None:
    """Move k poses T_camera_world by Levenberg-Marquardt steps, each until it is at a minimum of the misfit.

    Args:
        lines: As for image_residuals, like the next two.
        image_lines: Of n lines.
        settings: Noise and field of view.
        weight: Of each line for each pose, 0 or 1, shape (k, n).
        rotation: Moved, shape (k, 3, 3).
        translation: Moved, shape (k, 3) [m].
        gain: Filled, by how much the last step would have lowered the sum of squared residuals had they been linear,
            shape (k,); infinite without a step.
        final: Filled, 1 for poses at a minimum, else 0, shape (k,).
        iterations: At most so many steps.

    Source: the undamped, unweighted step is Marchand and Chaumette's virtual visual servoing (section "Pose Estimation
    along a quadrifolium trajectory"); the damping is Levenberg's and Marquardt's.
    """
    k, n = weight.shape
    gain[:], final[:] = np.inf, 0.0
    damping: Array = np.full(k, _FIRST_DAMPING)
    moving = np.ones(k, dtype=bool)
    now, new = np.empty((k, RESIDUAL_ROWS, n)), np.empty((k, RESIDUAL_ROWS, n))
    raw, jacobian = np.empty((k, 2, n, 6)), np.empty((k, 2, n, 6))
    lowest = np.full(k, np.inf)
    for _ in range(iterations):
        image_residuals(lines, image_lines, settings, rotation, translation, now)
        was = squared_misfit(now[:, 2:4], weight)
        lowest = np.minimum(lowest, was + (weight * now[:, 14]).sum(axis=1))
        image_jacobians(now, raw, jacobian)
        rows = (jacobian * weight[:, np.newaxis, :, np.newaxis]).reshape(k, 2 * n, 6)
        normal = rows.transpose(0, 2, 1) @ rows
        slope = (now[:, 2:4].reshape(k, 1, 2 * n) @ rows)[:, 0]
        normal[:, _DIAGONAL, _DIAGONAL] *= (1.0 + damping)[:, np.newaxis]
        normal[:, _DIAGONAL, _DIAGONAL] += 1e-300
        step = _solved(normal, -slope)
        gain[:] = np.where(moving, -np.einsum("ki,ki->k", slope, step), gain)
        final[:] = np.where(moving, (gain <= _SMALLEST_GAIN * (1.0 + was)) | (damping > _MOST_DAMPING), final)
        turn = np.sqrt(np.einsum("ki,ki->k", step[:, 3:], step[:, 3:]))
        step *= np.minimum(1.0, _LONGEST_TURN / np.maximum(turn, _LONGEST_TURN))[:, np.newaxis]
        new_rotation, new_translation = moved_poses(step, rotation, translation)
        image_residuals(lines, image_lines, settings, new_rotation, new_translation, new)
        # Both by the same measure, and not much less likely, as poses would win by their larger covariance.
        better = squared_misfit(whitened(new[:, :2], now[:, 4:7]), weight) <= was
        better &= squared_misfit(new[:, 2:4], weight) + (weight * new[:, 14]).sum(axis=1) <= lowest + _SLACK
        taken = moving & better
        rotation[taken], translation[taken] = new_rotation[taken], new_translation[taken]
        damping = np.where(better, 0.1 * damping, np.maximum(100.0 * damping, 1e-4))
        moving &= final == 0.0
        if not moving.any():
            break


def moved_poses(motion: Array, rotation: Array, translation: Array) -> tuple[Array, Array]:
    """Return poses T_camera_world of a camera after motions in its frame: the scene moves by the inverse."""
    back = rotations_near(-motion[:, 3:])
    return back @ rotation, (back @ (translation - motion[:, :3])[..., np.newaxis])[..., 0]


def squared_misfit(value: Array, weight: Array) -> Array:
    """Return weighted sums of squares of values (k, 2, n), weights (k, n), shape (k,)."""
    return np.asarray(np.einsum("kin,kin,kn->k", value, value, weight))


def _solved(matrix: Array, right: Array) -> Array:
    """Return the solutions (k, 6) of k systems; zero for one that is singular to the last bit."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[..., np.newaxis])[..., 0])
    except np.linalg.LinAlgError:
        singular = np.linalg.det(matrix) == 0.0
        matrix[singular] = np.eye(6)
        return np.where(singular[:, np.newaxis], 0.0, _solved(matrix, right)) if not singular.all() else 0.0 * right
