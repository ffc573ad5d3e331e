# SPDX-License-Identifier: Apache-2.0
"""What the answers of roll-outs say together about a run."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.monitoring.evidence import Evidence, Sizes
from plsing_ros.monitoring.risk import Risk
from plsing_ros.planning.rollout import DEMAND_SHARE, Outcomes

_SECOND = 1_000_000_000
# Answers of about this time count together [s].
_MEMORY = 1.0


class RunMemory:
    """Counts answers of one run, made one after the other, together with those of about the last second."""

    def __init__(self) -> None:
        self._latest: Risk | None = None
        self._evidence, self._speeds = Evidence(), Sizes()

    def risk(self, stamp: int, outcomes: Outcomes, shaking: float | None, lacks_path: bool) -> Risk:
        """Return what is known of the run with one more answer.

        Args:
            stamp: Of the features that it starts from [ns].
            outcomes: Of its samples.
            shaking: As Risk has it.
            lacks_path: Likewise; what was said without the path counts no more once it is there.
        """
        before = self._latest
        since = _MEMORY if before is None else (stamp - before.stamp) / _SECOND
        kept = math.exp(-max(since, 0.0) / _MEMORY)
        if before is not None and before.lacks_path and not lacks_path:
            self._evidence, self._speeds = Evidence(), Sizes()
        probability = self._evidence.add(np.count_nonzero(outcomes.kind), len(outcomes.kind), kept)
        demand = self._speeds.add(outcomes.demand, kept, DEMAND_SHARE)
        # Cached for those who ask in every cycle.
        _ = outcomes.time_to_harm, outcomes.harm
        self._latest = Risk(stamp, outcomes, probability, demand, shaking, lacks_path)
        return self._latest
