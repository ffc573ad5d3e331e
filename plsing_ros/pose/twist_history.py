# SPDX-License-Identifier: Apache-2.0
"""How a camera was told to move, over time."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from plsing_ros.arrays import Array

# Twists that are kept: at 1 kHz, those of more than a second.
_MAX_TWISTS = 2000
# Two times are the same within this, so that rounding makes no steps of its own [s].
_SAME_TIME = 1e-7


@dataclass(frozen=True, eq=False)
class _Held:
    start: float
    end: float
    twist: Array | None


class MeanTwist:
    """Mean of twists, weighed by exp(-age / time).

    Args:
        time: How far back it reaches [s].
    """

    def __init__(self, time: float) -> None:
        self._time = time
        self._mean: Array | None = None

    def after(self, twist: Array | None, duration: float) -> Array | None:
        """Return the mean after a twist for a duration [s]; None, and all before is forgotten, if it is not known."""
        if twist is None or self._mean is None:
            self._mean = twist
        else:
            self._mean = self._mean - math.expm1(-duration / self._time) * (twist - self._mean)
        return self._mean


class TwistHistory:
    """Twists (v, omega) of the camera in its own frame, each of which holds until the next one, or until it is too old.

    Args:
        timeout: How long a twist holds if no other one follows [s].
        latency: How much later than told the camera moves [s].
    """

    def __init__(self, timeout: float, latency: float) -> None:
        self.timeout = timeout
        self.latency = latency
        self._held: deque[_Held] = deque(maxlen=_MAX_TWISTS)

    def add(self, twist: Array | None, start: float, duration: float | None = None) -> None:
        """Append a twist.

        Args:
            twist: Shape (6,) [m/s, rad/s]; None: the camera moves in an unknown way.
            start: When it was told [s].
            duration: How long it holds at least [s]; None: not known.
        """
        begin = start + self.latency
        while self._held and self._held[-1].start >= begin - _SAME_TIME:
            # The clock was set back, or a twist was sent again.
            self._held.pop()
        if self._held and (self._held[-1].end > begin):
            last = self._held.pop()
            self._held.append(_Held(last.start, begin, last.twist))
        self._held.append(_Held(begin, begin + (self.timeout if duration is None else duration), twist))

    def clear(self) -> None:
        """Forget all twists."""
        self._held.clear()

    def between(self, start: float, end: float) -> Iterator[tuple[float, Array | None]]:
        """Yield durations [s] and twists that fill the time from start to end [s]; None where the twist is not known.

        What is before `start` is forgotten.
        """
        while len(self._held) > 1 and self._held[0].end <= start and self._held[1].start <= start:
            self._held.popleft()
        now, last = start, None
        for each in tuple(self._held):
            if each.start >= end:
                break
            if each.end <= now:
                last = each
                continue
            if each.start > now + _SAME_TIME:
                yield from self._gap(last, now, each.start)
                now = each.start
            until = min(each.end, end)
            if until > now + _SAME_TIME:
                yield until - now, each.twist
                now = until
            last = each
        if end > now + _SAME_TIME:
            yield from self._gap(last, now, end)

    def _gap(self, last: _Held | None, start: float, end: float) -> Iterator[tuple[float, Array | None]]:
        """Yield what fills a time that no twist was given for: the last one while it holds, then nothing known."""
        holds = start if last is None else min(end, max(start, last.start + self.timeout))
        if last is not None and holds > start + _SAME_TIME:
            yield holds - start, last.twist
        if end > holds + _SAME_TIME:
            yield end - max(holds, start), None
