# SPDX-License-Identifier: Apache-2.0
"""Whether a pose can be used, and why not."""

from __future__ import annotations

from plsing_ros.parameters.pose_estimator import EstimationParameters
from plsing_ros.pose.covariance import Uncertainty
from plsing_ros.pose.estimate import Alternative, Verdict
from plsing_ros.singularities import LocusDistance


def grade(
    found: Uncertainty,
    residual: float,
    alternatives: tuple[Alternative, ...],
    nearest: LocusDistance | None,
    limits: EstimationParameters,
) -> tuple[Verdict, str]:
    """Return the verdict on a pose, and a sentence that says why it is not OK.

    Args:
        found: Its uncertainty.
        residual: See PoseEstimate.
        alternatives: Other poses that differ by more than the limits, most plausible first.
        nearest: The locus next to it.
        limits: Thresholds.
    """
    if residual > limits.failed_residual:
        return Verdict.FAILED, (
            f"no pose explains the image: the residual of the best one is {residual:.3g} standard deviations, above "
            f"{limits.failed_residual:g}"
        )
    if alternatives:
        return Verdict.AMBIGUOUS, (
            f"{len(alternatives)} other pose(s) explain the image, too, the best with likelihood ratio "
            f"{alternatives[0].likelihood_ratio:.2g}"
        )
    where = f"; {nearest.distance:.3g} m from {nearest.name}" if nearest is not None else ""
    if found.nonlinearity > limits.max_nonlinearity:
        return Verdict.POOR, (
            f"the covariance cannot be trusted: two standard deviations away the misfit differs by "
            f"{found.nonlinearity:.2g} of what it says, above {limits.max_nonlinearity:g}{where}"
        )
    if found.position_deviation > limits.max_position_deviation:
        return Verdict.POOR, (
            f"the position is uncertain by {found.position_deviation:.3g} m, above "
            f"{limits.max_position_deviation:g} m{where}"
        )
    if found.rotation_deviation > limits.max_rotation_deviation:
        return Verdict.POOR, (
            f"the orientation is uncertain by {found.rotation_deviation:.3g} rad, above "
            f"{limits.max_rotation_deviation:g} rad{where}"
        )
    if residual > limits.max_residual:
        return Verdict.POOR, (
            f"the residual is {residual:.3g} standard deviations, above {limits.max_residual:g}: wrong matches, or "
            "more noise than stated"
        )
    return Verdict.OK, ""
