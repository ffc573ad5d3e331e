# SPDX-License-Identifier: Apache-2.0
"""What the camera sees of each line, against what the map says: the mean of the latest frames, and how sure it is."""

from __future__ import annotations

from collections import deque

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet

# Frames whose mean counts: of older ones the view was another.
_FRAMES = 30.0
# Fewer than these tell nothing of their own spread.
_MIN_FRAMES = 3.0
# A spread below this is not believed: rounding, or noise that all frames share [rad], [-].
_MIN_DEVIATION = 1e-4


class MapResiduals:
    """Means of (phi, rho) of the image lines minus those of the message's own 3-D lines, which are the map's.

    Source: new, docs/concepts/risk.md.
    """

    def __init__(self, scene: LineSet) -> None:
        n = len(scene)
        self._row_of = {i: row for row, i in enumerate(scene.ids)}
        self._waiting: deque[LineObservation] = deque(maxlen=round(_FRAMES))
        self._frames = np.zeros(n)
        self._mean = np.zeros((n, 2))
        self._square = np.zeros((n, 2, 2))

    def add(self, observation: LineObservation) -> None:
        """Take one more frame, to be looked at when rows are asked for; without 3-D lines it tells nothing."""
        if observation.lines_camera is not None:
            self._waiting.append(observation)

    def _take(self, observation: LineObservation) -> None:
        lines = observation.lines_camera
        assert lines is not None
        kept = [(self._row_of[i], k) for k, i in enumerate(observation.usable_ids) if i in self._row_of]
        if not kept:
            return
        rows, which = (list(each) for each in zip(*kept, strict=True))
        image, moment = observation.usable_image_lines[which], lines.moment[which]
        x, y, z = (moment / np.hypot(moment[:, 0], moment[:, 1])[:, np.newaxis]).T
        turn = np.arctan2(x * image[:, 1] - y * image[:, 0], x * image[:, 0] + y * image[:, 1])
        residual = np.column_stack([turn, image[:, 2] - z])
        count = np.minimum(self._frames[rows] + 1.0, _FRAMES)
        step = residual - self._mean[rows]
        share = 1.0 / count
        self._frames[rows] = count
        self._mean[rows] += share[:, np.newaxis] * step
        outer = step[:, :, np.newaxis] * step[:, np.newaxis, :]
        self._square[rows] += share[:, np.newaxis, np.newaxis] * (
            (1.0 - share)[:, np.newaxis, np.newaxis] * outer - self._square[rows]
        )

    def rows(self) -> Array | None:
        """Return means and covariances of the means as RolloutTask.residuals wants them, or None without any."""
        # Not in the cycle that brought them: roll-outs, which ask, are made in a thread of their own.
        while self._waiting:
            self._take(self._waiting.popleft())
        known = self._frames >= _MIN_FRAMES
        if not known.any():
            return None
        # What the spread of n values about their own mean is short of.
        frames = np.maximum(self._frames, _MIN_FRAMES)
        covariance = self._square * (frames / (frames - 1.0) / frames)[:, np.newaxis, np.newaxis]
        covariance += _MIN_DEVIATION**2 * np.eye(2)
        found = np.column_stack([self._mean, covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]])
        found[~known] = np.nan
        return found
