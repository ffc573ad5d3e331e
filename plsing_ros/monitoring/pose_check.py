# SPDX-License-Identifier: Apache-2.0
"""What a camera would be told at a pose where it is not."""

from __future__ import annotations

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.alarm_state import reasons, with_position, worst
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.explanation import absolute_text
from plsing_ros.monitoring.indicators import Indicators, condition_text
from plsing_ros.monitoring.law_risks import laws_text, risks_of_laws
from plsing_ros.monitoring.monitored_scene import MonitoredScene, usable_lines
from plsing_ros.monitoring.monitored_target import MonitoredTarget
from plsing_ros.monitoring.risk import Risk
from plsing_ros.monitoring.unobservable_motion_text import unobservable_motion_text
from plsing_ros.parameters import MonitorParameters


def assess_pose(
    T_world_camera: Pose,
    scene: MonitoredScene,
    indicators: Indicators,
    target: MonitoredTarget | None,
    T_world_target: Pose | None,
    parameters: MonitorParameters,
    ends: Array | None,
) -> Assessment:
    """Return what a camera that sees all lines of the scene would be told at a pose.

    Its level is without hysteresis, debounce and prediction; relative thresholds take part if a target is known. If it
    is, and so is the loop, its reason says what each law would do from there; its risk is the plain law's.

    Args:
        T_world_camera: The pose.
        scene: That the camera sees.
        indicators: Of that scene, by the parameters.
        target: What is seen at the target, if it is known.
        T_world_target: Where the target is, if it is known.
        parameters: In force.
        ends: Of the scene's lines as far as a tracker has seen them, as for rollout_task, or None.
    """
    singular = scene.singular
    seen = LineObservation.of_lines(singular.lines.transformed(T_world_camera.inverse(), "camera"))
    try:
        lines = usable_lines(seen)
    except ObservationError as error:
        why = str(error)
        return Assessment(Level.UNOBSERVABLE, lambda: why, 0)
    target_inverse = None if target is None else target.at(lines.ids).inverse_condition_number
    found = scene.measure(lines, T_world_camera, target_inverse)
    measured = indicators.measured(found, indicators.values(found))
    levels = [each.thresholds.entered(each.value) for each in measured]
    level = worst(levels, scene.singular_everywhere)
    ruling, nearest = found.ruling, found.nearest
    reason = reasons(measured, levels, scene.singular_everywhere, condition_text(ruling.inverse_condition_number))
    reason = with_position(reason, nearest, "pose asked for", parameters.pose_tolerance)
    reason += absolute_text(scene, found)
    risks: dict[str, Risk] = {}
    if T_world_target is not None and parameters.controller == "law":
        risks = risks_of_laws(T_world_camera, singular, T_world_target, parameters, ends)
        reason = f"{reason}; rolled out to the target, {laws_text(risks)}"
    lost = (
        ""
        if level is Level.OK
        else unobservable_motion_text(ruling.least_observable_direction, T_world_camera, singular, nearest)
    )
    return Assessment(
        level,
        lambda: reason,
        0,
        line_count=len(lines),
        conditioning=found.conditioning,
        locus_distances=None if found.distances is None else found.distances.distance,
        nearest=nearest,
        position_source="camera_pose",
        describe_unobservable_motion=lambda: lost,
        target_inverse_condition_number=target_inverse,
        proximity=found.proximity,
        risk=risks.get("pinv"),
    )
