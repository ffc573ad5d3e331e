# SPDX-License-Identifier: Apache-2.0
"""How near to a singularity the camera is, as a value."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from plsing_ros.arrays import Array
from plsing_ros.features import Conditioning
from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.approach import Approach, Trend
from plsing_ros.monitoring.risk import Risk
from plsing_ros.singularities import LocusDistance, Proximity


class Assessment(NamedTuple):
    """How near to a singularity the camera is.

    Attributes:
        level: Level of concern.
        explain: Returns why, in words.
        stamp: Of the features it speaks of [ns]; of the clock when there are none; 0 for a hypothetical pose.
        line_count: Lines that took part.
        conditioning: Of the interaction matrix, or None without usable features.
        inverse_condition_number_rate: [1/s], fitted to the latest features, or None if there was no earlier value.
        locus_distances: Distances of the camera centre [m] in the order of SingularSet.locus_names, shape (m,), or
            None if the camera position is not known.
        nearest: The nearest locus other than the observed lines, or None if there is none or the position is not known.
        trend: How the camera moves with respect to the nearest locus.
        approach: The closest approach within the horizon if the motion goes on, or None if there is none or the
            position or the twist is not known.
        time_to_critical: When the inverse condition number falls below its critical threshold at its present rate [s],
            or None if it does not, or the rate is not clear of noise.
        position_source: "camera_pose", "features", or "" if the camera position is not known.
        describe_unobservable_motion: Returns the least observable direction in words, near a singularity; else nothing.
        target_inverse_condition_number: At the target with the same lines, or None if no target is known.
        pose: T_world_camera that the distances belong to, or None if the camera position is not known.
        proximity: Of the camera to a singular centre, for the features' covariances or else 1 mrad, likewise.
        risk: What roll-outs of the closed loop say about the run, or None if law, target or position is not known.
        kind: What the level is for, without numbers: as long as it stays the same there is nothing new to say.
    """

    level: Level
    explain: Callable[[], str]
    stamp: int
    line_count: int = 0
    conditioning: Conditioning | None = None
    inverse_condition_number_rate: float | None = None
    locus_distances: Array | None = None
    nearest: LocusDistance | None = None
    trend: Trend = Trend.UNKNOWN
    approach: Approach | None = None
    time_to_critical: float | None = None
    position_source: str = ""
    describe_unobservable_motion: Callable[[], str] = str
    target_inverse_condition_number: float | None = None
    pose: Pose | None = None
    proximity: Proximity | None = None
    risk: Risk | None = None
    kind: str = ""

    def __str__(self) -> str:
        nearest = "" if self.nearest is None else f"; nearest: {self.nearest}"
        return f"{self.level.name}: {self.reason}{nearest}"

    # Words are made when they are asked for: most of them nobody reads.

    @property
    def reason(self) -> str:
        """Why, in words."""
        return self.explain()

    @property
    def unobservable_motion_text(self) -> str:
        """The least observable direction in words, near a singularity; else empty."""
        return self.describe_unobservable_motion()
