# SPDX-License-Identifier: Apache-2.0
"""Between messages about paths to a target and the core's values."""

from __future__ import annotations

from collections.abc import Iterable

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import Header

from plsing_msgs.srv import CheckTarget
from plsing_ros.geometry import Pose
from plsing_ros.nodes.conversions import locus_distance_message
from plsing_ros.nodes.pose_conversions import pose_from_message, pose_message
from plsing_ros.planning.target_check import TargetCheck


def path_message(poses: Iterable[Pose], head: Header) -> Path:
    """Return camera poses along a path in the frame of the header."""
    return Path(header=head, poses=[PoseStamped(header=head, pose=pose_message(each)) for each in poses])


def path_from_message(message: Path, frame: str) -> tuple[Pose, ...]:
    """Return T_world_camera along a path.

    Raises:
        GeometryError: If one of them is no pose, or in another frame.
    """
    return tuple(pose_from_message(each, frame) for each in message.poses)


def target_question(request: CheckTarget.Request, frame: str) -> tuple[Pose, Pose | None]:
    """Return the target, and the start or None for the present pose; T_world_camera both.

    Raises:
        GeometryError: If one of them is no pose, or in another frame.
    """
    target = pose_from_message(request.target, frame)
    return target, None if request.from_present else pose_from_message(request.start, frame)


def target_answer(check: TargetCheck, note: str, head: Header) -> CheckTarget.Response:
    """Return the answer; the note is put before its reason."""
    return CheckTarget.Response(
        success=True,
        decision=int(check.decision),
        reason=f"{note}{check.reason}",
        target_inverse_condition_number=check.target_inverse_condition_number,
        target_nearest=locus_distance_message(check.target_nearest, head.frame_id),
        straight_inverse_condition_number=check.straight_inverse_condition_number,
        straight_nearest=locus_distance_message(check.straight_nearest, head.frame_id),
        path=path_message(check.path, head),
    )
