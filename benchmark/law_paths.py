# SPDX-License-Identifier: Apache-2.0
"""The planned ways of many runs at once; the plans are the package's, following them is written anew."""

from __future__ import annotations

import numpy as np

from benchmark.batch_simulation import Batch
from benchmark.servo_tasks import in_camera, seen
from plsing_ros.geometry import Pose
from plsing_ros.planning.camera_path import CameraPath
from plsing_ros.planning.detour import DetourOptions, plan_path

# A camera farther from its path than this is given a new one [m].
_REPLAN_DISTANCE = 0.3


class Ways:
    """Ways followed by a batch, planned anew for a camera that is elsewhere."""

    def __init__(
        self, batch: Batch, R_target: np.ndarray, t_target: np.ndarray, target_u: np.ndarray, target_m: np.ndarray
    ) -> None:
        self._batch = batch
        # The lines as seen at the targets: a path ends where they are seen, also where they do not fit the map.
        self._u = target_u @ np.swapaxes(R_target, 1, 2)
        self._m = target_m @ np.swapaxes(R_target, 1, 2) + np.cross(t_target[:, np.newaxis], self._u)
        self._targets = [Pose(R, t) for R, t in zip(R_target, t_target, strict=True)]
        k = len(batch.t)
        self._paths: list[CameraPath | None] = [None] * k
        self._time, self._cycle = np.zeros(k), np.zeros(k)
        # Where the cameras should be.
        self._R, self._t = batch.R.copy(), batch.t.copy()
        self.plans = np.zeros(k)

    def advance(self, rows: np.ndarray, seconds: np.ndarray) -> None:
        self._time[rows] += seconds
        self._cycle[rows] = seconds

    def reference(self, rows: np.ndarray, R: np.ndarray, t: np.ndarray, image: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return target image lines, L, feed-forward, R and t; where a plan is refused, those of standing still.

        Args:
            rows: Of the batch.
            R, t: Where the cameras of those rows see themselves.
            image: Lines that they see, shape (k, m, 3).
        """
        batch = self._batch
        far = np.linalg.norm(t - self._t[rows], axis=1) > _REPLAN_DISTANCE
        if far.any():
            far &= self._misfit(rows, R, t, image) < self._misfit(rows, self._R[rows], self._t[rows], image)
        for i in np.flatnonzero(far | (self.plans[rows] == 0)):
            row = rows[i]
            plan = plan_path(batch.sets[row], Pose(R[i], t[i]), self._targets[row], DetourOptions())
            self._paths[row] = plan.path
            self._time[row] = self._cycle[row] = 0.0
            self._R[row], self._t[row] = R[i], t[i]
            self.plans[row] += 1
        twists = np.zeros((len(rows), 6))
        for i, row in enumerate(rows):
            path = self._paths[row]
            if path is not None:
                pose = path.pose(self._time[row])
                self._R[row], self._t[row] = pose.rotation, pose.translation
                twists[i] = path.twist(self._time[row] + 0.5 * self._cycle[row])
        asked_R, asked_t = self._R[rows], self._t[rows]
        return *self._seen(rows, asked_R, asked_t), twists, asked_R, asked_t

    def _seen(self, rows: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return seen(*in_camera(self._u[rows], self._m[rows], R, t), self._batch.weight[rows])

    def _misfit(self, rows: np.ndarray, R: np.ndarray, t: np.ndarray, image: np.ndarray) -> np.ndarray:
        apart = (image - self._seen(rows, R, t)[0]) * self._batch.weight[rows, :, np.newaxis]
        misfit: np.ndarray = np.linalg.norm(apart, axis=(1, 2))
        return misfit
