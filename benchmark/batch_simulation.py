# SPDX-License-Identifier: Apache-2.0
"""Many servo tasks as arrays, with what their controllers know and with what is true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.constant_errors import TaskErrors
from benchmark.servo_tasks import Task
from plsing_ros.planning.detour import DetourOptions
from plsing_ros.singularities import SingularSet

_FAR = 1e6  # [m]


@dataclass(frozen=True, eq=False)
class DisturbedTask:
    """A task, its constant errors, and the singular sets of its lines: as the controller knows them, and the true."""

    task: Task
    errors: TaskErrors
    known: SingularSet
    true: SingularSet


@dataclass(eq=False)
class Batch:
    """Tasks as arrays: k tasks, room for m lines each; scenes are filled up with lines of weight zero.

    Attributes:
        direction, moment: Of the true lines in the scene frame, shape (k, m, 3).
        weight: 1 for lines, 0 for room left, shape (k, m).
        map_direction, map_moment: Of the lines as the controllers know them.
        R, t: Of T_world_camera at the start, shapes (k, 3, 3) and (k, 3).
        R_target, t_target: At the target, likewise.
        R_told, t_told: Of T_told_camera, from the cameras to the frames that twists are for.
        speed, depth: Factors on twists and on moments that are seen, shape (k,).
        known_loci: Points and directions of transversals and points (direction zero) of the lines as the controllers
            know them, shapes (k, p, 3); far away where fewer.
        true_loci: Of the true lines, with these themselves.
        sets: Singular sets of the lines as the controllers know them, for planning.
        taught: Whether the targets are given by what is seen there, and not as poses.
    """

    direction: np.ndarray
    moment: np.ndarray
    weight: np.ndarray
    map_direction: np.ndarray
    map_moment: np.ndarray
    R: np.ndarray
    t: np.ndarray
    R_target: np.ndarray
    t_target: np.ndarray
    R_told: np.ndarray
    t_told: np.ndarray
    speed: np.ndarray
    depth: np.ndarray
    known_loci: tuple[np.ndarray, np.ndarray]
    true_loci: tuple[np.ndarray, np.ndarray]
    sets: tuple[SingularSet, ...]
    taught: bool

    @classmethod
    def of(cls, cases: Sequence[DisturbedTask], taught: bool = False) -> Batch:
        """Collect tasks."""
        k, m = len(cases), max(len(case.task.lines) for case in cases)
        weight = np.zeros((k, m))
        direction, moment, map_direction, map_moment = np.zeros((4, k, m, 3))
        for unit, arm in ((direction, moment), (map_direction, map_moment)):
            unit[:, :, 0], arm[:, :, 1] = 1.0, 1.0
        for i, case in enumerate(cases):
            lines, known = case.task.lines, case.errors.map
            n = len(lines)
            direction[i, :n], moment[i, :n], weight[i, :n] = lines.direction, lines.moment, 1.0
            map_direction[i, :n], map_moment[i, :n] = known.direction, known.moment
        poses = [
            np.array([getattr(pose, what) for pose in each])
            for each in (
                [case.task.start for case in cases],
                [case.task.target for case in cases],
                [case.errors.T_told_camera for case in cases],
            )
            for what in ("rotation", "translation")
        ]
        factors = (np.array([getattr(case.errors, what) for case in cases]) for what in ("speed", "depth"))
        # The lines themselves are the last.
        known_loci = _padded(
            [tuple(each[: -len(case.known.lines)] for each in case.known.lines_and_points) for case in cases]
        )
        true_loci = _padded([case.true.lines_and_points for case in cases])
        sets = tuple(case.known for case in cases)
        lines_known = direction, moment, weight, map_direction, map_moment
        return cls(*lines_known, *poses, *factors, known_loci, true_loci, sets, taught)

    def kept(self, t: np.ndarray) -> np.ndarray:
        """Return the least distance of centres to true loci, over what a path is to keep there, shape (k,)."""
        start, target = _distances(self.true_loci, self.t), _distances(self.true_loci, self.t_target)
        gone, left = (np.linalg.norm(t - end, axis=1)[:, np.newaxis] for end in (self.t, self.t_target))
        asked = np.minimum(np.minimum(0.9 * start + 0.5 * gone, 0.9 * target + 0.5 * left), DetourOptions().margin)
        return (_distances(self.true_loci, t) / asked).min(axis=1)


def _distances(loci: tuple[np.ndarray, np.ndarray], t: np.ndarray) -> np.ndarray:
    point, direction = loci
    offset = point - t[:, np.newaxis]
    along = np.einsum("kpi,kpi->kp", offset, direction)[..., np.newaxis]
    return np.linalg.norm(offset - along * direction, axis=2)


def _padded(loci: Sequence[tuple[np.ndarray, ...]]) -> tuple[np.ndarray, np.ndarray]:
    p = max(1, *(len(points) for points, _ in loci))
    point, direction = np.full((len(loci), p, 3), _FAR), np.zeros((len(loci), p, 3))
    for i, (points, directions) in enumerate(loci):
        point[i, : len(points)], direction[i, : len(points)] = points, directions
    return point, direction
