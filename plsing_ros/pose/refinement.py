# SPDX-License-Identifier: Apache-2.0
"""Damped, weighted refinement of camera poses on the image lines, for many start poses at once."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.pose.residuals import ImageResiduals, Residuals


@dataclass(frozen=True, eq=False)
class Refined:
    """Poses T_camera_world at, or on their way to, a minimum of the misfit.

    Attributes:
        rotation: Shape (k, 3, 3).
        translation: Shape (k, 3) [m].
        residuals: At these poses.
    """

    rotation: Array
    translation: Array
    residuals: Residuals


def refine(image: ImageResiduals, rotation: Array, translation: Array, iterations: int, weight: Array) -> Refined:
    """Return poses after Levenberg-Marquardt steps: virtual visual servoing with a step that cannot diverge.

    Args:
        image: The residuals.
        rotation: Of T_camera_world, shape (k, 3, 3).
        translation: Shape (k, 3) [m].
        iterations: At most so many steps.
        weight: Of each line for each pose, 0 or 1, shape (k, n).

    Source: section "Pose Estimation along a quadrifolium trajectory", with damping: see _core.refine_poses.
    """
    rotation, translation = _core.refine_poses(*image.known, weight, rotation, translation, iterations)
    return Refined(rotation, translation, image.at(rotation, translation))
