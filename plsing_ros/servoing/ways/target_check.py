"""What is asked before moving: is a target, or the way to it, near a singularity, and what would the controller do?"""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.geometry import Pose
from plsing_ros.servoing.ways.camera_path import CameraPath, even_progress
from plsing_ros.servoing.ways.detour import Decision, DetourOptions, plan_way
from plsing_ros.servoing.ways.way_conditions import inverse_condition_numbers
from plsing_ros.singularities import LocusDistance, SingularSet

_WAY_POSES = 100


@dataclass(frozen=True, eq=False)
class TargetCheck:
    """The answer; numbers of a plsing_msgs/CheckTarget response.

    Attributes:
        decision: What the controller would do.
        reason: Why, in words.
        target_inverse_condition_number: Of L at the target, raw, in [0, 1]; 0 where a line has no image.
        target_nearest: The locus nearest to the target, observed lines left out; None if there is none.
        straight_inverse_condition_number: The lowest on the straight way, ends included, likewise.
        straight_nearest: The locus, observed lines included, that the straight way comes nearest to, there.
        way: T_scene_camera along the way it would take, at equal steps of progress; empty if refused.
    """

    decision: Decision
    reason: str
    target_inverse_condition_number: float
    target_nearest: LocusDistance | None
    straight_inverse_condition_number: float
    straight_nearest: LocusDistance
    way: tuple[Pose, ...]


def check_target(found: SingularSet, start: Pose, goal: Pose, options: DetourOptions | None = None) -> TargetCheck:
    """Return what a controller that plans its way would do about a target, and what it would meet.

    Args:
        found: The singular set of the observed lines.
        start: T_scene_camera at the start.
        goal: T_scene_camera at the target.
        options: How it plans.
    """
    options = options or DetourOptions()
    plan = plan_way(found, start, goal, options)
    straight = CameraPath(start, goal, options.limits)
    rotation, position = straight.poses(even_progress(_WAY_POSES))
    condition = inverse_condition_numbers(found.lines, rotation, position)
    return TargetCheck(
        plan.decision,
        plan.reason,
        float(condition[-1]),
        found.nearest_locus(goal.translation),
        float(condition.min()),
        min((found.distances(center)[0] for center in position), key=lambda each: each.distance),
        plan.path.sampled(_WAY_POSES) if plan.path is not None else (),
    )
