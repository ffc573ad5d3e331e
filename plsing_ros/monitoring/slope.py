# SPDX-License-Identifier: Apache-2.0
"""Rate of a number that comes with noise."""

from __future__ import annotations

import math
from collections import deque

_SECOND = 1_000_000_000


class Slope:
    """Rate of a number over its latest samples: the slope of the line that fits them best.

    Over the 10 samples of the default, noise of standard deviation s on each gives the rate a standard deviation of
    0.11 s per sampling interval, against 1.41 s of the difference of two.
    """

    def __init__(self, length: int) -> None:
        self._samples: deque[tuple[int, float]] = deque(maxlen=length)

    def add(self, value: float, stamp: int) -> tuple[float, float] | None:
        """Return the rate [1/s] and its standard error with one more value at a stamp [ns].

        None with fewer than two different stamps; the error is infinite with fewer than four. A stamp that is not
        later than the last one changes nothing; after a gap of more than a second, what was before is forgotten.
        """
        if self._samples:
            step = stamp - self._samples[-1][0]
            if step <= 0:
                return None
            if step > _SECOND:
                self._samples.clear()
        self._samples.append((stamp, value))
        n = len(self._samples)
        if n < 2:
            return None
        # Sums about the latest sample.
        sum_t = sum_v = sum_tt = sum_tv = sum_vv = 0.0
        for each_stamp, each in self._samples:
            t, v = (each_stamp - stamp) / _SECOND, each - value
            sum_t += t
            sum_v += v
            sum_tt += t * t
            sum_tv += t * v
            sum_vv += v * v
        spread = sum_tt - sum_t * sum_t / n
        rate = (sum_tv - sum_t * sum_v / n) / spread
        if n < 4:
            return rate, math.inf
        rest = max(sum_vv - sum_v * sum_v / n - rate * rate * spread, 0.0)
        return rate, math.sqrt(rest / ((n - 2) * spread))
