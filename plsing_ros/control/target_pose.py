# SPDX-License-Identifier: Apache-2.0
"""Where a controller leads: the target by its parameters, its pose in the scene, and whether it can be held."""

from __future__ import annotations

from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.features.target import Target
from plsing_ros.geometry import Pose
from plsing_ros.parameters import ControllerParameters
from plsing_ros.singularities.scene_loci import SceneLoci


def task_of(parameters: ControllerParameters) -> tuple[object, ...]:
    """Return what a target and a scene are made from."""
    return parameters.scene, parameters.target_position, parameters.target_orientation


def target_seen_from(parameters: ControllerParameters) -> Target:
    """Return what the camera sees at the target pose."""
    seen = parameters.lines().transformed(parameters.target_pose().inverse(), "camera at the target")
    return Target(LineObservation.of_lines(seen), "target pose")


def target_pose(target: Target, loci: SceneLoci | None, parameters: ControllerParameters) -> Pose | None:
    """Return T_world_camera of a target, or None if it is not known."""
    if parameters.target_source == "pose":
        return parameters.target_pose()
    if loci is None or target.lines is None:
        return None
    try:
        return loci.camera_pose(target.lines)
    except ObservationError:
        # Reversed lines do not keep the laws that need no pose from going there.
        return None


def target_problems(target: Target, loci: SceneLoci | None, parameters: ControllerParameters) -> tuple[str, str]:
    """Return why a target is refused, and what is doubtful about it and the parameters; "" where nothing is."""
    condition = target.view(target.ids, parameters.columns).inverse_condition_number
    if condition is None:
        return "", ""
    if condition < parameters.min_target_condition:
        pose = target_pose(target, loci, parameters)
        near = "" if loci is None or pose is None else loci.nearest_text(pose.translation)
        refused = (
            f"the target is at a singularity: its inverse condition number {condition:.3g} is below "
            f"the smallest allowed for a target, {parameters.min_target_condition:g}{near}"
        )
        return refused, ""
    if condition > parameters.pinv_threshold:
        return "", ""
    return "", (
        f"pinv_threshold {parameters.pinv_threshold:g} is above the target's own inverse condition number "
        f"{condition:.3g}: a motion is given up before the target is reached, and the camera stops short of it"
    )
