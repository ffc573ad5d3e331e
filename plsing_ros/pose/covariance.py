# SPDX-License-Identifier: Apache-2.0
"""How uncertain a pose is, and whether a covariance can say so."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.pose.residuals import ImageResiduals


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """First-order uncertainty of a pose.

    Attributes:
        deviation: Standard deviations along the axes, largest first, shape (6,).
        axes: Unit twists (v, omega) of the camera in its frame, as rows, shape (6, 6).
        covariance: As in geometry_msgs/PoseWithCovariance, see PoseEstimate, shape (6, 6).
        position_deviation: Standard deviation of the position in its worst direction [m].
        rotation_deviation: Standard deviation of the orientation about its worst axis [rad].
        nonlinearity: See PoseEstimate.
        inverse_condition_number: Of the interaction matrix of the lines, raw.
        squared_residual: Sum of squared residuals at the pose, in standard deviations.
    """

    deviation: Array
    axes: Array
    covariance: Array
    position_deviation: float
    rotation_deviation: float
    nonlinearity: float
    inverse_condition_number: float
    squared_residual: float


def uncertainty(image: ImageResiduals, rotation: Array, translation: Array, weight: Array) -> Uncertainty | None:
    """Return the uncertainty of a pose at a minimum of the misfit; None if a motion is not determined at all.

    Args:
        image: The residuals.
        rotation: Of T_camera_world, shape (3, 3).
        translation: Shape (3,) [m].
        weight: Of each line, 0 or 1, shape (n,).

    Source: first-order propagation, docs/pose.md.
    """
    found = _core.pose_uncertainty(*image.known, rotation, translation, weight)
    return None if found is None else Uncertainty(*found)
