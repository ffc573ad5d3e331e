"""Camera poses from three lines: all triplets of a scene at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, BoolArray, checked_array, cross
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.pose.rotations import rotations_near

_SAMPLES = 9
# Below this, relative to what generic lines give, the polynomial or a cross product counts as zero.
_DEGENERATE = 1e-10
# Largest |n . R u| of a rotation, and largest |n . (R x + t)| over the size of the scene, of a pose that is a solution.
_SOLVED = 1e-9
# Number by which the normal equations of the translation are made regular.
_LEAST = 1e-15


def _coefficients_from_samples() -> Array:
    """Return the (9, 9) matrix from samples q(2 pi m / 9) to coefficients, lowest first, of q (1 + t^2)^4.

    q is a trigonometric polynomial of degree 4 in theta = pi + 2 atan t, so that exp(i theta) = -(1 + it) / (1 - it),
    and t = infinity is the first sample.
    """
    angle = 2.0 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    total = np.zeros((_SAMPLES, _SAMPLES), dtype=complex)
    for j in range(-4, 5):
        power = np.array([1.0 + 0.0j])
        for _ in range(4 + j):
            power = np.convolve(power, [1.0, 1.0j])
        for _ in range(4 - j):
            power = np.convolve(power, [1.0, -1.0j])
        total += (-1.0) ** j * np.outer(power, np.exp(-1j * j * angle) / _SAMPLES)
    return total.real


_TO_COEFFICIENTS = _coefficients_from_samples()
_ROLL = (np.arange(_SAMPLES) + np.arange(_SAMPLES)[:, np.newaxis]) % _SAMPLES
_ANGLES = 2.0 * np.pi * np.arange(_SAMPLES) / _SAMPLES
# (1, cos beta, sin beta) at the samples.
_BASIS = np.stack([np.ones(_SAMPLES), np.cos(_ANGLES), np.sin(_ANGLES)])
# A direction u, as the matrix that is multiplied, entry by entry, with one made of a normal n, so that the product
# times (1, cos beta, sin beta) has the coefficients of (cos alpha, sin alpha, 1) in n . (Rz(alpha) Rx(beta) u).
_OF_DIRECTION = np.array([[0, 1, 2], [0, 1, 2], [0, 2, 1]])
_OF_NORMAL = np.array([[0, 1, 1], [1, 0, 0], [2, 2, 2]])
_SIGN = np.array([[1, 1, -1], [1, -1, 1], [0, 1, 1]], dtype=float)
_IDENTITY = np.eye(3)


@dataclass(frozen=True, eq=False)
class TripletDirections:
    """What the rotation of a camera that sees three lines depends on, but the image: made once for a scene.

    Attributes:
        rows: Rows of the three lines in the scene, the pivot first, shape (T, 3).
        frame: Rotation that takes the pivot's direction to the x axis, shape (T, 3, 3).
        others: Directions of the other two in that frame, arranged as _OF_DIRECTION, shape (T, 2, 3, 3).
        degenerate: Triplets whose directions fix no rotation, as all three are parallel, shape (T,).
    """

    rows: npt.NDArray[np.intp]
    frame: Array
    others: Array
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
        u = directions[rows]
        frame = _frames(u[:, 0])[:, [2, 0, 1]]
        others = (u[:, 1:] @ frame.transpose(0, 2, 1))[..., _OF_DIRECTION] * _SIGN
        return cls(rows, frame, others, across.max(axis=1) < _DEGENERATE)


@dataclass(frozen=True, eq=False)
class TripletRotations:
    """Rotations R_camera_world with n_i . (R u_i) = 0 for the three lines of each triplet.

    Attributes:
        rotation: Shape (T, 8, 3, 3); always rotations.
        valid: Which of them are solutions, shape (T, 8). A pair of complex solutions counts as one, its nearest real
            rotation, as noise turns the two solutions near a singularity of the triplet into such a pair.
        degenerate: Triplets without finitely many solutions, shape (T,).
    """

    rotation: Array
    valid: BoolArray
    degenerate: BoolArray


def rotations_from_triplets(image_normals: Array, triplets: TripletDirections) -> TripletRotations:
    """Return all rotations of the camera that put three directions into three planes, for each triplet.

    With the pivot's normal n_1 as the z axis and its direction u_1 as the x axis, R = Rz(alpha) Rx(beta). The two
    other equations are linear in (cos alpha, sin alpha, 1), which is therefore the cross product of their
    coefficients; that its first two components have the length of the third is a trigonometric polynomial of degree
    4 in beta, sampled, turned into a polynomial of degree 8 in t = tan of half an angle whose infinity is where it is
    largest, and solved by the eigenvalues of its companion matrix.

    Args:
        image_normals: Unit normals of the lines' interpretation planes in the camera frame, shape (n, 3).
        triplets: Of the scene.

    Source: the eight solutions are those of Chen 1991 and of Xu, Zhang, Cheng, Koch 2017; the sampling is new
    (docs/pose.md).
    """
    count = np.arange(len(triplets.rows))
    frame = _frames(image_normals)[triplets.rows[:, 0]]
    other = image_normals[triplets.rows[:, 1:]] @ frame.transpose(0, 2, 1)
    equations = other[..., _OF_NORMAL] * triplets.others
    first, second, third = _cross_columns(equations @ _BASIS)
    q = first * first + second * second - third * third
    size = np.abs(equations).max(axis=(2, 3)).prod(axis=1) ** 2
    start = np.abs(q).argmax(axis=1)
    degenerate = triplets.degenerate | (np.abs(q[count, start]) <= _DEGENERATE * size)
    coefficients = q[count[:, np.newaxis], _ROLL[start]] @ _TO_COEFFICIENTS.T
    lead = np.where(degenerate, np.inf, coefficients[:, 8])
    companion = np.zeros((len(q), 8, 8))
    companion[:, 0] = coefficients[:, 7::-1] / -lead[:, np.newaxis]
    companion[:, np.arange(1, 8), np.arange(7)] = 1.0
    root = np.linalg.eigvals(companion)
    beta = np.arctan2(2.0 * root.real, 1.0 - np.abs(root) ** 2) + (_ANGLES[start] + np.pi)[:, np.newaxis]
    basis = np.stack([np.ones_like(beta), np.cos(beta), np.sin(beta)], axis=1)
    first, second, third = _cross_columns(equations @ basis[:, np.newaxis])
    length = np.hypot(first, second)
    valid = (root.imag >= 0.0) & (length * length > _DEGENERATE * size[:, np.newaxis])
    valid[degenerate] = False
    scale = np.copysign(1.0 / np.where(valid, length, 1.0), third)
    cosine, sine = np.where(valid, first * scale, 1.0), np.where(valid, second * scale, 0.0)
    # Rz(alpha) Rx(beta), one column after the other.
    middle = np.zeros((*beta.shape, 3, 3))
    middle[..., 0, 0], middle[..., 1, 0] = cosine, sine
    middle[..., 0, 1], middle[..., 1, 1], middle[..., 2, 1] = -sine * basis[:, 1], cosine * basis[:, 1], basis[:, 2]
    middle[..., 0, 2], middle[..., 1, 2], middle[..., 2, 2] = sine * basis[:, 2], -cosine * basis[:, 2], basis[:, 1]
    rotation = frame.transpose(0, 2, 1)[:, np.newaxis] @ middle @ triplets.frame[:, np.newaxis]
    return TripletRotations(rotation, valid, degenerate)


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
    if found.degenerate[0]:
        raise GeometryError("the directions of the three lines and their images leave a continuum of rotations")
    if abs(np.linalg.det(normals)) < _DEGENERATE:
        raise GeometryError(
            "the three image lines meet in one point: the lines are concurrent, or the camera is on a line that meets "
            "them all, and the translation towards it is not determined"
        )
    rotation = _polished(found.rotation[found.valid], normals, lines.direction)
    center = lines.point.mean(axis=0)
    point = lines.point - center
    residual = np.abs(np.einsum("ij,kij->ki", normals, lines.direction @ rotation.transpose(0, 2, 1))).max(axis=1)
    translation = translations(normals, rotation, point)
    poses: list[Pose] = []
    for i in np.flatnonzero(residual <= _SOLVED):
        R, t = rotation[i], translation[i]
        pose = Pose(R.T, center - R.T @ t)
        if not any(_same(pose, other) for other in poses):
            poses.append(pose)
    return poses


def translations(image_normals: Array, rotation: Array, points: Array) -> Array:
    """Return the least-squares t of n_i . (R x_i + t) = 0 for many rotations, shape (..., k, 3) [m].

    Where the planes leave a direction of t open, its component along it is nearly zero.

    Args:
        image_normals: Shape (..., n, 3), unit.
        rotation: R_camera_world, shape (..., k, 3, 3).
        points: A point x_i of each line, shape (..., n, 3) [m].
    """
    # n . R x as the product of the 9 entries of R with those of n x^T.
    products = (image_normals[..., np.newaxis] * points[..., np.newaxis, :]).reshape(*points.shape[:-1], 9)
    transposed = np.swapaxes(image_normals, -1, -2)
    normal = transposed @ image_normals + _LEAST * _IDENTITY
    to_t = -np.linalg.solve(normal, transposed) @ products
    t: Array = rotation.reshape(*rotation.shape[:-2], 9) @ np.swapaxes(to_t, -1, -2)
    return t


def _cross_columns(vectors: Array) -> tuple[Array, Array, Array]:
    """Return the components of the cross products of the columns of (T, 2, 3, k), each of shape (T, k)."""
    a, b, c = vectors[:, 0, 0], vectors[:, 0, 1], vectors[:, 0, 2]
    x, y, z = vectors[:, 1, 0], vectors[:, 1, 1], vectors[:, 1, 2]
    return b * z - c * y, c * x - a * z, a * y - b * x


def _frames(axis: Array) -> Array:
    """Return rotations, shape (k, 3, 3), that take unit vectors (k, 3) to the z axis."""
    sign = np.copysign(1.0, axis[:, 2])
    mirror = axis.copy()
    mirror[:, 2] += sign
    scale = (2.0 / np.einsum("ki,ki->k", mirror, mirror))[:, np.newaxis, np.newaxis]
    frames: Array = scale * (mirror[:, :, np.newaxis] * mirror[:, np.newaxis]) - _IDENTITY
    frames *= sign[:, np.newaxis, np.newaxis]
    frames[:, 1] *= sign[:, np.newaxis]
    return frames


def _polished(rotation: Array, normals: Array, directions: Array) -> Array:
    """Return rotations (k, 3, 3) after Newton steps on n_i . (R u_i) = 0, shortest steps where those are singular."""
    for _ in range(4):
        turned = directions @ rotation.transpose(0, 2, 1)
        value = np.einsum("ij,kij->ki", normals, turned)
        slope = cross(turned, np.broadcast_to(normals, turned.shape))
        step = -np.einsum("kij,kj->ki", np.linalg.pinv(slope, rcond=1e-12), value)
        size = np.linalg.norm(step, axis=1, keepdims=True)
        rotation = rotations_near(step * np.minimum(1.0, 0.3 / np.maximum(size, 0.3))) @ rotation
    return rotation


def _same(first: Pose, second: Pose) -> bool:
    far = np.abs(first.translation - second.translation).max()
    return bool(
        np.abs(first.rotation - second.rotation).max() < 1e-7 and far < 1e-7 * (1 + np.abs(first.translation).max())
    )
