# SPDX-License-Identifier: Apache-2.0
"""Conditioning and focal-plane angles of many poses at once are those of each pose by itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import poses, seen_lines, vectors

from plsing_ros.features import interaction_matrix, inverse_condition_number
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.planning.path_conditions import focal_angles, inverse_condition_numbers


@settings(max_examples=50)
@given(in_camera=seen_lines(), pose=poses(), shifts=st.lists(vectors(6, -0.1, 0.1), min_size=1, max_size=3))
def test_inverse_condition_numbers_are_those_of_the_interaction_matrix(in_camera, pose, shifts):
    lines = in_camera.transformed(pose, "world")
    camera = [pose.integrate(shift, 1.0) for shift in shifts]
    found = inverse_condition_numbers(
        lines, np.array([each.rotation for each in camera]), np.array([each.translation for each in camera])
    )
    expected = [
        inverse_condition_number(interaction_matrix(lines.transformed(each.inverse(), "camera"))) for each in camera
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-10)
    if len(lines) < 3:
        assert not found.any()


@given(pose=poses(), turn=st.floats(0.0, 1.5))
def test_the_focal_angle_is_how_far_a_line_is_turned_out_of_the_focal_plane(pose, turn):
    """A line of the focal plane, 2 m to the right, after the camera turned about its own vertical axis."""
    line = LineSet.from_points_directions([[2.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]).transformed(pose, "world")
    turned = Pose(pose.rotation @ Rotation.from_rotvec([0.0, turn, 0.0]).as_matrix(), pose.translation)
    angle = focal_angles(line, turned.rotation[np.newaxis], turned.translation[np.newaxis])
    assert angle == pytest.approx(np.array([[turn]]), abs=1e-6)


def test_a_pose_from_which_a_line_has_no_image_counts_as_singular_and_no_pose_as_none():
    lines = LineSet.from_points_directions(
        [[2.0, 0.0, 0.0], [0.0, 1.0, 3.0], [0.5, -1.0, 4.0], [1.0, 2.0, 5.0]],
        [[0.0, 1.0, 0.0], [1.0, 0.3, 0.0], [0.1, 0.5, 1.0], [1.0, -1.0, 0.2]],
    )
    at_once = inverse_condition_numbers(lines, np.array([np.eye(3), np.eye(3)]), np.array([[0, 0, 0], [0.1, 0.2, 0.3]]))
    assert at_once[0] == 0.0
    assert at_once[1] > 1e-4
    assert inverse_condition_numbers(lines, np.zeros((0, 3, 3)), np.zeros((0, 3))).shape == (0,)
