# SPDX-License-Identifier: Apache-2.0
"""From the state of a filter to an estimate with its verdict."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.geometry.rotations import rotation_vector
from plsing_ros.parameters.pose_estimator import FilterParameters
from plsing_ros.pose.estimate import FROM_FILTER, Alternative, PoseEstimate, Verdict
from plsing_ros.pose.estimator import PoseEstimator
from plsing_ros.pose.filter_motion import Agreement
from plsing_ros.pose.filter_track import FilterTrack, TrackUpdate


class TrackSummary:
    """Figures of a track's pose that several questions need.

    Attributes:
        pose: T_world_camera.
        covariance: Shape (6, 6), see PoseEstimate.
        position_deviation: In its worst direction [m].
        rotation_deviation: About its worst axis [rad].
    """

    def __init__(self, track: FilterTrack, estimator: PoseEstimator) -> None:
        self.pose: Pose = track.pose
        self.covariance: Array = track.state.covariance
        self._estimator = estimator
        blocks = np.stack([self.covariance[:3, :3], self.covariance[3:, 3:]])
        largest = np.linalg.eigvalsh(blocks)[:, -1]
        self.position_deviation, self.rotation_deviation = np.sqrt(np.maximum(largest, 0.0)).tolist()

    def differs(self, other: Pose, limits: FilterParameters) -> bool:
        """Whether another pose is further away than the limits of what is POOR."""
        shift = float(np.linalg.norm(other.translation - self.pose.translation))
        turn = float(np.linalg.norm(rotation_vector(other.rotation.T @ self.pose.rotation)))
        return shift > limits.max_position_deviation or turn > limits.max_rotation_deviation

    def estimate(
        self, update: TrackUpdate, note: str, alternatives: tuple[Alternative, ...], **ids: Any
    ) -> PoseEstimate:
        """Return the estimate after an image.

        Args:
            update: What the image did.
            note: What is unusual, or empty.
            alternatives: Other poses that explain the images, most plausible first.
            ids: Of the lines that were used, left out, and seen against their direction.
        """
        verdict, reason = self._grade(update, note, alternatives)
        deviation, axes = np.linalg.eigh(self.covariance)
        in_camera = (axes[:, -1].reshape(2, 3) @ self.pose.rotation).ravel()
        nearest, condition = self._estimator.surroundings(self.pose, ids["used_ids"])
        return PoseEstimate(
            verdict=verdict,
            reason=reason,
            T_world_camera=self.pose,
            covariance=self.covariance,
            covariance_trusted=not alternatives,
            position_deviation=self.position_deviation,
            rotation_deviation=self.rotation_deviation,
            nonlinearity=0.0,
            inverse_condition_number=condition,
            least_observable_direction=in_camera,
            least_observable_standard_deviation=math.sqrt(max(0.0, float(deviation[-1]))),
            residual=update.innovation,
            nearest=nearest,
            alternatives=alternatives,
            first_estimate=None,
            innovation=update.innovation,
            source=FROM_FILTER,
            **ids,
        )

    def _grade(self, update: TrackUpdate, note: str, alternatives: tuple[Alternative, ...]) -> tuple[Verdict, str]:
        limits = self._estimator.settings
        if alternatives:
            return Verdict.AMBIGUOUS, (
                f"{len(alternatives)} other pose(s) explain the images, too, the best with likelihood ratio "
                f"{alternatives[0].likelihood_ratio:.2g}"
            )
        reasons = [note] if note else []
        if update.agreement is Agreement.MOVED:
            reasons.append("the camera did not move as the twist says")
        if self.position_deviation > limits.max_position_deviation:
            reasons.append(
                f"the position is uncertain by {self.position_deviation:.3g} m, above "
                f"{limits.max_position_deviation:g} m"
            )
        if self.rotation_deviation > limits.max_rotation_deviation:
            reasons.append(
                f"the orientation is uncertain by {self.rotation_deviation:.3g} rad, above "
                f"{limits.max_rotation_deviation:g} rad"
            )
        return (Verdict.POOR if reasons else Verdict.OK), "; ".join(reasons)
