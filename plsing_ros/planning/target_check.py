# SPDX-License-Identifier: Apache-2.0
"""What is asked before moving: is a target, or the path to it, near a singularity, and what would the controller do?"""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.geometry import Pose
from plsing_ros.planning.camera_path import CameraPath, even_progress
from plsing_ros.planning.detour import Decision, DetourOptions
from plsing_ros.planning.path_conditions import inverse_condition_numbers
from plsing_ros.planning.straight_way import KnownPose, plan_by_risk
from plsing_ros.singularities import LocusDistance, SingularSet

_PATH_POSES = 100


@dataclass(frozen=True, eq=False)
class TargetCheck:
    """The answer; numbers of a plsing_msgs/CheckTarget response.

    Attributes:
        decision: What the controller would do.
        reason: Why, in words.
        target_inverse_condition_number: Of L at the target, raw, in [0, 1]; 0 where a line has no image.
        target_nearest: The locus nearest to the target, observed lines left out; None if there is none.
        straight_inverse_condition_number: The lowest on the straight path, ends included, likewise.
        straight_nearest: The locus, observed lines included, that the straight path comes nearest to, there.
        start: T_world_camera where it begins.
        path: T_world_camera along the path it would take, at equal steps of progress; empty if refused.
    """

    decision: Decision
    reason: str
    target_inverse_condition_number: float
    target_nearest: LocusDistance | None
    straight_inverse_condition_number: float
    straight_nearest: LocusDistance
    start: Pose
    path: tuple[Pose, ...]


def check_target(
    singular: SingularSet,
    start: Pose,
    target: Pose,
    options: DetourOptions | None = None,
    known: KnownPose | None = None,
) -> TargetCheck:
    """Return what a controller that plans its path would do about a target, and what it would meet.

    Args:
        singular: The singular set of the observed lines.
        start: T_world_camera at the start.
        target: T_world_camera at the target.
        options: How it plans.
        known: How well it knows the camera's pose beside the image, if it does.
    """
    options = options or DetourOptions()
    plan = plan_by_risk(singular, start, target, options, known)
    straight = CameraPath(start, target, options.limits)
    rotation, position = straight.poses(even_progress(_PATH_POSES))
    condition = inverse_condition_numbers(singular.lines, rotation, position)
    return TargetCheck(
        plan.decision,
        plan.reason,
        float(condition[-1]),
        singular.nearest_locus(target.translation),
        float(condition.min()),
        min((singular.distances(center)[0] for center in position), key=lambda each: each.distance),
        start,
        plan.path.sampled(_PATH_POSES) if plan.path is not None else (),
    )
