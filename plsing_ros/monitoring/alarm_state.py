# SPDX-License-Identifier: Apache-2.0
"""The worst of all indicators, with the memory that keeps a level from chattering, and why in words."""

from __future__ import annotations

import math
from collections.abc import Sequence

from plsing_ros.levels import Level
from plsing_ros.monitoring.hysteresis import OK, Debounce, Hysteresis
from plsing_ros.monitoring.indicators import Indicator
from plsing_ros.singularities import LocusDistance


class AlarmState:
    """Levels of all indicators over the cycles.

    Attributes:
        debounce: In force from the next cycle on.
    """

    def __init__(self, debounce: Debounce) -> None:
        self.debounce = debounce
        self._of_indicator: dict[str, Hysteresis] = {}
        self._alerting: dict[str, Indicator] = {}
        self._calm_for: list[str] = []

    def forget(self) -> None:
        """Begin anew: the next numbers count at once."""
        self._of_indicator.clear()
        self._alerting.clear()
        self._calm_for = []

    def with_missing(self, indicators: list[Indicator]) -> list[Indicator]:
        """Return indicators and those that alerted but have no number any more, so that they end by their debounce."""
        if not self._alerting:
            return indicators
        present = {each.name for each in indicators}
        return indicators + [_without_number(each) for name, each in self._alerting.items() if name not in present]

    def is_calm(self, names: Sequence[str]) -> bool:
        """Return whether numbers of these names, those of the last cycle, above all their thresholds change nothing."""
        return self._calm_for == names

    def levels(self, indicators: Sequence[Indicator], suppressed: int = 0) -> list[Level]:
        """Return the level of each indicator, after one more cycle; the first few do not count at present."""
        # Local names, and no call where nothing happens: this is done for every number in every cycle.
        known, levels = self._of_indicator, []
        for i, (name, value, thresholds, *_) in enumerate(indicators):
            hysteresis = known.get(name)
            if hysteresis is None:
                hysteresis = known[name] = Hysteresis(None if indicators[i].counts_at_once else OK)
            if i < suppressed:
                value = math.inf
            if hysteresis.calm and value >= thresholds.alarm:
                levels.append(OK)
                continue
            level = hysteresis.update(value, thresholds, self.debounce)
            if level is not OK:
                self._alerting[name] = indicators[i]
            else:
                self._alerting.pop(name, None)
            levels.append(level)
        names = [each.name for each in indicators]
        self._calm_for = names if all(known[name].calm for name in names) else []
        return levels


def _without_number(indicator: Indicator) -> Indicator:
    words = f"{indicator.name.replace('_', ' ')}, not known any more,"
    return indicator._replace(value=math.inf, text=lambda: words)


def worst(levels: Sequence[Level], singular_everywhere: str) -> Level:
    """Return the worst of the levels of all indicators; UNOBSERVABLE where every camera is singular."""
    return Level.UNOBSERVABLE if singular_everywhere else max(levels, default=OK)


def worst_names(indicators: Sequence[Indicator], levels: Sequence[Level], level: Level) -> str:
    """Return the names of the indicators that call for the level in force; "" for OK."""
    if level is OK:
        return ""
    return " ".join(each.name for each, own in zip(indicators, levels, strict=True) if own == level)


def reasons(indicators: Sequence[Indicator], levels: Sequence[Level], singular_everywhere: str, otherwise: str) -> str:
    """Return why the worst level is in force; `otherwise` is what to say when all is well."""
    level = worst(levels, singular_everywhere)
    if level is Level.UNOBSERVABLE:
        return f"the scene is singular for every camera: {singular_everywhere}"
    if level is OK:
        return otherwise
    return "; ".join(each.reason(level) for each, own in zip(indicators, levels, strict=True) if own == level)


def with_position(reason: str, nearest: LocusDistance | None, source: str, pose_tolerance: float) -> str:
    """Return a reason with the nearest locus, and where the camera position is from if not from camera_pose."""
    if source == "":
        return (
            f"{reason}; distances not known: no camera_pose within {pose_tolerance:g} s of the features, "
            "and their 3-D lines do not fit the scene"
        )
    if nearest is not None and f"from {nearest.name}" not in reason:
        reason = f"{reason}; {nearest.distance:.3f} m from {nearest.name}"
    if source == "features":
        reason += " (camera position from the features, no recent camera_pose)"
    return reason
