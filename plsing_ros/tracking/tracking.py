# SPDX-License-Identifier: Apache-2.0
"""What a tracker says about one image."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.levels import MessageWord


class TrackingState(MessageWord):
    """How far what was found can be used."""

    TRACKING = 0
    WEAK = 1
    AMBIGUOUS = 2
    LOST = 3


@dataclass(frozen=True, eq=False)
class Tracking:
    """The result for one image.

    Attributes:
        state: How far it can be used.
        reason: Why it is not TRACKING, as a sentence; empty if it is.
        T_world_camera: The pose; None if LOST.
        covariance: Of the pose, as in geometry_msgs/PoseWithCovariance: x, y, z, and rotations about the scene's fixed
            axes, shape (6, 6) [m^2, m rad, rad^2]; zero if LOST.
        observation: The image lines of all edges with their covariances and the model's ids; hidden ones and those
            that were not found are not usable, and none is if LOST.
        support: Share of the samples along visible edges where the image has an edge, in [0, 1].
        chance: Share of them that would have one at a place picked at random, in [0, 1].
        point_count: Points of the faces that agree with the pose, 0 without this cue.
    """

    state: TrackingState
    reason: str
    T_world_camera: Pose | None
    covariance: Array
    observation: LineObservation
    support: float
    chance: float
    point_count: int
