# SPDX-License-Identifier: Apache-2.0
"""Camera poses from three lines: all triplets of a scene at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polymul, polypow
from scipy.spatial.transform import Rotation

from plsing_ros import _core
from plsing_ros.arrays import Array, BoolArray, checked_array, cross
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.geometry import LineSet, Pose

# Below this, relative to what generic lines give, the polynomial or a cross product counts as zero.
_DEGENERATE = 1e-10
# Largest |n . R u| of a rotation, and largest |n . (R x + t)| over the size of the scene, of a pose that is a solution.
_SOLVED = 1e-9
# Solutions that differ by less, as _core.same_pose has it, are the same.
_EQUAL = 1e-7


def _coefficients_from_samples() -> Array:
    """Return the matrix from samples q(2 pi m / 9) to coefficients, lowest first, of q (1 + t^2)^4, shape (9, 9).

    q is a trigonometric polynomial of degree 4 in theta = pi + 2 atan t, so that exp(i theta) = -(1 + it) / (1 - it);
    t = infinity is the first sample.
    """
    total = np.zeros((9, 9), dtype=complex)
    for j in range(-4, 5):
        power = polymul(polypow([1.0, 1.0j], 4 + j), polypow([1.0, -1.0j], 4 - j))
        total += np.outer(power, (-1.0) ** j * np.exp(-2.0j * np.pi * j * np.arange(9) / 9.0)) / 9.0
    return np.ascontiguousarray(total.real)


_INTERPOLATE = _coefficients_from_samples()


@dataclass(frozen=True, eq=False)
class TripletDirections:
    """What the rotation of a camera that sees three lines depends on, but the image: made once for a scene.

    Attributes:
        rows: Rows of the three lines in the scene, the pivot first, shape (T, 3).
        directions: Unit directions of its lines, shape (T, 3, 3).
        degenerate: Triplets whose directions fix no rotation, as all three are parallel, shape (T,).
    """

    rows: npt.NDArray[np.intp]
    directions: Array
    degenerate: BoolArray

    @classmethod
    def of(cls, directions: Array, rows: npt.NDArray[np.intp]) -> TripletDirections:
        """Prepare triplets.

        Args:
            directions: Unit directions of the scene's lines, shape (n, 3).
            rows: Which three lines, shape (T, 3).
        """
        u = directions[rows]
        across = np.linalg.norm(cross(u, u.take([1, 2, 0], axis=1)), axis=2)
        # The pivot is the line least parallel to the other two; the other two may even be parallel.
        pivot = np.argmax(np.minimum(across, across.take([2, 0, 1], axis=1)), axis=1)
        rows = np.take_along_axis(rows, (pivot[:, np.newaxis] + np.arange(3)) % 3, axis=1)
        return cls(rows, directions[rows], across.max(axis=1) < _DEGENERATE)


class TripletRotations(NamedTuple):
    """Rotations R_camera_world with n_i . (R u_i) = 0 for the three lines of a triplet, of several triplets.

    Attributes:
        rotation: Of one triplet after the other, shape (k, 3, 3); see _core.triplet_rotations.
        triplet: Row of the triplet each belongs to, shape (k,).
        degenerate: Triplets without finitely many solutions, shape (T,).
    """

    rotation: Array
    triplet: npt.NDArray[np.intp]
    degenerate: BoolArray


def rotations_from_triplets(image_normals: Array, triplets: TripletDirections) -> TripletRotations:
    """Return all rotations of the camera that put three directions into three planes, for each triplet.

    Args:
        image_normals: Unit normals of the lines' interpretation planes in the camera frame, shape (n, 3).
        triplets: Of the scene.

    Source: docs/pose.md section "Three lines", see _core.triplet_rotations; the paper uses RPnL (section "Pose
    Estimation along a quadrifolium trajectory").
    """
    return TripletRotations(*_core.triplet_rotations(triplets.directions, image_normals[triplets.rows], _INTERPOLATE))


def solve_three_lines(image_lines: npt.ArrayLike, lines: LineSet) -> list[Pose]:
    """Return every camera pose T_world_camera from which three lines have the given images; none for degenerate lines.

    The orientation of the images is not used: a solution may see a line reversed.

    Args:
        image_lines: Image lines of any length, or normals of the interpretation planes, in the camera frame, shape
            (3, 3).
        lines: Three lines in the world frame.

    Raises:
        GeometryError: If there are not three lines, or their geometry leaves a continuum of poses: directions all
            parallel, lines concurrent, or image lines concurrent (the camera is on a transversal of the three).
        ObservationError: If an image line is zero or not finite.

    Source: docs/pose.md.
    """
    normals = checked_array("image_lines", image_lines, (3, 3), ObservationError)
    if len(lines) != 3:
        raise GeometryError(f"{len(lines)} lines given; the minimal solver needs three")
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    if (length == 0.0).any():
        raise ObservationError(f"image line {int(np.argmin(length))} is zero; it must have a normal")
    normals = normals / length
    triplets = TripletDirections.of(lines.direction, np.array([[0, 1, 2]]))
    found = rotations_from_triplets(normals, triplets)
    if triplets.degenerate[0] or found.degenerate[0]:
        raise GeometryError("the directions of the three lines and their images leave a continuum of rotations")
    if abs(np.linalg.det(normals)) < _DEGENERATE:
        raise GeometryError(
            "the three image lines meet in one point: the lines are concurrent, or the camera is on a line that meets "
            "them all, and the translation towards it is not determined"
        )
    rotation = _polished(found.rotation, normals, lines.direction)
    center = lines.point.mean(axis=0)
    point = lines.point - center
    residual = np.abs(np.einsum("ij,kij->ki", normals, lines.direction @ rotation.transpose(0, 2, 1))).max(axis=1)
    translation = translations(normals, rotation, point)
    poses: list[tuple[Array, Array]] = []
    for i in np.flatnonzero(residual <= _SOLVED):
        R, t = rotation[i], translation[i]
        pose = R.T.copy(), center - R.T @ t
        if not any(_core.same_pose(*pose, *other, _EQUAL) for other in poses):
            poses.append(pose)
    return [Pose(*pose) for pose in poses]


def translations(image_normals: Array, rotation: Array, points: Array) -> Array:
    """Return the least-squares t of n_i . (R x_i + t) = 0 of n lines for k rotations, shape (k, 3) [m].

    Args:
        image_normals: Shape (n, 3), unit.
        rotation: R_camera_world, shape (k, 3, 3).
        points: A point x_i of each line, shape (n, 3) [m].
    """
    return _core.translations(rotation, image_normals, points)


def _polished(rotation: Array, normals: Array, directions: Array) -> Array:
    """Return rotations (k, 3, 3) after Newton steps on n_i . (R u_i) = 0, shortest steps where those are singular."""
    if len(rotation) == 0:
        return rotation
    for _ in range(4):
        turned = directions @ rotation.transpose(0, 2, 1)
        value = np.einsum("ij,kij->ki", normals, turned)
        slope = cross(turned, np.broadcast_to(normals, turned.shape))
        step = -np.einsum("kij,kj->ki", np.linalg.pinv(slope, rcond=1e-12), value)
        size = np.linalg.norm(step, axis=1, keepdims=True)
        turn = step * np.minimum(1.0, 0.3 / np.maximum(size, 0.3))
        rotation = Rotation.from_rotvec(turn).as_matrix() @ rotation
    return rotation
