# SPDX-License-Identifier: Apache-2.0
"""A probability from one count after the other, and a size from one sample after the other: lately and now."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.planning.rollout import reached_size

# What is believed before anything is counted: as if half a sample had been counted, a fifth of it harmed.
_PRIOR_SAMPLES, _PRIOR_SHARE = 0.5, 0.2
# A count that is this many standard errors off what was believed begins anew.
_SURPRISE = 3.0
# Samples that count for less than this are forgotten.
_FORGOTTEN = 0.05


class Evidence:
    """Samples that come to harm, and all samples, with those of before forgotten by and by.

    A single answer of a few samples is coarse: its share jumps by a multiple of its standard error in a long run. The
    probability of harm itself changes seldom, and then by much: by what the camera sees on its way.

    Source: new, docs/concepts/risk.md.
    """

    def __init__(self) -> None:
        self._harmed = self._samples = 0.0

    def add(self, harmed: int, samples: int, kept: float) -> float:
        """Return the probability after one more count.

        Args:
            harmed: Samples that come to harm.
            samples: All of them, at least 1.
            kept: Share of what was counted before that is kept.
        """
        before = self._samples
        if before > 0.0:
            pooled = (self._harmed + harmed + 0.5) / (before + samples + 1.0)
            error = math.sqrt(pooled * (1.0 - pooled) * (1.0 / before + 1.0 / samples))
            if abs(harmed / samples - self._harmed / before) > _SURPRISE * error:
                kept = 0.0
        self._harmed = kept * self._harmed + harmed
        self._samples = kept * before + samples
        return (self._harmed + _PRIOR_SHARE * _PRIOR_SAMPLES) / (self._samples + _PRIOR_SAMPLES)


class Sizes:
    """Samples of a number, those of before forgotten by and by: how large it is, but for the largest of them."""

    def __init__(self) -> None:
        self._sizes: Array = np.zeros(0)
        self._weights: Array = np.zeros(0)

    def add(self, samples: Array, kept: float, share: float) -> float:
        """Return the size that this share of all samples reaches, after one more answer of them.

        Args:
            samples: Of the answer, shape (k,), k >= 1.
            kept: Weight of what came before, over the one that it had.
            share: Above 0, at most 1.
        """
        weights = kept * self._weights
        # They are in the order of their weights.
        first = int(weights.searchsorted(_FORGOTTEN))
        self._sizes = np.concatenate([self._sizes[first:], samples])
        self._weights = np.concatenate([weights[first:], np.ones(len(samples))])
        return reached_size(self._sizes, self._weights, share)
