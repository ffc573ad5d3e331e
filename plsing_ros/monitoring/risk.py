# SPDX-License-Identifier: Apache-2.0
"""How likely a run is to come to harm, how much speed it demands, and what is said of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.planning.rollout import Harm, Outcomes

_HARM_TEXT = {
    Harm.AWAY: "the camera leaves the neighbourhood of its path",
    Harm.FEW_LINES: "fewer than three lines stay in view",
    Harm.LATE: "the target is not reached in time",
}


@dataclass(frozen=True, eq=False)
class Risk:
    """What roll-outs say about the run.

    Attributes:
        stamp: Of the features that the latest answer starts from [ns].
        outcomes: Of all its samples.
        probability: Of harm within the horizon, by this answer's samples and those of about the last second.
        demand: Largest commanded speed over the robot's limit, or 1.5 times the first one if that is more, as a quarter
            of these samples reaches it.
        shaking: How far noise drives the camera about the target, root mean square [m]; None: not known yet.
        lacks_path: Whether the law waits for its path: what is rolled out is the straight way, which it may avoid.
    """

    stamp: int
    outcomes: Outcomes
    probability: float
    demand: float
    shaking: float | None = None
    lacks_path: bool = False

    @property
    def time_to_harm(self) -> float | None:
        """Median of the samples that come to harm, from the stamp on [s]; None if none does."""
        return self.outcomes.time_to_harm

    @property
    def harm(self) -> Harm:
        """The most frequent kind of harm, NONE if no sample comes to harm."""
        return self.outcomes.harm

    @property
    def harm_text(self) -> str:
        """What kind of harm is expected, in words; "" if none."""
        time = self.time_to_harm
        return "" if time is None else f"in {time:.1f} s {_HARM_TEXT[self.harm]}"

    @property
    def demand_text(self) -> str:
        """How much speed is demanded, in words."""
        times = self.outcomes.demand_time[self.outcomes.demand_time >= 0.0]
        when = f" in {float(np.median(times)):.1f} s" if len(times) else ""
        return f"speed expected{when}, {self.demand:.3g} times the limit,"
