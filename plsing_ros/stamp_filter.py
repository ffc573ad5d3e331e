# SPDX-License-Identifier: Apache-2.0
"""Which stamped messages are recent enough to act on."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.errors import ObservationError

_SECOND = 1_000_000_000
# Zero means "no stamp" in a message; in Python a start time of zero, or a few years before it, is a time.
_ORIGIN = 10**18


def stamp_from_seconds(time: float) -> int:
    """Return a stamp [ns] for a time in seconds from anywhere, for StampFilter: never zero, in the same order.

    Raises:
        ObservationError: If the time is not a finite number, or beyond 1e9 s.
    """
    if not -1e9 < time < 1e9:
        raise ObservationError(f"time is {time} s; it must be a number between -1e9 and 1e9 s")
    return _ORIGIN + round(time * _SECOND)


@dataclass
class StampFilter:
    """Judges stamps of one input: too old, too far ahead, or older than one already accepted.

    A stamp equal to the last one is accepted: it is the same frame, sent again. One ahead of the clock counts as of
    now, so that it does not keep out those that follow. When the clock itself jumps back (a bag that loops, a
    simulation that restarts), the memory of earlier stamps is dropped.

    Attributes:
        what: Name of the input, for the reasons, as a plural noun ("features").
        timeout: Age up to which a stamp is accepted [s].
        future_tolerance: How far ahead of the clock a stamp may be [s].
        parameter: Name of the parameter that the timeout is, where the first message after a silence that was noticed
            is refused: else who acts on messages that come more seldom would start and stop without end. Empty: it is
            accepted.
    """

    what: str
    timeout: float
    future_tolerance: float
    parameter: str = ""

    def __post_init__(self) -> None:
        self._last_stamp: int | None = None
        self._last_now: int | None = None
        self._last_problem: str | None = None
        self._was_silent = False

    @property
    def last_stamp(self) -> int | None:
        """The last accepted stamp [ns], or None."""
        return self._last_stamp

    @property
    def last_problem(self) -> str | None:
        """Why the latest message could not be used, or None if it could."""
        return self._last_problem

    def note_problem(self, problem: str) -> None:
        """Remember why the latest message could not be used, for the reason of a later silence."""
        self._last_problem = problem

    def refusal(self, stamp: int, now: int) -> str | None:
        """Return why a message with this stamp must not be used, or None and remember it.

        Args:
            stamp: Of the message [ns].
            now: Of the node clock [ns].
        """
        problem = self._problem(stamp, now)
        if problem is None:
            before, self._last_stamp = self._last_stamp, stamp if stamp < now else now
            if self._was_silent:
                self._was_silent = False
                if self.parameter and before is not None:
                    problem = self._too_seldom((self._last_stamp - before) / _SECOND)
        self._last_problem = problem
        return problem

    def is_stray(self, stamp: int, now: int) -> bool:
        """Return whether a message is late, out of order or from the future among good ones: to be left alone.

        Args:
            stamp: Of the message [ns].
            now: Of the node clock [ns].
        """
        problem = self._problem(stamp, now)
        if problem is None or self.silence(now) is not None:
            return False
        self._last_problem = problem
        return True

    def silence(self, now: int) -> str | None:
        """Return why there is nothing to act on now [ns], or None if the last accepted message is recent enough."""
        self.follow_clock(now)
        age = None if self._last_stamp is None else (now - self._last_stamp) / _SECOND
        if age is not None and age <= self.timeout:
            return None
        self._was_silent = self._was_silent or age is not None
        if self._last_problem is not None:
            since = "" if age is None else f" for {age:.3g} s, allowed are {self.timeout:g} s"
            return f"the {self.what} that come are refused{since}: {self._last_problem}"
        if age is None:
            return f"no {self.what} received yet"
        return f"no {self.what} for {age:.3g} s, allowed are {self.timeout:g} s"

    def _too_seldom(self, gap: float) -> str | None:
        if gap <= self.timeout:
            return None
        return f"{self.what} come every {gap:.3g} s, {self.parameter} is {self.timeout:g} s"

    def _problem(self, stamp: int, now: int) -> str | None:
        self.follow_clock(now)
        age = (now - stamp) / _SECOND
        if stamp == 0:
            return f"{self.what} have no stamp (it is zero); the publisher must set header.stamp"
        if stamp < 0:
            return f"{self.what} are stamped at {stamp / _SECOND:.9g} s, before time zero"
        if age > self.timeout:
            hint = "; do the clocks agree, and is use_sim_time set where it must be?" if age > 60.0 else ""
            return f"{self.what} are {age:.3g} s old, allowed are {self.timeout:g} s{hint}"
        if age < -self.future_tolerance:
            hint = "; do the clocks agree, and is use_sim_time set where it must be?" if age < -60.0 else ""
            return (
                f"{self.what} are stamped {-age:.3g} s ahead of the clock, allowed are "
                f"{self.future_tolerance:g} s{hint}"
            )
        if self._last_stamp is not None and stamp < self._last_stamp:
            back = (self._last_stamp - stamp) / _SECOND
            return f"{self.what} came out of order: stamped {back:.3g} s before earlier ones"
        return None

    def follow_clock(self, now: int) -> bool:
        """Return whether the clock has jumped back to now [ns] since the last call, and forget earlier stamps if so."""
        before, self._last_now = self._last_now, now
        # The first comparison is for speed alone.
        if before is None or now >= before or now >= before - int(self.future_tolerance * _SECOND):
            return False
        self._last_stamp = None
        return True
