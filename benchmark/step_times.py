# SPDX-License-Identifier: Apache-2.0
"""When a simulator makes its steps."""

from __future__ import annotations

import time

import numpy as np
from rclpy.task import Future

FRAMES, FIRST_FRAMES = 3000, 100  # the first ones are not counted


class StepTimes:
    """Notes the time of each step.

    Attributes:
        done: Done after the last one.
    """

    def __init__(self) -> None:
        self._times: list[float] = []
        self.done: Future[None] = Future()

    def note(self) -> None:
        """Note a step that has just been made."""
        self._times.append(time.perf_counter())
        if len(self._times) == FIRST_FRAMES + FRAMES + 1:
            self.done.set_result(None)

    def milliseconds(self) -> list[float]:
        """Return the times from one frame to the next [ms].

        Raises:
            RuntimeError: If there were fewer frames.
        """
        if not self.done.done():
            raise RuntimeError(f"only {len(self._times)} of {FIRST_FRAMES + FRAMES + 1} steps were made")
        return (1e3 * np.diff(self._times[FIRST_FRAMES : FIRST_FRAMES + FRAMES + 1])).tolist()
