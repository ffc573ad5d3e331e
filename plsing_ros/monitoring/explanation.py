# SPDX-License-Identifier: Apache-2.0
"""Why a level is in force, in words that are made when somebody reads them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.alarm_state import reasons, with_position
from plsing_ros.monitoring.hysteresis import OK
from plsing_ros.monitoring.indicators import Indicator, condition_text, precision_text
from plsing_ros.monitoring.measurement import Measurement
from plsing_ros.monitoring.monitored_scene import MonitoredScene
from plsing_ros.monitoring.unobservable_motion_text import unobservable_motion_text


class Explanation(NamedTuple):
    """What the words of one assessment are made from.

    Attributes:
        scene: That is seen.
        found: What was measured.
        indicators: Numbers that were judged; none where all are well.
        levels: Of these.
        level: The worst of them.
        is_near: Whether a number of the present is below its first threshold.
        calm: Why that alone is no trouble, or "" if it is.
        source: Of the pose, as Assessment has it.
        pose_tolerance: How far apart stamps of features and pose may be [s].
        pose: T_world_camera, or None if it is not known.
        note: What else there is to say.
    """

    scene: MonitoredScene
    found: Measurement
    indicators: Sequence[Indicator]
    levels: Sequence[Level]
    level: Level
    is_near: bool
    calm: str
    source: str
    pose_tolerance: float
    pose: Pose | None
    note: str

    def reason(self) -> str:
        """Return why the level is in force."""
        everywhere, found = self.scene.singular_everywhere, self.found
        otherwise = condition_text(found.ruling.inverse_condition_number)
        reason = reasons(self.indicators, self.levels, everywhere, otherwise)
        reason = with_position(reason, found.nearest, self.source, self.pose_tolerance)
        reason += absolute_text(self.scene, found)
        passes = self.calm and self.is_near and self.level is OK
        return (f"{reason}; near a singularity, {self.calm}" if passes else reason) + self.note

    def unobservable_motion(self) -> str:
        """Return the least observable direction near a singularity; else nothing."""
        if not self.is_near and self.level is OK:
            return ""
        weakest = self.found.ruling.least_observable_direction
        return unobservable_motion_text(weakest, self.pose, self.scene.singular, self.found.nearest)


def absolute_text(scene: MonitoredScene, found: Measurement) -> str:
    """Return what is left of the precision of a pose in a scene that is singular everywhere, or ""."""
    near = found.proximity
    return "" if near is None or not scene.singular_everywhere else f"; {precision_text(near)}"
