# SPDX-License-Identifier: Apache-2.0
"""The target that the plain law is heading for, found from the twists that it commands: a linear problem."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.features import Decomposition

# Singular values below this times the largest are directions of s* in which the twists say nothing.
_RANK = 1e-11
# A target is believed when it gives the next twist, which was not used to find it, to this relative accuracy.
_ACCURACY = 0.05


class TargetEstimator:
    """Finds s* and lambda from tau_k = -lambda pinv(L_k) (s_k - s*), without any knowledge of the target.

    With the columns U_k of what L_k can do, U_k^T L_k pinv(L_k) = U_k^T, so that each twist gives six equations that
    are linear in s* and 1 / lambda: U_k^T (s* - s_k) - (1 / lambda) U_k^T L_k tau_k = 0. The least correction of the
    latest s_k that solves them is taken: components of s* that no equation holds move the camera nowhere so far.

    Attributes:
        target_image: s* as rows, shape (n, 3), or None until it is found.

    Source: new, docs/monitor.md.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all twists: other lines, or another target."""
        self.target_image: Array | None = None
        self._rows: list[tuple[Array, Array]] = []
        self._wanted, self._pause = 0, 1
        self._cycle = 0

    def add(self, image: Array, factors: Decomposition, twist: Array) -> None:
        """Take what the camera saw, shape (n, 3), with L of that moment, and the twist it was commanded for it."""
        left, values, right = factors
        if self._wanted == 0:
            # As many equations as unknowns, and one twist more.
            self._wanted = math.ceil((image.size + 1) / 6) + 1
        if self.target_image is not None:
            return
        self._cycle += 1
        if len(self._rows) == self._wanted:
            self._solve(image, factors, twist)
            if self.target_image is not None:
                return
            # Farther apart: what the noise hides in neighbouring frames may show.
            self._rows, self._pause = self._rows[::2], 2 * self._pause
        if self._cycle % self._pause == 0:
            row = np.empty((6, image.size + 1))
            row[:, :-1], row[:, -1] = left.T, -values * (right @ twist)
            self._rows.append((row, image.ravel() @ left))

    def _solve(self, image: Array, factors: Decomposition, twist: Array) -> None:
        matrix = np.concatenate([row for row, _ in self._rows])
        right_side = np.concatenate([side for _, side in self._rows]) - matrix[:, :-1] @ image.ravel()
        solution = np.linalg.lstsq(matrix, right_side, rcond=_RANK)[0]
        inverse_gain = solution[image.size]
        if not inverse_gain > 0.0:
            return
        correction = solution[: image.size]
        foreseen = factors.solve(correction) / inverse_gain
        deviation = foreseen - twist
        if deviation @ deviation <= _ACCURACY**2 * (twist @ twist):
            self.target_image = image + correction.reshape(-1, 3)
