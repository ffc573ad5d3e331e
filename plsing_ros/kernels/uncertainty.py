"""The first-order uncertainty of a pose, and how far it can be believed: twin of uncertainty.c."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.kernels.refinement import moved_poses, squared_misfit
from plsing_ros.kernels.residuals import RESIDUAL_ROWS, image_jacobians, image_residuals, whitened

# Below this share of the largest singular value the weak motion is not determined at all.
_UNDETERMINED = 1e-13
# Where the misfit is compared with what the covariance says, in standard deviations.
_PROBE = 2.0
_LARGEST = 1e6


def pose_uncertainty(
    lines: Array,
    image_lines: Array,
    settings: Array,
    rotation: Array,
    translation: Array,
    weight: Array,
    deviation: Array,
    axes: Array,
    covariance: Array,
    figures: Array,
) -> bool:
    """Fill the uncertainty of a pose T_camera_world at a minimum of the misfit; return whether it is determined.

    Args:
        lines: As for image_residuals, like the next two.
        image_lines: Of n lines; fewer than three determine nothing.
        settings: Noise and field of view.
        rotation: Shape (3, 3).
        translation: Shape (3,) [m].
        weight: Of each line, 0 or 1, shape (n,).
        deviation: Filled, standard deviations along the axes, largest first, shape (6,).
        axes: Filled, unit twists (v, omega) of the camera in its frame, as rows, shape (6, 6).
        covariance: Filled, as in geometry_msgs/PoseWithCovariance, shape (6, 6).
        figures: Filled, shape (5,): standard deviations of position [m] and orientation [rad] in their worst
            directions; largest relative difference of the misfit from a quadratic two standard deviations away, both
            ways along the two weakest axes, at most 1e6; inverse condition number of the interaction matrix; sum of
            squared residuals.

    Source: first-order propagation, docs/pose.md.
    """
    n = len(lines)
    if n < 3:
        return False
    here = np.empty((1, RESIDUAL_ROWS, n))
    image_residuals(lines, image_lines, settings, rotation[np.newaxis], translation[np.newaxis], here)
    raw, jacobian = np.empty((1, 2, n, 6)), np.empty((1, 2, n, 6))
    image_jacobians(here, raw, jacobian)
    # Angle and offset are orthonormal coordinates of the image line, so `raw` has the singular values of L.
    raw, jacobian = ((each[0] * weight[:, np.newaxis]).reshape(-1, 6) for each in (raw, jacobian))
    if not np.isfinite(jacobian).all():
        return False
    raw_size = np.linalg.svd(raw, compute_uv=False)
    _, size, right = np.linalg.svd(jacobian, full_matrices=False)
    if not size[-1] > _UNDETERMINED * size[0]:
        return False
    deviation[:], axes[:] = 1.0 / size[::-1], right[::-1]
    # Rows of the axes in the world frame: position and rotation vector turn alike.
    in_world = (axes.reshape(6, 2, 3) @ rotation).reshape(6, 6)
    covariance[:] = (in_world.T * deviation**2) @ in_world
    covariance[:] = 0.5 * (covariance + covariance.T)
    blocks = np.stack([covariance[:3, :3], covariance[3:, 3:]])
    figures[:2] = np.sqrt(np.linalg.eigvalsh(blocks)[:, -1])
    squared = squared_misfit(here[:, 2:4], weight[np.newaxis])
    figures[2:] = _LARGEST, raw_size[-1] / raw_size[0], squared[0]
    probes = _PROBE * (deviation[:2, np.newaxis] * axes[:2])
    if np.abs(probes[:, 3:]).max() <= 1.0:
        there = np.empty((4, RESIDUAL_ROWS, n))
        moved = moved_poses(np.concatenate([probes, -probes]), rotation, translation)
        image_residuals(lines, image_lines, settings, *moved, there)
        squares = squared_misfit(whitened(there[:, :2], here[:, 4:7]), np.broadcast_to(weight, (4, n)))
        change = (squares - squared) / _PROBE**2
        worst = np.abs(change - 1.0).max()
        # Written so that NaN counts as the largest.
        figures[2] = worst if worst < _LARGEST else _LARGEST
    return True
