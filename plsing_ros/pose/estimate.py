# SPDX-License-Identifier: Apache-2.0
"""What is known of a camera pose from images of lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.levels import MessageWord
from plsing_ros.singularities import LocusDistance

FROM_IMAGE, FROM_FILTER = "image", "filter"


class Verdict(MessageWord):
    """How far a pose can be trusted; the values are those of plsing_msgs/PoseEstimate."""

    OK = 0
    POOR = 1
    AMBIGUOUS = 2
    FAILED = 3
    LOST = 4


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another pose that explains the image.

    Attributes:
        T_world_camera: The pose.
        likelihood_ratio: Its likelihood over that of the estimate, in [0, 1].
    """

    T_world_camera: Pose
    likelihood_ratio: float


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """A camera pose from lines; every number is finite.

    Attributes:
        verdict: How far it can be trusted.
        reason: Why it is not OK, as a sentence; empty if it is.
        T_world_camera: The pose; None if FAILED or LOST, and then all below is zero, empty or None.
        covariance: Of position and orientation as in geometry_msgs/PoseWithCovariance, shape (6, 6): x, y, z, and
            rotations about the world's fixed x, y, z axes [m^2, m rad, rad^2].
        covariance_trusted: Whether the covariance describes the error: false where the error is not linear in the
            noise, and if there are alternatives.
        position_deviation: Standard deviation of the position in its worst direction [m].
        rotation_deviation: Standard deviation of the orientation about its worst axis [rad].
        nonlinearity: By which share the misfit two standard deviations away differs from what the covariance says; at
            most 1e6.
        inverse_condition_number: Of the interaction matrix of the lines used, raw, in [0, 1].
        least_observable_direction: Unit twist (v [m/s], omega [rad/s]) in the optical frame that the image says least
            about, shape (6,).
        least_observable_standard_deviation: Standard deviation of the pose along it.
        residual: Root mean square of the residuals over the lines used, in standard deviations, corrected for the six
            degrees of freedom that the pose takes: 1 if the noise is as stated. 0 for three lines.
        nearest: The locus nearest to the camera other than the observed lines; None if there is none.
        alternatives: Other plausible poses, most plausible first.
        used_ids: Lines that the pose rests on.
        outlier_ids: Lines left out because they do not agree.
        reversed_ids: Lines used that are seen against their direction.
        first_estimate: T_world_camera before refinement, from three lines or the last pose; None from a filter.
        innovation: Root mean square of what this image differs by from what was expected before it, over the lines
            used, in standard deviations: about 1 if noise and motion are as stated; 0 where nothing was expected.
        source: "image" for the pose of this image alone, "filter" for that of all images and the motion between them.
    """

    verdict: Verdict
    reason: str
    T_world_camera: Pose | None
    covariance: Array
    covariance_trusted: bool
    position_deviation: float
    rotation_deviation: float
    nonlinearity: float
    inverse_condition_number: float
    least_observable_direction: Array
    least_observable_standard_deviation: float
    residual: float
    nearest: LocusDistance | None
    alternatives: tuple[Alternative, ...]
    used_ids: tuple[int, ...]
    outlier_ids: tuple[int, ...]
    reversed_ids: tuple[int, ...]
    first_estimate: Pose | None
    innovation: float = 0.0
    source: str = FROM_IMAGE

    @property
    def pose(self) -> Pose | None:
        """T_world_camera."""
        return self.T_world_camera

    def __str__(self) -> str:
        if self.T_world_camera is None:
            return f"{self.verdict.name}: {self.reason}"
        why = f": {self.reason}" if self.reason else ""
        return (
            f"{self.verdict.name}{why}; {self.T_world_camera}; standard deviation at most "
            f"{self.position_deviation:.2g} m and {self.rotation_deviation:.2g} rad"
        )


def failed_estimate(reason: str, verdict: Verdict = Verdict.FAILED, source: str = FROM_IMAGE) -> PoseEstimate:
    """Return the estimate that says there is no pose, and why: FAILED or LOST."""
    return PoseEstimate(
        verdict=verdict,
        reason=reason,
        T_world_camera=None,
        covariance=np.zeros((6, 6)),
        covariance_trusted=False,
        position_deviation=0.0,
        rotation_deviation=0.0,
        nonlinearity=0.0,
        inverse_condition_number=0.0,
        least_observable_direction=np.zeros(6),
        least_observable_standard_deviation=0.0,
        residual=0.0,
        nearest=None,
        alternatives=(),
        used_ids=(),
        outlier_ids=(),
        reversed_ids=(),
        first_estimate=None,
        source=source,
    )
