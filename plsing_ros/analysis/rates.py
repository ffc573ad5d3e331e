# SPDX-License-Identifier: Apache-2.0
"""Shares of runs, with their intervals."""

from __future__ import annotations

import math
from typing import NamedTuple

_Z = 1.959963984540054


class Rate(NamedTuple):
    """So many of so many."""

    hits: int
    total: int

    @property
    def share(self) -> float:
        """The share; nan of none."""
        return self.hits / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the share that this is a sample of; (0, 1) if there is no sample.

        Source: Wilson, Probable inference, the law of succession, and statistical inference (1927).
        """
        if self.total == 0:
            return 0.0, 1.0
        n, p = self.total, self.share
        middle, half = p + _Z**2 / (2 * n), _Z * math.sqrt(p * (1.0 - p) / n + _Z**2 / (4 * n * n))
        low, high = (middle - half) / (1.0 + _Z**2 / n), (middle + half) / (1.0 + _Z**2 / n)
        # Where nothing or everything was hit, rounding must not say otherwise.
        return (0.0 if self.hits == 0 else max(low, 0.0)), (1.0 if self.hits == n else min(high, 1.0))

    def __str__(self) -> str:
        if self.total == 0:
            return "none"
        low, high = self.interval
        return f"{self.hits} of {self.total}, {self.share:.1%} ({low:.1%} to {high:.1%})"
