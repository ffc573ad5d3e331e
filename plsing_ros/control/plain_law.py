# SPDX-License-Identifier: Apache-2.0
"""The paper's law without options, from lines to twist in one call."""

from __future__ import annotations

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.control.compute_twist import LawTwist
from plsing_ros.features import feature_error, interaction_matrix, solve_least_squares
from plsing_ros.features.projection import DEGENERATE_DEPTH
from plsing_ros.geometry import LineSet
from plsing_ros.parameters import ControllerParameters


def plain_twist(
    parameters: ControllerParameters, lines: LineSet, image: Array, target_image: Array
) -> tuple[LawTwist, float]:
    """Return what compute_twist does where parameters.is_plain, and |s - s*|, without the cost of its options.

    Args:
        parameters: Gain and threshold.
        lines: In the camera's optical frame.
        image: s, shape (3n,).
        target_image: s*, shape (3n,).

    Raises:
        DegenerateProjectionError: If a line has no image.
        GeometryError: If L is not finite.

    Source: eq. velocity_input.
    """
    gain, threshold = parameters.gain, parameters.pinv_threshold
    answer = None
    if len(image) == len(target_image):
        answer = _core.compute_twist(
            lines.direction, lines.moment, image, target_image, DEGENERATE_DEPTH, gain, threshold
        )
    if answer is not None:
        twist, values, error_norm = answer
    else:
        # Something to be refused with its reason.
        error, error_norm = feature_error(image, target_image)
        values, _, _, twist = solve_least_squares(interaction_matrix(lines), error, -gain, threshold)
    return LawTwist(twist, gain, values, 0.0, 1.0), error_norm
