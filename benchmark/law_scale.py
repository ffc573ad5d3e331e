# SPDX-License-Identifier: Apache-2.0
"""The common scale of 3-D lines that many cameras see: an implementation of its own, from docs/laws.md."""

from __future__ import annotations

import numpy as np

from benchmark.batch_simulation import Batch


class Scales:
    """Estimates of a batch, from all that its cameras saw so far."""

    def __init__(self, batch: Batch, max_error: float) -> None:
        self._weight = batch.weight
        self._max_error = max_error
        self._map = _about_nearest_points(batch.weight, batch.map_direction, batch.map_moment)
        self._size = np.maximum(np.einsum("kni,kni->k", self._map, self._map), 1e-300)
        self._seen = np.zeros_like(self._map)
        self._frames = np.zeros(len(batch.t))

    def factors(self, rows: np.ndarray, R: np.ndarray, u: np.ndarray, m: np.ndarray) -> np.ndarray:
        """Return the factors on moments, shape (k, 1, 1), which are 1 unless all that was seen speaks against it.

        Args:
            rows: Of the batch.
            R: Of T_world_camera, shape (k, 3, 3).
            u, m: Lines that are seen, shapes (k, n, 3).
        """
        weight, size, expected = self._weight[rows], self._size[rows], self._map[rows]
        self._frames[rows] += 1.0
        seen = _about_nearest_points(weight, u, m) @ np.swapaxes(R, 1, 2)
        self._seen[rows] += (seen - self._seen[rows]) / self._frames[rows, np.newaxis, np.newaxis]
        mean = self._seen[rows]
        error = np.einsum("kni,kni->k", expected, mean) / size - 1.0
        rest = np.square(mean - (1.0 + error)[:, np.newaxis, np.newaxis] * expected).sum(axis=(1, 2))
        variance = (rest / (2.0 * weight.sum(axis=1) - 4.0) + 1e-12) / size
        share = np.maximum(0.0, 1.0 - 9.0 * variance / np.maximum(error**2, 1e-300))
        bounded: np.ndarray = 1.0 + np.clip(share * error, -self._max_error, self._max_error)
        return bounded[:, np.newaxis, np.newaxis]


def _about_nearest_points(weight: np.ndarray, u: np.ndarray, m: np.ndarray) -> np.ndarray:
    outer = np.einsum("kn,kni,knj->kij", weight, u, u)
    across = weight.sum(axis=1)[:, np.newaxis, np.newaxis] * np.eye(3) - outer
    pull = np.einsum("kn,kni->ki", weight, np.cross(u, m))
    point = np.linalg.solve(across, pull[..., np.newaxis])[..., 0]
    about: np.ndarray = (m - np.cross(point[:, np.newaxis], u)) * weight[..., np.newaxis]
    return about
