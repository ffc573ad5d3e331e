"""The planned ways of many runs at once; the plans are the package's, following them is written anew."""

from __future__ import annotations

import numpy as np

from benchmark.law_batch import Batch
from benchmark.servo_tasks import in_camera, seen
from plsing_ros.geometry import Pose
from plsing_ros.servoing.ways.camera_path import CameraPath
from plsing_ros.servoing.ways.detour import DetourOptions, plan_way

# A camera farther from its way than this is given a new one [m].
_REPLAN_DISTANCE = 0.3


class Ways:
    """Ways followed by a batch, planned anew for a camera that is elsewhere."""

    def __init__(self, batch: Batch, R_goal: np.ndarray, t_goal: np.ndarray) -> None:
        self._batch = batch
        self._goals = [Pose(R, t) for R, t in zip(R_goal, t_goal, strict=True)]
        k = len(batch.t)
        self._paths: list[CameraPath | None] = [None] * k
        self._time, self._cycle = np.zeros(k), np.zeros(k)
        # Nowhere near a camera, so that the first cycle plans.
        self._expected = np.full((k, 3), np.inf)
        self.plans = np.zeros(k)

    def advance(self, rows: np.ndarray, seconds: np.ndarray) -> None:
        self._time[rows] += seconds
        self._cycle[rows] = seconds

    def reference(self, rows: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return desired image lines, L, feed-forward, R and t; where a plan is refused, those of standing still.

        Args:
            rows: Of the batch.
            R, t: Where the cameras of those rows see themselves.
        """
        batch = self._batch
        for i in np.flatnonzero(np.linalg.norm(t - self._expected[rows], axis=1) > _REPLAN_DISTANCE):
            row = rows[i]
            plan = plan_way(batch.sets[row], Pose(R[i], t[i]), self._goals[row], DetourOptions())
            self._paths[row] = plan.path
            self._time[row] = self._cycle[row] = 0.0
            self._expected[row] = t[i]
            self.plans[row] += 1
        asked_R, asked_t, twists = R.copy(), t.copy(), np.zeros((len(rows), 6))
        for i, row in enumerate(rows):
            path = self._paths[row]
            if path is not None:
                pose = path.pose(self._time[row])
                asked_R[i], asked_t[i] = pose.rotation, pose.translation
                twists[i] = path.twist(self._time[row] + 0.5 * self._cycle[row])
                self._expected[row] = pose.translation
        u, m = in_camera(batch.map_direction[rows], batch.map_moment[rows], asked_R, asked_t)
        return *seen(u, m, batch.weight[rows]), twists, asked_R, asked_t
