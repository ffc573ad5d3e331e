# SPDX-License-Identifier: Apache-2.0
"""The numbers that levels are judged by, each with its thresholds and its words."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from plsing_ros.features import LineObservation
from plsing_ros.features.observation import LinesVerdict
from plsing_ros.levels import Level
from plsing_ros.monitoring.approach import Approach
from plsing_ros.monitoring.closed_loop_rollout import Expected
from plsing_ros.monitoring.hysteresis import Thresholds, threshold_text
from plsing_ros.monitoring.measurement import Measurement
from plsing_ros.monitoring.risk import Risk
from plsing_ros.parameters import MonitorParameters
from plsing_ros.singularities import Kind, Proximity, SingularSet

_DISTANCES = {
    "transversal_distance": (Kind.TRANSVERSAL,),
    "isolated_point_distance": (Kind.ISOLATED_POINT,),
    "surface_distance": (Kind.PLANE, Kind.QUADRIC, Kind.CUBIC, Kind.STRAIGHT_LINE, Kind.CONIC, Kind.CURVE),
}
_CONDITION, _RELATIVE = "inverse_condition_number", "relative_inverse_condition_number"
_CRITICAL_CONDITION = "the critical inverse condition number"
_SMALLEST, _GROWTH, _TIME = "smallest_singular_value", "speed_growth", "time"
_Z, _DISTANCE, _PRECISION, _TURN = "z", "distance", "position_std", "rotation_std"
_RISK, _DEMAND, _TIME_TO_HARM, _SHAKING = "risk", "demand", "time_to_harm", "shaking"
# The worse the larger they are: their inverses are judged. With the unit that a threshold is said in.
_RISING = {_GROWTH: "times", _PRECISION: "m", _TURN: "rad", _RISK: "", _DEMAND: "times", _SHAKING: "m"}
# Those of the others, with a space before them, and what the errors of a pose are.
_UNITS = dict.fromkeys((_DISTANCE, *_DISTANCES), " m")
_ERRORS: dict[str, Callable[[Proximity], tuple[str, float, str]]] = {
    _PRECISION: lambda near: ("position", near.position_std, "m"),
    _TURN: lambda near: ("orientation", near.rotation_std, "rad"),
}
# Share of trust: POOR lines may be wrong near a singularity, of AMBIGUOUS ones every number may be of another pose.
_TRUST = {LinesVerdict.POOR: 0.5, LinesVerdict.AMBIGUOUS: 0.0}
_TRUST_THRESHOLDS = Thresholds(0.75, 0.25, 0.75, 0.25)
_SECOND = 1_000_000_000
# A rate counts when it is this many times its standard error.
_SIGNIFICANT = 3.0


class Indicator(NamedTuple):
    """One number that is the worse the smaller it is.

    Attributes:
        name: Of the number, the same in every cycle.
        value: It.
        thresholds: Where it becomes a concern.
        text: Returns it in words, for reasons.
        unit: Of the value, with a space before it.
        counts_at_once: Whether the first value decides the level; else it must last as later ones must.
    """

    name: str
    value: float
    thresholds: Thresholds
    text: Callable[[], str]
    unit: str = ""
    counts_at_once: bool = True

    def reason(self, level: Level) -> str:
        """Return why it calls for a level, in words."""
        if self.name not in _RISING:
            return f"{self.text()} is {threshold_text(self.value, self.thresholds, level, self.unit)}"
        threshold = self.thresholds.critical if level == Level.CRITICAL else self.thresholds.warn
        side = "above" if self.value < threshold else "not yet clearly below"
        return f"{self.text()} is {side} {1.0 / threshold:.4g} {_RISING[self.name]}".rstrip()


# An estimator's first image alone is often ambiguous, and the second one is not.
_TRUSTED = Indicator(
    "lines_verdict",
    1.0,
    _TRUST_THRESHOLDS,
    lambda: "trust in the 3-D lines, poor a moment ago,",
    counts_at_once=False,
)


class Indicators:
    """Makes the indicators of a cycle, for one scene and one set of parameters."""

    def __init__(self, singular: SingularSet, parameters: MonitorParameters) -> None:
        self._locus_names = singular.locus_names
        self._in_all_directions = len(parameters.columns) == 6
        mode = parameters.condition_thresholds
        self._absolute_rules, self._relative_may_rule = mode in ("absolute", "both"), mode != "absolute"
        self._absolute_stands_in = mode == "auto"
        self._thresholds = {
            name: _thresholds(parameters, name)
            for name in (*_DISTANCES, _CONDITION, _RELATIVE, _SMALLEST, _Z, _DISTANCE, *_RISING, _TIME_TO_HARM)
        }
        self._soon = Thresholds(parameters.horizon, 0.0)
        self._no_growth = Indicator(_GROWTH, math.inf, self._thresholds[_GROWTH], lambda: "speed, no longer predicted,")
        self._no_time = self._time(math.inf, _CRITICAL_CONDITION)
        self._distances = []
        for name, kinds in _DISTANCES.items():
            rows = [i for i, kind in enumerate(singular.locus_kinds) if kind in kinds]
            if rows:
                # Loci of one threshold are next to each other.
                self._distances.append((name, rows[0], rows[-1] + 1))
        self._alarm = {name: thresholds.alarm for name, thresholds in self._thresholds.items()}

    def values(self, present: Measurement) -> dict[str, float]:
        """Return the numbers of the present by their names, always in the same order."""
        _, numbers, target_inverse, distances, _, near = present
        inverse, found = numbers.inverse_condition_number, {}
        absolute, relative = self._condition_rules(target_inverse)
        if absolute:
            found[_CONDITION] = inverse
        if relative and target_inverse is not None:
            found[_RELATIVE] = inverse / target_inverse
        found[_SMALLEST] = numbers.smallest_singular_value
        if not self._in_all_directions:
            # Loci are those of a camera that moves in all directions.
            return found
        if near is not None:
            found[_DISTANCE] = near.distance
            found[_PRECISION], found[_TURN] = _inverse(near.position_std), _inverse(near.rotation_std)
            if near.z is not None:
                found[_Z] = near.z
        if distances is not None:
            of_loci = distances.distance.tolist()
            for name, start, stop in self._distances:
                found[name] = min(of_loci[start:stop])
        return found

    def are_calm(self, values: dict[str, float]) -> bool:
        """Return whether none of values() is below its first threshold, as in most cycles."""
        alarm = self._alarm
        # Many times as fast as all() for the few there are.
        for name, value in values.items():  # noqa: SIM110
            if value < alarm[name]:
                return False
        return True

    def measured(self, present: Measurement, values: dict[str, float]) -> list[Indicator]:
        """Return values() with their thresholds and words."""
        thresholds = self._thresholds
        return [
            Indicator(name, value, thresholds[name], partial(self._text, name, value, present), _UNITS.get(name, ""))
            for name, value in values.items()
        ]

    def _text(self, name: str, value: float, present: Measurement) -> str:
        """Return a number of the present in words."""
        near = present.proximity
        if name == _CONDITION:
            return condition_text(value)
        if name == _RELATIVE:
            return f"{condition_text(present.ruling.inverse_condition_number)}, {value:.3g} of that at the target,"
        if name == _SMALLEST:
            return f"smallest singular value {value:.4g}"
        if name == _DISTANCE:
            return f"distance {value:.3g} m from the nearest singular pose, to first order,"
        if name == _Z and near is not None:
            return f"z, tolerances of the lines from a singular pose ({precision_text(near)}), {value:.3g},"
        if name in _ERRORS and near is not None:
            what, error, unit = _ERRORS[name](near)
            return f"{what} error by the image's noise, {error:.3g} {unit} along the least observable motion,"
        start, stop = next(each[1:] for each in self._distances if each[0] == name)
        of_loci = [] if present.distances is None else present.distances.distance.tolist()
        return f"distance {value:.3f} m from {self._locus_names[of_loci.index(value, start, stop)]}"

    def expected(
        self, growth: Expected | None, time_to_critical: float | None, approach: Approach | None
    ) -> list[Indicator]:
        """Return what is to come as numbers; infinite where nothing is, so that an alert ends by its debounce.

        Args:
            growth: The fastest motion ahead, in multiples of the speed at the start, or None if it is not known.
            time_to_critical: Of the inverse condition number [s], or None.
            approach: The closest approach ahead if the motion goes on as it is, or None.
        """
        if growth is not None:
            return [self._growth(*growth), self._no_time]
        # Without the law, only where the motion leads if it goes on as it is.
        soon = math.inf if time_to_critical is None else time_to_critical
        if approach is not None and approach.time < soon and self._is_critical(approach):
            return [self._no_growth, self._time(approach.time, f"the closest approach to {approach.name}")]
        return [self._no_growth, self._no_time if time_to_critical is None else self._time(soon, _CRITICAL_CONDITION)]

    def predicted(self, risk: Risk, stamp: int, motion_at_target: Callable[[], str] = str) -> list[Indicator]:
        """Return what roll-outs say about the run.

        Args:
            risk: What they say.
            stamp: Of the features [ns].
            motion_at_target: Returns the least observable direction there, in words.
        """
        probability, demand, time = risk.probability, risk.demand, risk.time_to_harm
        if time is not None:
            time = max(time - (stamp - risk.stamp) / _SECOND, 0.0)

        def text() -> str:
            return f"probability of harm {probability:.2g}" + (f" ({risk.harm_text})" if time is not None else "")

        return [
            Indicator(_RISK, _inverse(probability), self._thresholds[_RISK], text),
            Indicator(_DEMAND, _inverse(demand), self._thresholds[_DEMAND], lambda: risk.demand_text),
            Indicator(
                _TIME_TO_HARM,
                math.inf if time is None else time,
                self._thresholds[_TIME_TO_HARM],
                lambda: f"time to harm, {_seconds(math.inf if time is None else time)}",
                " s",
            ),
            self._shaking(0.0 if risk.shaking is None else risk.shaking, motion_at_target),
        ]

    def _shaking(self, shaking: float, motion_at_target: Callable[[], str]) -> Indicator:
        def text() -> str:
            return (
                f"the target cannot be held: noise shakes the camera there, mostly by {motion_at_target()}; expected "
                f"root mean square distance {shaking:.2g} m"
            )

        return Indicator(_SHAKING, _inverse(shaking), self._thresholds[_SHAKING], text)

    def _growth(self, times: float, after: float, with_noise: bool) -> Indicator:
        def text() -> str:
            what_for = "possible with the features' noise" if with_noise else "expected"
            return f"speed {what_for} in {after:.2f} s, {times:.3g} times that at the start,"

        return Indicator(_GROWTH, 1.0 / times, self._thresholds[_GROWTH], text)

    def _time(self, time: float, what: str) -> Indicator:
        return Indicator(_TIME, time, self._soon, lambda: f"time to {what}, {_seconds(time)}", " s")

    def time_to_critical(
        self, inverse: float, slope: tuple[float, float] | None, target_inverse: float | None
    ) -> float | None:
        """Return when the inverse condition number is critical at its rate (and standard error) [s], or None if not."""
        if slope is None or slope[0] >= -_SIGNIFICANT * slope[1] or slope[0] >= 0.0:
            return None
        absolute, relative = self._condition_rules(target_inverse)
        limit = self._thresholds[_CONDITION].critical if absolute else 0.0
        if relative and target_inverse is not None:
            limit = max(limit, self._thresholds[_RELATIVE].critical * target_inverse)
        if inverse <= limit:
            return 0.0
        # Never infinite: a rate that is almost nothing leads nowhere.
        time = (inverse - limit) / -slope[0] if -slope[0] > 1e-300 else math.inf
        return time if time < 1e9 and limit > 0.0 else None

    def _condition_rules(self, target_inverse: float | None) -> tuple[bool, bool]:
        """Return whether the absolute and whether the relative thresholds rule."""
        relative = target_inverse is not None and target_inverse > 0.0 and self._relative_may_rule
        return self._absolute_rules or (self._absolute_stands_in and not relative), relative

    def _is_critical(self, approach: Approach) -> bool:
        name = next(name for name, kinds in _DISTANCES.items() if approach.kind in kinds)
        return approach.distance < self._thresholds[name].critical


def below_alarm(indicators: Sequence[Indicator]) -> bool:
    """Return whether one of them is below its first threshold."""
    # Many times as fast as any() for the few there are in most cycles, and by index as unpacking a part.
    for each in indicators:  # noqa: SIM110
        if each[1] < each[2].alarm:
            return True
    return False


def condition_text(inverse: float) -> str:
    """Return the inverse condition number in words."""
    return f"inverse condition number {inverse:.4g}"


def precision_text(near: Proximity) -> str:
    """Return what the image's noise makes of a pose along its least observable motion, in words."""
    return f"the image's noise is {near.position_std:.3g} m and {near.rotation_std:.3g} rad there"


def _inverse(value: float) -> float:
    return 1.0 / value if value > 0.0 else math.inf


def _seconds(time: float) -> str:
    return f"{time:.2f} s" if math.isfinite(time) else "no longer expected,"


def verdict_indicator(observation: LineObservation, is_rolled_out: bool = False) -> Indicator:
    """Return how far the 3-D lines can be trusted, as a number: no status is better than its lines.

    Lines that are POOR do not alert where a roll-out from poses within their covariance tells what comes of it.
    """
    verdict, why = observation.verdict, observation.verdict_reason
    if verdict not in _TRUST or (is_rolled_out and verdict is LinesVerdict.POOR):
        return _TRUSTED
    return Indicator(
        "lines_verdict",
        _TRUST[verdict],
        _TRUST_THRESHOLDS,
        lambda: f"trust in the 3-D lines ({verdict.name}{': ' if why else ''}{why})",
        counts_at_once=False,
    )


def _thresholds(parameters: MonitorParameters, name: str) -> Thresholds:
    warn, warn_exit, critical, critical_exit = (
        # The worse the larger it is: its inverse is judged.
        1.0 / value if name in _RISING and value > 0.0 else value
        for value in parameters.thresholds(name)
    )
    return Thresholds(warn, critical, warn_exit, critical_exit)
