"""Levels of concern, and when one gives way to another."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass


class Level(enum.IntEnum):
    """How near to a singularity the camera is; values as in plsing_msgs/SingularityStatus."""

    OK = 0
    WARN = 1
    CRITICAL = 2
    STALE = 3
    UNOBSERVABLE = 4


@dataclass(frozen=True)
class Indicator:
    """One number that is the worse the smaller it is, with its thresholds.

    Attributes:
        value: The number, >= 0.
        warn: WARN below this; 0 switches it off.
        critical: CRITICAL below this; 0 switches it off.
        text: The number in words, for the reason: "inverse condition number 9.1e-05".
        unit: Unit of the thresholds, for the reason.
    """

    value: float
    warn: float
    critical: float
    text: str
    unit: str = ""

    def judged(self, hysteresis: float, previous: Level) -> tuple[Level, str]:
        """Return the level and why.

        A level that was in force before is left only when the value is better than its threshold by the factor
        hysteresis, so that a value at a threshold does not switch it at every cycle.
        """
        for level, threshold in ((Level.CRITICAL, self.critical), (Level.WARN, self.warn)):
            held = previous in (Level.WARN, Level.CRITICAL) and previous >= level
            limit = threshold * hysteresis if held else threshold
            if self.value < limit:
                where = f"below {threshold:.4g}{self.unit}"
                if self.value >= threshold:
                    where = f"not yet {hysteresis:g} times better than {threshold:.4g}{self.unit}"
                return level, f"{self.text} is {where}"
        return Level.OK, ""


def worst(
    indicators: Sequence[Indicator], hysteresis: float, previous: Sequence[Level]
) -> tuple[Level, str, list[Level]]:
    """Return the worst level, every reason for it, and the level of each indicator.

    Args:
        indicators: The numbers to judge.
        hysteresis: Factor >= 1, see Indicator.judged.
        previous: Level of each indicator one cycle before.
    """
    judged = [indicator.judged(hysteresis, before) for indicator, before in zip(indicators, previous, strict=True)]
    level = max((each for each, _ in judged), default=Level.OK)
    reason = "; ".join(text for each, text in judged if each == level and text)
    return level, reason, [each for each, _ in judged]
