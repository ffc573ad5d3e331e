# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from strategies import numbers, poses, twists, vectors

from plsing_ros.errors import GeometryError
from plsing_ros.geometry import Pose


def matrix(pose):
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = pose.rotation, pose.translation
    return result


def twist_matrix(twist):
    result = np.zeros((4, 4))
    result[:3, :3] = np.cross(twist[3:], np.eye(3)).T
    result[:3, 3] = twist[:3]
    return result


@given(T_a_b=poses(), T_b_c=poses())
def test_composition_and_inverse_are_those_of_the_matrices(T_a_b, T_b_c):
    np.testing.assert_allclose(matrix(T_a_b @ T_b_c), matrix(T_a_b) @ matrix(T_b_c), atol=1e-12)
    np.testing.assert_allclose(matrix(T_a_b.inverse()), np.linalg.inv(matrix(T_a_b)), atol=1e-10)


@given(T_world_camera=poses(), twist=twists(), duration=numbers(0.0, 2.0))
def test_motion_is_the_matrix_exponential(T_world_camera, twist, duration):
    expected = matrix(T_world_camera) @ expm(duration * twist_matrix(twist))
    np.testing.assert_allclose(matrix(T_world_camera.integrate(twist, duration)), expected, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.99e-4, 1.01e-4, 1e-2, 3.14159, 6.5])
def test_motion_is_exact_at_small_and_large_angles(angle):
    twist = np.array([0.3, -1.0, 2.0, *(angle * np.array([0.6, 0.0, -0.8]))])
    moved = Pose(np.eye(3), np.zeros(3)).integrate(twist, 1.0)
    np.testing.assert_allclose(matrix(moved), expm(twist_matrix(twist)), atol=1e-13)


def test_thousands_of_steps_stay_a_rotation():
    pose = Pose(np.eye(3), np.zeros(3))
    for _ in range(2000):
        pose = pose.integrate([0.1, 0.2, 0.3, 1.0, -2.0, 0.5], 0.04)
    assert np.abs(pose.rotation @ pose.rotation.T - np.eye(3)).max() < 1e-14


@given(pose=poses())
def test_quaternion_round_trip(pose):
    again = Pose.from_quaternion(pose.translation, pose.quaternion_xyzw)
    np.testing.assert_allclose(matrix(again), matrix(pose), atol=1e-12)


@given(pose=poses(), row=st.integers(0, 5), tolerance=numbers(1e-6, 1e-2))
def test_poses_are_close_if_every_element_is(pose, row, tolerance):
    def moved_by(step):
        return pose.integrate(np.eye(6)[row] * step, 1.0)

    assert pose.is_close(pose, tolerance)
    assert pose.is_close(moved_by(0.9 * tolerance), tolerance)
    # Of a vector of length 1, or a rotation, some element changes by 1 / sqrt(3) of the step at least.
    assert not pose.is_close(moved_by(2.0 * tolerance), tolerance)


@given(center=vectors(), viewed=vectors())
def test_looking_at_puts_the_point_on_the_optical_axis(center, viewed):
    if np.linalg.norm(np.cross(viewed - center, [0, 0, 1])) < 1e-3:
        return
    T_world_camera = Pose.look_at(center, viewed)
    in_camera = matrix(T_world_camera.inverse()) @ [*viewed, 1.0]
    np.testing.assert_allclose(in_camera[:3], [0, 0, np.linalg.norm(viewed - center)], atol=1e-9)
    assert T_world_camera.rotation[2, 1] < 0.0  # image down is world down


@given(length=numbers(-12.0, 12.0))
def test_the_length_of_down_does_not_matter(length):
    down = np.array([0.3, -0.2, -1.0])
    expected, found = (Pose.look_at([1, 2, 3], [-2, 0, 1], size * down) for size in (1.0, 10.0**length))
    np.testing.assert_allclose(found.rotation, expected.rotation, atol=1e-15)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Pose(2 * np.eye(3), np.zeros(3)), "not a rotation matrix"),
        (lambda: Pose(np.diag([1.0, 1.0, -1.0]), np.zeros(3)), "not a rotation matrix"),
        (lambda: Pose(np.eye(3), [0, float("nan"), 0]), r"translation\[1\] is nan"),
        (lambda: Pose.from_quaternion([0, 0, 0], [0, 0, 0, 0]), "length 0"),
        (lambda: Pose.from_quaternion([0, 0, 0], [0, 0, 0, 2]), "length 2"),
        (lambda: Pose.from_quaternion([0, 0, 0], [1e300, 0, 0, 0]), r"length 1e\+300"),
        (lambda: Pose(np.eye(3), [0, 1e60, 0]), r"translation is \[0.0, 1e\+60, 0.0\] m; coordinates up to 1e\+50 m"),
        (lambda: Pose.look_at([1, 2, 3], [1, 2, 3]), "cannot look at its own centre"),
        (lambda: Pose.look_at([0, 0, 0], [0, 0, 5]), r"down = \[0.0, 0.0, -1.0\] is zero or along the optical axis"),
        (lambda: Pose.look_at([0, 0, 0], [0, 0, 5], [0, 0, 0]), "is zero or along the optical axis"),
        (lambda: Pose(np.eye(3), np.zeros(3)).integrate([np.inf, 0, 0, 0, 0, 0], 1.0), r"twist\[0\] is inf"),
        (lambda: Pose(np.eye(3), np.zeros(3)).integrate([1e300, 0, 0, 0, 0, 0], 1e300), "is a step of inf m or rad"),
    ],
)
def test_what_is_not_a_pose_is_refused(build, message):
    with pytest.raises(GeometryError, match=message):
        build()
