# SPDX-License-Identifier: Apache-2.0
"""Rotations by plain arithmetic against SciPy's."""

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from scipy.integrate import quad_vec
from scipy.spatial.transform import Rotation
from strategies import vectors

from plsing_ros.geometry.rotations import (
    exponential,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_vector,
)

HALF_TURNS = [np.pi * np.array(axis) for axis in ([1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [0.6, 0, -0.8])]


@given(vector=vectors())
def test_quaternion_and_matrix_are_those_of_scipy(vector):
    rotation = Rotation.from_rotvec(vector)
    np.testing.assert_allclose(rotation_from_quaternion(rotation.as_quat()), rotation.as_matrix(), atol=1e-15)
    quaternion = quaternion_from_rotation(rotation.as_matrix())
    assert abs(quaternion @ rotation.as_quat()) == pytest.approx(1.0, abs=1e-15)


@given(vector=vectors())
@example(vector=np.zeros(3))
@example(vector=np.array([0.0, 1e-12, 0.0]))
@example(vector=np.array([0.0, 0.0, 4.0]))
def test_rotation_vector_is_that_of_scipy(vector):
    rotation = Rotation.from_rotvec(vector)
    expected = rotation.as_rotvec()
    found = rotation_vector(rotation.as_matrix())
    assert np.linalg.norm(found) <= np.pi + 1e-15
    np.testing.assert_allclose(Rotation.from_rotvec(found).as_matrix(), rotation.as_matrix(), atol=1e-14)
    if np.linalg.norm(expected) < 3.14:
        np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("vector", HALF_TURNS, ids=str)
def test_half_turns_have_a_quaternion(vector):
    rotation = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(rotation_from_quaternion(quaternion_from_rotation(rotation)), rotation, atol=1e-15)


def test_the_length_of_a_quaternion_does_not_matter():
    quaternion = np.array([0.1, -0.2, 0.3, 0.9])
    np.testing.assert_allclose(rotation_from_quaternion(7.0 * quaternion), rotation_from_quaternion(quaternion))


@given(vector=vectors())
@example(vector=np.zeros(3))
@example(vector=np.array([0.99e-4, 0.0, 0.0]))
@example(vector=np.array([0.0, 1.01e-4, 0.0]))
def test_exponential_is_that_of_scipy_and_its_mean_the_integral(vector):
    turn, mean_turn = exponential(vector)
    np.testing.assert_allclose(turn, Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)
    integral, _ = quad_vec(lambda share: Rotation.from_rotvec(share * vector).as_matrix(), 0.0, 1.0)
    np.testing.assert_allclose(mean_turn, integral, atol=1e-7)


@pytest.mark.parametrize("angle", [1e-6, 0.9e-4, 1.1e-4, 1e-3, 0.1, 3.0])
def test_small_and_large_angles_are_as_exact(angle):
    x, y, z = 0.48 * angle, -0.6 * angle, 0.64 * angle
    turn, mean_turn = exponential(np.array([x, y, z]))
    with mpmath.workdps(50):
        skew = mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        powers = [mpmath.eye(3)]
        for k in range(1, 40):
            powers.append(powers[-1] * skew / k)
        exact = sum(powers[1:], powers[0]), sum((p / (k + 1) for k, p in enumerate(powers[1:], 1)), powers[0])
        expected = [np.array(each.tolist(), dtype=float) for each in exact]
    np.testing.assert_allclose([turn, mean_turn], expected, rtol=0.0, atol=1e-15)
