# SPDX-License-Identifier: Apache-2.0
"""First estimates of a camera pose: the solutions of all triplets of lines."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, IntArray, cross
from plsing_ros.errors import ParameterError
from plsing_ros.geometry import LineSet
from plsing_ros.pose.minimal_solver import TripletDirections, rotations_from_triplets, translations

_ROTATION = 1e-6  # how far from orthogonal a rotation of another library may be

# Rotations (k, 3, 3) and translations (k, 3) [m] of k candidates T_camera_world.
Candidates = tuple[Array, Array]


class SceneTriplets:
    """The triplets of some lines, prepared for image after image.

    Args:
        lines: At least three, in the world frame.
        most: How many triplets are used at most; the best conditioned ones that involve all lines alike.
        backend: "numpy" or "poselib".

    Raises:
        ParameterError: If the backend is not installed.
    """

    def __init__(self, lines: LineSet, most: int, backend: str = "numpy") -> None:
        self.lines = lines
        self.center: Array = lines.point.mean(axis=0)
        self._point: Array = lines.point - self.center
        self._prepared = TripletDirections.of(lines.direction, chosen_triplets(lines.direction, most))
        self._solve: Callable[[Array], tuple[Array, IntArray]] = self._rotations
        if backend == "poselib":
            self._p3ll = _poselib_solver()
            self._solve = self._poselib_rotations

    @property
    def rows(self) -> npt.NDArray[np.intp]:
        """The rows of each triplet's lines, shape (T, 3)."""
        return self._prepared.rows

    def candidates(self, image_lines: Array, all_lines: bool = True) -> Candidates:
        """Return the poses of all triplets; none if all triplets are degenerate.

        Args:
            image_lines: l' of the lines, shape (n, 3).
            all_lines: Whether the translation is the one that fits all lines best, or that of the triplet.
        """
        normals = image_lines / np.sqrt(np.einsum("ij,ij->i", image_lines, image_lines))[:, np.newaxis]
        rotation, triplet = self._solve(normals)
        if all_lines:
            t = translations(normals, rotation, self._point)
        else:
            of_triplets = (
                translations(normals[rows], rotation[triplet == i], self._point[rows])
                for i, rows in enumerate(self.rows)
            )
            t = np.concatenate(list(of_triplets))
        return rotation, t - rotation @ self.center

    def _rotations(self, normals: Array) -> tuple[Array, IntArray]:
        found = rotations_from_triplets(normals, self._prepared)
        return found.rotation, found.triplet

    def _poselib_rotations(self, normals: Array) -> tuple[Array, IntArray]:
        rotation, triplet = [], []
        for i, rows in enumerate(self.rows):
            for pose in self._p3ll(normals[rows], self._point[rows], self.lines.direction[rows]):
                # Degenerate triplets give poses that are not numbers.
                if np.isfinite(pose.R).all() and np.abs(pose.R @ pose.R.T - np.eye(3)).max() < _ROTATION:
                    rotation.append(pose.R)
                    triplet.append(i)
        return np.array(rotation).reshape(-1, 3, 3), np.array(triplet)


def chosen_triplets(directions: Array, most: int) -> npt.NDArray[np.intp]:
    """Return up to `most` triplets of n lines, shape (T, 3): those with the least parallel lines, all lines alike.

    Args:
        directions: Unit directions, shape (n, 3), n >= 3.
        most: At least 1.
    """
    rows = np.array(list(combinations(range(len(directions)), 3)), dtype=np.intp)
    if len(rows) <= most:
        return rows
    u = directions[rows]
    quality = np.linalg.norm(cross(u, u.take([1, 2, 0], axis=1)), axis=2).min(axis=1)
    used = np.zeros(len(directions))
    chosen = []
    for _ in range(most):
        best = int(np.argmax(quality / (1.0 + used[rows].sum(axis=1))))
        chosen.append(best)
        quality[best] = -1.0
        used[rows[best]] += 1.0
    selected: npt.NDArray[np.intp] = rows[np.sort(chosen)]
    return selected


def _poselib_solver() -> Callable[[Array, Array, Array], list[Any]]:
    try:
        poselib = importlib.import_module("poselib")
    except ImportError as error:
        raise ParameterError(
            f"parameter 'backend' is 'poselib', which is not installed ({error}); allowed here: numpy"
        ) from None
    solver: Callable[[Array, Array, Array], list[Any]] = poselib.p3ll
    return solver
