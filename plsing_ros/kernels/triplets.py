"""Camera rotations from three lines, for many triplets at once, and their translations: twins of triplets.c."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array

_SAMPLES = 9
# Below this, relative to what generic lines give, the polynomial or a cross product counts as zero.
_DEGENERATE = 1e-10
# Number by which the normal equations of the translation are made regular.
_LEAST = 1e-15
_ANGLES = 2.0 * np.pi * np.arange(_SAMPLES) / _SAMPLES


def _coefficients_from_samples() -> Array:
    """Return the (9, 9) matrix from samples q(2 pi m / 9) to coefficients, lowest first, of q (1 + t^2)^4.

    q is a trigonometric polynomial of degree 4 in theta = pi + 2 atan t, so that exp(i theta) = -(1 + it) / (1 - it),
    and t = infinity is the first sample.
    """
    total = np.zeros((_SAMPLES, _SAMPLES), dtype=complex)
    for j in range(-4, 5):
        power = np.array([1.0 + 0.0j])
        for _ in range(4 + j):
            power = np.convolve(power, [1.0, 1.0j])
        for _ in range(4 - j):
            power = np.convolve(power, [1.0, -1.0j])
        total += (-1.0) ** j * np.outer(power, np.exp(-1j * j * _ANGLES) / _SAMPLES)
    return total.real


# Cosines and sines of the angles where q is sampled, and the matrix from samples to coefficients, shape (11, 9).
SAMPLING: Array = np.vstack([np.cos(_ANGLES), np.sin(_ANGLES), _coefficients_from_samples()])
SAMPLING.setflags(write=False)

_ROLL = (np.arange(_SAMPLES) + np.arange(_SAMPLES)[:, np.newaxis]) % _SAMPLES
# A direction u, as the matrix that is multiplied, entry by entry, with one made of a normal n, so that the product
# times (1, cos beta, sin beta) has the coefficients of (cos alpha, sin alpha, 1) in n . (Rz(alpha) Rx(beta) u).
_OF_DIRECTION = np.array([[0, 1, 2], [0, 1, 2], [0, 2, 1]])
_OF_NORMAL = np.array([[0, 1, 1], [1, 0, 0], [2, 2, 2]])
_SIGN = np.array([[1, 1, -1], [1, -1, 1], [0, 1, 1]], dtype=float)
_IDENTITY = np.eye(3)


def triplet_rotations(
    frame: Array, others: Array, normals: Array, sampling: Array, rotation: Array, triplet: Array, degenerate: Array
) -> int:
    """Find all rotations R_camera_world with n_i . (R u_i) = 0 for three lines, of T triplets; return how many.

    With the first normal n_1 as the z axis and its direction u_1 as the x axis, R = Rz(alpha) Rx(beta). The two
    other equations are linear in (cos alpha, sin alpha, 1), which is therefore the cross product of their
    coefficients; that its first two components have the length of the third is a trigonometric polynomial of degree
    4 in beta, sampled, turned into a polynomial of degree 8 in t = tan of half an angle whose infinity is where it is
    largest, and solved by the eigenvalues of its companion matrix.

    Args:
        frame: Rotations that take the first directions to the x axis, shape (T, 3, 3).
        others: The other two directions in that frame, shape (T, 2, 3).
        normals: Unit normals of the lines' interpretation planes in the camera frame, shape (T, 3, 3).
        sampling: SAMPLING.
        rotation: Filled from the first on, one triplet after the other, shape (8 T, 3, 3); always rotations. A pair of
            complex solutions counts as one, its nearest real rotation, as noise turns the two solutions near a
            singularity of the triplet into such a pair.
        triplet: Filled alike, the triplet of each, shape (8 T,).
        degenerate: Filled, 1 where the polynomial vanishes and any rotation about an axis would do, else 0, shape (T,).

    Source: the eight solutions are those of Chen 1991 and of Xu, Zhang, Cheng, Koch 2017; the sampling is new,
    docs/pose.md section "Three lines".
    """
    count = np.arange(len(frame))
    image_frame = rotations_to_z(normals[:, 0])
    other = normals[:, 1:] @ image_frame.transpose(0, 2, 1)
    equations = other[..., _OF_NORMAL] * others[..., _OF_DIRECTION] * _SIGN
    first, second, third = _cross_columns(equations @ np.vstack([np.ones(_SAMPLES), sampling[:2]]))
    q = first * first + second * second - third * third
    size = np.abs(equations).max(axis=(2, 3)).prod(axis=1) ** 2
    start = np.abs(q).argmax(axis=1)
    none = ~(np.abs(q[count, start]) > _DEGENERATE * size)
    coefficients = q[count[:, np.newaxis], _ROLL[start]] @ sampling[2:].T
    companion = np.zeros((len(q), 8, 8))
    companion[:, 0] = coefficients[:, 7::-1] / -np.where(none, np.inf, coefficients[:, 8])[:, np.newaxis]
    companion[:, np.arange(1, 8), np.arange(7)] = 1.0
    root = np.linalg.eigvals(companion)
    beta = np.arctan2(2.0 * root.real, 1.0 - np.abs(root) ** 2) + (_ANGLES[start] + np.pi)[:, np.newaxis]
    basis = np.stack([np.ones_like(beta), np.cos(beta), np.sin(beta)], axis=1)
    first, second, third = _cross_columns(equations @ basis[:, np.newaxis])
    length = np.hypot(first, second)
    good = (root.imag >= 0.0) & (length * length > _DEGENERATE * size[:, np.newaxis]) & ~none[:, np.newaxis]
    scale = np.copysign(1.0 / np.where(good, length, 1.0), third)
    cosine, sine = np.where(good, first * scale, 1.0), np.where(good, second * scale, 0.0)
    # Rz(alpha) Rx(beta), one column after the other.
    middle = np.zeros((*beta.shape, 3, 3))
    middle[..., 0, 0], middle[..., 1, 0] = cosine, sine
    middle[..., 0, 1], middle[..., 1, 1], middle[..., 2, 1] = -sine * basis[:, 1], cosine * basis[:, 1], basis[:, 2]
    middle[..., 0, 2], middle[..., 1, 2], middle[..., 2, 2] = sine * basis[:, 2], -cosine * basis[:, 2], basis[:, 1]
    found = (image_frame.transpose(0, 2, 1)[:, np.newaxis] @ middle @ frame[:, np.newaxis])[good]
    rotation[: len(found)], triplet[: len(found)], degenerate[:] = found, np.nonzero(good)[0], none
    return len(found)


def translations(rotation: Array, normals: Array, points: Array, t: Array) -> None:
    """Fill the least-squares t of n_i . (R x_i + t) = 0 of n lines, for k rotations.

    Where the planes leave a direction of t open, its component along it is nearly zero, or t is zero
    where that is lost in rounding.

    Args:
        rotation: R_camera_world, shape (k, 3, 3).
        normals: Unit normals of the interpretation planes in the camera frame, shape (n, 3).
        points: A point x_i of each line in the world, shape (n, 3) [m].
        t: Filled, shape (k, 3) [m].
    """
    # n . R x as the product of the 9 entries of R with those of n x^T.
    products = (normals[:, :, np.newaxis] * points[:, np.newaxis]).reshape(-1, 9)
    try:
        to_t = -np.linalg.solve(normals.T @ normals + _LEAST * _IDENTITY, normals.T) @ products
    except np.linalg.LinAlgError:
        t[:] = 0.0
        return
    t[:] = rotation.reshape(-1, 9) @ to_t.T


def rotations_to_z(axis: Array) -> Array:
    """Return rotations, shape (k, 3, 3), that take unit vectors (k, 3) to the z axis."""
    sign = np.copysign(1.0, axis[:, 2])
    mirror = axis.copy()
    mirror[:, 2] += sign
    scale = (2.0 / np.einsum("ki,ki->k", mirror, mirror))[:, np.newaxis, np.newaxis]
    frames: Array = scale * (mirror[:, :, np.newaxis] * mirror[:, np.newaxis]) - _IDENTITY
    frames *= sign[:, np.newaxis, np.newaxis]
    frames[:, 1] *= sign[:, np.newaxis]
    return frames


def _cross_columns(vectors: Array) -> tuple[Array, Array, Array]:
    """Return the components of the cross products of the columns of (T, 2, 3, k), each of shape (T, k)."""
    a, b, c = vectors[:, 0, 0], vectors[:, 0, 1], vectors[:, 0, 2]
    x, y, z = vectors[:, 1, 0], vectors[:, 1, 1], vectors[:, 1, 2]
    return b * z - c * y, c * x - a * z, a * y - b * x
