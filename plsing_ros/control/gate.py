# SPDX-License-Identifier: Apache-2.0
"""The monitor's permission to move."""

from __future__ import annotations

from plsing_ros.levels import Level
from plsing_ros.stamp_filter import StampFilter


class StatusGate:
    """Open while the latest status of the monitor is recent and of a level that is allowed.

    Attributes:
        worst: The worst level that opens it.
        publishers: How many publish statuses; more than one, and somebody may be forging them.
    """

    def __init__(self, worst: Level, timeout: float, future_tolerance: float) -> None:
        self.worst = worst
        self.publishers = 1
        self._stamp_filter = StampFilter("singularity statuses", timeout, future_tolerance)
        self._level = Level.STALE
        self._reason = ""
        self._has_risk = False

    def set_times(self, timeout: float, future_tolerance: float) -> None:
        """Use other times [s], as in StampFilter, from now on."""
        self._stamp_filter.timeout, self._stamp_filter.future_tolerance = timeout, future_tolerance

    def receive(self, level: int, reason: str, stamp: int, now: int, has_risk: bool = False) -> None:
        """Take a status with its stamp, at a time of the node clock [ns]; one that is not fresh changes nothing.

        Args:
            level: Of the status, a value of Level.
            reason: For it.
            stamp: Of the status [ns].
            now: Of the node clock [ns].
            has_risk: Whether it says what comes of the run.
        """
        try:
            known = Level(level)
        except ValueError:
            self._stamp_filter.note_problem(f"level {level} is none")
            return
        if self._stamp_filter.refusal(stamp, now) is None:
            self._level, self._reason, self._has_risk = known, reason, has_risk

    def may_be_left(self, now: int) -> bool:
        """Return whether an alarm has closed it, now [ns], and not that nobody watches."""
        return self._level in (Level.WARN, Level.CRITICAL) and self._stamp_filter.silence(now) is None

    def closed(self, now: int, needs_risk: bool = False) -> str | None:
        """Return why the robot must not move now [ns], or None; needs_risk: not before the monitor has said a risk."""
        silence = self._stamp_filter.silence(now)
        who = "" if self.publishers == 1 else f" (singularity_status has {self.publishers} publishers)"
        if silence is not None:
            return f"the gate is closed: {silence}{who}"
        if self._level > self.worst:
            return (
                f"the gate is closed: the monitor says {self._level.name}, allowed is {self.worst.name}: "
                f"{self._reason}{who}"
            )
        if needs_risk and not self._has_risk:
            return "the gate is closed: the monitor has not said a risk yet; it needs the law, the target and a pose"
        return None
