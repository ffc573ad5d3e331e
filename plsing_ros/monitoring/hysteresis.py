# SPDX-License-Identifier: Apache-2.0
"""When one level of concern gives way to another: thresholds, debounce, hysteresis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from plsing_ros.levels import Level

# Where no exit threshold is given: this times the enter threshold.
DEFAULT_EXIT = 1.2


# A look-up in an enumeration costs as much as the rest of a quiet cycle.
OK = Level.OK


@dataclass(frozen=True)
class Thresholds:
    """Where a number that is the worse the smaller it is becomes a concern, and where it stops being one.

    Attributes:
        warn: WARN is entered below this; 0 switches it off.
        warn_exit: WARN is left at or above this, >= warn; 0 stands for DEFAULT_EXIT times warn.
        critical: CRITICAL is entered below this; 0 switches it off.
        critical_exit: CRITICAL is left at or above this, >= critical; 0 likewise.
    """

    warn: float
    critical: float
    warn_exit: float = 0.0
    critical_exit: float = 0.0

    @cached_property
    def alarm(self) -> float:
        """The first level is entered below this."""
        return max(self.warn, self.critical)

    def off(self, level: Level) -> bool:
        """Return whether no value enters a level, WARN or CRITICAL."""
        return (self.critical if level == Level.CRITICAL else self.warn) == 0.0 and level != Level.OK

    def entered(self, value: float) -> Level:
        """Return the level that a value enters by itself."""
        if value < self.critical:
            return Level.CRITICAL
        return Level.WARN if value < self.warn else Level.OK

    def kept(self, value: float, level: Level) -> Level:
        """Return the worst level, up to the given one, that a value is too small to leave."""
        if level == Level.CRITICAL and value < (self.critical_exit or DEFAULT_EXIT * self.critical):
            return Level.CRITICAL
        if level >= Level.WARN and value < (self.warn_exit or DEFAULT_EXIT * self.warn):
            return Level.WARN
        return Level.OK


@dataclass(frozen=True)
class Debounce:
    """How many cycles in a row a change must last.

    Attributes:
        to_raise: Cycles below an enter threshold before the level is raised.
        to_lower: Cycles at or above an exit threshold before the level is lowered.
    """

    to_raise: int = 1
    to_lower: int = 1


class Hysteresis:
    """The level of one number, with hysteresis and debounce.

    The first number counts at once, unless a level to begin with is given: there is nothing yet that it could chatter
    against.

    Attributes:
        calm: Whether a number above all thresholds changes nothing: the level is OK, and not about to be raised.
    """

    def __init__(self, level: Level | None = None) -> None:
        self.calm = False
        self._level = level
        self._better: Level = Level.OK
        self._raising = 0
        self._lowering = 0

    def update(self, value: float, thresholds: Thresholds, debounce: Debounce) -> Level:
        """Return the level after one more number."""
        entered = thresholds.entered(value)
        if self._level is None or thresholds.off(self._level):
            # Also where a level was switched off while it was in force: there is nothing any more to stay below.
            self._level, self._raising, self._lowering = entered, 0, 0
            self.calm = entered == Level.OK
            return entered
        kept = max(entered, thresholds.kept(value, self._level))
        if entered > self._level:
            self._raising, self._lowering = self._raising + 1, 0
            if self._raising >= debounce.to_raise:
                self._level, self._raising = entered, 0
        elif kept < self._level:
            # The worst level of the whole wait: a single good number does not decide how far down to go.
            self._better = max(kept, self._better) if self._lowering else kept
            self._raising, self._lowering = 0, self._lowering + 1
            if self._lowering >= debounce.to_lower:
                self._level, self._lowering = self._better, 0
        else:
            self._raising = self._lowering = 0
        self.calm = self._level == Level.OK and self._raising == 0
        return self._level


def threshold_text(value: float, thresholds: Thresholds, level: Level, unit: str = "") -> str:
    """Return how a value stands to the threshold of the level in force, in words: "below 0.001"."""
    threshold = thresholds.critical if level == Level.CRITICAL else thresholds.warn
    leaving = thresholds.critical_exit if level == Level.CRITICAL else thresholds.warn_exit
    if value < threshold:
        return f"below {threshold:.4g}{unit}"
    leaving = leaving or DEFAULT_EXIT * threshold
    if value < leaving:
        return f"not yet above {leaving:.4g}{unit}"
    return f"not above {leaving:.4g}{unit} for long enough yet"
