# SPDX-License-Identifier: Apache-2.0
"""Poses of a moving camera by the corners of tags in all images at once, with the time at which each row was read.

A hand-held camera with a rolling shutter moves while it reads an image: a board is stretched, and the pose that fits
it best is off by degrees. How long reading takes is found from the corners, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix
from scipy.spatial.transform import Rotation

from plsing_ros._core import compiled
from plsing_ros.geometry import Pose
from plsing_ros.tracking import PinholeCamera

_TOLERANCE = 0.3  # of a corner [px]; what is farther off counts less


@dataclass(frozen=True, eq=False)
class BoardPoses:
    """What the corners say.

    Attributes:
        readout: From the first row to the last one, as a share of the time between images.
        deviation: Of the corners from where they should be, the median [px].
    """

    readout: float
    deviation: float
    _rotations: Rotation
    _positions: np.ndarray
    _height: int
    _covariance: np.ndarray  # of small turns of all images, and of shifts of all

    def at(self, image: int, row: float) -> Pose:
        """Return T_camera_board when a row of an image was read."""
        which = np.array([image])
        since = np.array([self.readout * (row / self._height - 0.5)])
        turned, position = _moved(self._rotations, self._positions, which, since)
        return Pose(turned.as_matrix()[0], position[0])

    def covariance_at(self, image: int, row: float) -> np.ndarray:
        """Return the covariance of a motion (v, omega) of the board in the camera frame, by the corners' scatter."""
        n, before = len(self._positions), self.at(image, row)
        near = range(max(image - 1, 0), min(image + 2, n))
        columns = [3 * (block * n + k) + i for block in (0, 1) for k in near for i in range(3)]
        by_unknowns = np.zeros((6, len(columns)))
        for place, column in enumerate(columns):
            step = np.zeros(6 * n)
            step[column] = 1e-6
            turns = Rotation.from_rotvec(step[: 3 * n].reshape(n, 3)) * self._rotations
            moved = replace(self, _rotations=turns, _positions=self._positions + step[3 * n :].reshape(n, 3))
            after = moved.at(image, row)
            motion = compiled.motion_between(before, after)
            by_unknowns[:, place] = motion / 1e-6
        covariance: np.ndarray = by_unknowns @ self._covariance[np.ix_(columns, columns)] @ by_unknowns.T
        return covariance


def board_poses(
    camera: PinholeCamera, corners: Sequence[Mapping[str, np.ndarray]], starts: Sequence[Pose], rolling: bool = True
) -> BoardPoses:
    """Return the poses that fit the corners best; those of the board are found as well.

    Args:
        camera: Without distortion.
        corners: Of each tag in each image, shape (4, 2) [px].
        starts: T_camera_board, nearly.
        rolling: False for all rows read at once.
    """
    names = sorted({name for each in corners for name in each})
    n, m = len(corners), 4 * len(names)
    image = np.repeat([k for k, each in enumerate(corners) for _ in each], 4)
    point = np.concatenate([4 * names.index(name) + np.arange(4) for each in corners for name in each])
    pixels = np.concatenate([each[name] for each in corners for name in each])
    turns = Rotation.from_matrix([pose.rotation for pose in starts])
    places = np.array([pose.translation for pose in starts])
    rays = np.column_stack([camera.normalised(pixels), np.ones(len(pixels))])
    board = np.array(
        [_meeting_point(turns[image[point == i]], places[image[point == i]], rays[point == i]) for i in range(m)]
    )
    since = pixels[:, 1] / camera.height - 0.5

    def unpacked(x: np.ndarray) -> tuple[Rotation, np.ndarray, np.ndarray]:
        return (
            Rotation.from_rotvec(x[: 3 * n].reshape(n, 3)) * turns,
            places + x[3 * n : 6 * n].reshape(n, 3),
            board + x[6 * n : -1].reshape(m, 3),
        )

    def residuals(x: np.ndarray) -> np.ndarray:
        rotations, positions, points = unpacked(x)
        turned, position = _moved(rotations, positions, image, x[-1] * since if rolling else 0.0 * since)
        return (camera.project(turned.apply(points[point]) + position) - pixels).ravel()

    pattern = lil_matrix((2 * len(pixels), 6 * n + 3 * m + 1), dtype=int)
    for row, (k, i) in enumerate(zip(image, point, strict=True)):
        rows = slice(2 * row, 2 * row + 2)
        for j in range(max(k - 1, 0), min(k + 2, n)):
            pattern[rows, 3 * j : 3 * j + 3] = pattern[rows, 3 * (n + j) : 3 * (n + j) + 3] = 1
        pattern[rows, 6 * n + 3 * i : 6 * n + 3 * i + 3] = pattern[rows, -1] = 1
    x = np.zeros(6 * n + 3 * m + 1)
    x[-1] = 0.5 if rolling else 0.0
    found = least_squares(
        residuals, x, jac_sparsity=pattern, loss="soft_l1", f_scale=_TOLERANCE, x_scale="jac", max_nfev=20
    )
    rotations, positions, _ = unpacked(found.x)
    off = np.linalg.norm(residuals(found.x).reshape(-1, 2), axis=1)
    # Of the corners on the board all images decide: next to the error of one image, theirs is small.
    matrix = found.jac[:, : 6 * n].toarray()
    spread = 1.4826 * float(np.median(np.abs(residuals(found.x))))
    covariance = spread**2 * np.linalg.inv(matrix.T @ matrix)
    return BoardPoses(float(found.x[-1]), float(np.median(off)), rotations, positions, camera.height, covariance)


def _moved(
    rotations: Rotation, positions: np.ndarray, image: np.ndarray, since: np.ndarray
) -> tuple[Rotation, np.ndarray]:
    """Return the poses at a time since the middle row of an image, as its neighbours have the camera move."""
    last = len(positions) - 1
    before, after = np.maximum(image - 1, 0), np.minimum(image + 1, last)
    share = (since / (after - before))[:, np.newaxis]
    turn = (rotations[after] * rotations[before].inv()).as_rotvec()
    return Rotation.from_rotvec(share * turn) * rotations[image], positions[image] + share * (
        positions[after] - positions[before]
    )


def _meeting_point(turns: Rotation, places: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Return the point whose images are rays, shape (3,), by linear least squares."""
    matrices = turns.as_matrix()
    rows = matrices[:, :2] - rays[:, :2, np.newaxis] * matrices[:, 2:]
    right = rays[:, :2] * places[:, 2:] - places[:, :2]
    return np.linalg.lstsq(rows.reshape(-1, 3), right.ravel(), rcond=None)[0]
