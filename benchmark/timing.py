# SPDX-License-Identifier: Apache-2.0
"""Medians of repeated calls, interleaved so that a change of the machine's speed hits all candidates alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping


def median_seconds(
    candidates: Mapping[str, Callable[[], object]], rounds: int = 200, calls: int = 5
) -> dict[str, float]:
    """Return the median time of one call of each candidate [s].

    Args:
        candidates: What to measure, by name.
        rounds: How often each is measured, in turns.
        calls: Calls in one measurement.
    """
    times: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(rounds):
        for name, call in candidates.items():
            start = time.perf_counter()
            for _ in range(calls):
                call()
            times[name].append((time.perf_counter() - start) / calls)
    return {name: statistics.median(values) for name, values in times.items()}
