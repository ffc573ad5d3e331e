"""How uncertain a pose is, and whether a covariance can say so."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.pose.residuals import ImageResiduals, Residuals, whitened
from plsing_ros.pose.rotations import rotations_near

# Below this share of the largest singular value the weak motion is not determined at all.
_UNDETERMINED = 1e-13
# Where the misfit is compared with what the covariance says, in standard deviations.
_PROBE = 2.0
_LARGEST = 1e6


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """First-order uncertainty of a pose.

    Attributes:
        deviation: Standard deviations along the axes, largest first, shape (6,).
        axes: Unit twists (v, omega) of the camera in its frame, as rows, shape (6, 6).
        covariance: As in geometry_msgs/PoseWithCovariance, see PoseEstimate, shape (6, 6).
        nonlinearity: See PoseEstimate.
        inverse_condition_number: Of the interaction matrix of the lines, raw.
    """

    deviation: Array
    axes: Array
    covariance: Array
    nonlinearity: float
    inverse_condition_number: float

    @cached_property
    def position_deviation(self) -> float:
        """Standard deviation of the position in its worst direction [m]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    @cached_property
    def rotation_deviation(self) -> float:
        """Standard deviation of the orientation about its worst axis [rad]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1]))


def uncertainty(
    image: ImageResiduals, rotation: Array, translation: Array, residuals: Residuals, weight: Array
) -> Uncertainty | None:
    """Return the uncertainty of a pose at a minimum of the misfit; None if a motion is not determined at all.

    Args:
        image: The residuals.
        rotation: Of T_camera_world, shape (3, 3).
        translation: Shape (3,) [m].
        residuals: At this pose alone.
        weight: Of each line, 0 or 1, shape (n,).

    Source: first-order propagation, docs/pose.md.
    """
    jacobian = (residuals.jacobian[0] * weight).reshape(6, -1).T
    _, size, axes = np.linalg.svd(jacobian, full_matrices=False)
    if not size[-1] > _UNDETERMINED * size[0]:
        return None
    # Angle and offset are orthonormal coordinates of the image line, so this has the singular values of L.
    raw = np.linalg.svd((residuals.raw_jacobian[0] * weight).reshape(6, -1), compute_uv=False)
    deviation, axes = 1.0 / size[::-1], axes[::-1]
    # Rows of the axes in the world frame: position and rotation vector turn alike.
    in_world = (axes.reshape(6, 2, 3) @ rotation).reshape(6, 6)
    covariance = (in_world.T * deviation**2) @ in_world
    probes = _PROBE * (deviation[:2, np.newaxis] * axes[:2])
    return Uncertainty(
        deviation,
        axes,
        0.5 * (covariance + covariance.T),
        _nonlinearity(image, rotation, translation, residuals, weight, np.concatenate([probes, -probes])),
        float(raw[-1] / raw[0]),
    )


def _nonlinearity(
    image: ImageResiduals, rotation: Array, translation: Array, residuals: Residuals, weight: Array, motions: Array
) -> float:
    """Return the largest relative difference of the misfit from a quadratic at poses moved by camera motions (k, 6)."""
    if np.abs(motions[:, 3:]).max() > 1.0:
        return _LARGEST
    back = rotations_near(-motions[:, 3:])
    moved = image.at(back @ rotation, (back @ (translation - motions[:, :3])[..., np.newaxis])[..., 0])
    squares = (whitened(moved.raw, residuals.whitening) ** 2).sum(axis=1) @ weight
    change = (squares - residuals.squared[0] @ weight) / _PROBE**2
    return float(min(np.abs(change - 1.0).max(), _LARGEST))
