"""When a simulator makes its steps."""

from __future__ import annotations

import os
import signal
import time

import numpy as np

FRAMES, FIRST_FRAMES = 1000, 50  # the first ones are not counted


class StepTimes:
    """Notes the time of each step; stops its process after the last one, if it shall."""

    def __init__(self, ends_process: bool) -> None:
        self._times: list[float] = []
        self._ends_process = ends_process

    def note(self) -> None:
        """Note a step that has just been made."""
        self._times.append(time.perf_counter())
        if self._ends_process and self.are_enough:
            os.kill(os.getpid(), signal.SIGTERM)

    @property
    def are_enough(self) -> bool:
        """Whether all frames have been counted."""
        return len(self._times) > FIRST_FRAMES + FRAMES

    def milliseconds(self) -> list[float]:
        """Return the times from one frame to the next [ms]."""
        return (1e3 * np.diff(self._times[FIRST_FRAMES : FIRST_FRAMES + FRAMES + 1])).tolist()
