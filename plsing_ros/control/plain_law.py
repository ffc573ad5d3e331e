# SPDX-License-Identifier: Apache-2.0
"""The paper's law without options, from lines to twist in one call."""

from __future__ import annotations

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.control.compute_twist import LawTwist
from plsing_ros.features.projection import DEGENERATE_DEPTH
from plsing_ros.geometry import LineSet
from plsing_ros.parameters import ControllerParameters


def compute_plain_twist(
    parameters: ControllerParameters, lines: LineSet, image: Array, target_image: Array
) -> tuple[LawTwist, float] | None:
    """Return what compute_twist does where parameters.is_plain, and |s - s*|, without the cost of its options.

    Args:
        parameters: Gain and threshold.
        lines: In the camera's optical frame.
        image: s, shape (3n,).
        target_image: s*, shape (3n,).

    Returns:
        None if a line has no image or L is not finite: compute_twist says so.

    Source: eq. velocity_input.
    """
    gain, threshold = parameters.gain, parameters.pinv_threshold
    answer = _core.compute_twist(lines.direction, lines.moment, image, target_image, DEGENERATE_DEPTH, gain, threshold)
    if answer is None:
        return None
    twist, speed, values, error_norm = answer
    return LawTwist(twist, gain, values, 0.0, 1.0, speed), error_norm
