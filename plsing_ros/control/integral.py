# SPDX-License-Identifier: Apache-2.0
"""The time integral of the error, kept from winding up."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array

_SECOND = 1_000_000_000
# After a longer gap between two observations the error in between is not known.
_LONGEST_GAP = 0.5  # [s]


class ErrorIntegral:
    """Integral of s - s* over the stamps of the observations, for one set of lines.

    It starts anew when the lines change or after a gap, stands still while the twist is held back (or it would wind
    up against the limits), and its norm is limited.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._ids: tuple[int, ...] = ()
        self._stamp = 0
        self._value: Array = np.zeros(0)

    def update(
        self, error: Array, ids: tuple[int, ...], stamp: int, gain: float, limit: float, held_back: bool
    ) -> Array:
        """Return gain times the integral with one more error, shape (3n,).

        Args:
            error: s - s*, shape (3n,).
            ids: Of the n lines.
            stamp: Of the observation [ns]; one that is not later adds nothing.
            gain: [1/s].
            limit: Largest norm of the result.
            held_back: Whether the latest twist was less than what the law asked for.
        """
        step = (stamp - self._stamp) / _SECOND
        if ids != self._ids or step > _LONGEST_GAP:
            self._ids, self._value, step = ids, np.zeros_like(error), 0.0
        self._stamp = stamp
        if step > 0.0 and not held_back:
            self._value = self._value + gain * step * error
        norm = float(np.linalg.norm(self._value))
        if norm > limit:
            self._value = self._value * (limit / norm)
        return self._value
