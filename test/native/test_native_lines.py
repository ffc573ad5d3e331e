# SPDX-License-Identifier: Apache-2.0
"""The checks that every line, image line and rotation passes: what is right to a tolerance, and finite."""

import numpy as np
import pytest
from hypothesis import given
from strategies import numbers, seen_lines

from plsing_ros import _core
from plsing_ros.geometry import Pose


@given(lines=seen_lines(min_size=1), error=numbers(2e-6, 1e6))
def test_are_lines_refuses_what_is_no_line(lines, error):
    u, l = lines.direction, lines.moment  # noqa: E741, the literature's name
    assert _core.are_lines(u, l, 1e-6)
    assert not _core.are_lines(u * (1.0 + error), l, 1e-6)
    skewed = l.copy()
    skewed[-1] += error * (1.0 + np.abs(l[-1]).max()) * 4.0 * u[-1]
    assert not _core.are_lines(u, skewed, 1e-6)
    for value in (np.nan, np.inf):
        for array in (u, l):
            bad = array.copy()
            bad[-1, 1] = value
            assert not _core.are_lines(bad if array is u else u, bad if array is l else l, 1e-6)


@pytest.mark.parametrize(
    ("check", "good"),
    [
        (_core.are_image_lines, np.array([[0.6, -0.8, 5.0], [0.0, 1.0, 0.0]])),
        (_core.is_rotation, Pose.look_at([1, 2, 3], [0.3, 0.1, 0.2]).rotation),
    ],
)
def test_image_lines_and_rotations_are_of_unit_length_to_a_tolerance_and_finite(check, good):
    assert check(good, 1e-3) and check(good * 1.0004, 1e-3)
    assert not check(good * 1.0011, 1e-3)
    for place in np.ndindex(*good.shape):
        for value in (np.nan, np.inf):
            bad = good.copy()
            bad[place] = value
            assert not check(bad, 1e-3)


def test_a_mirror_is_no_rotation():
    assert not _core.is_rotation(np.diag([1.0, 1.0, -1.0]), 1e-6)


@pytest.mark.parametrize(
    ("moment", "has_image"),
    [
        ([2e-9, 0, 0], True),
        ([5e-10, 0, 0], False),
        ([0, 2e-6, 1e4], False),
        ([0, 2e-5, 1e4], True),
        ([1, 2, np.nan], False),
        ([1, np.nan, 2], False),
        ([1, 2, -np.inf], False),
        ([np.inf, 1, 2], False),
        ([-np.inf, np.nan, 2], False),
        ([1.5e308, 1.5e308, 0], False),
        ([1e308, 1e308, 1e308], True),
    ],
)
def test_a_line_has_an_image_if_it_is_clear_of_camera_centre_and_focal_plane(moment, has_image):
    moments = np.array([[1.0, 2.0, 3.0], moment])
    assert _core.have_images(moments, 1e-9) is has_image
    assert (_core.interaction_matrix(np.ones((2, 3)), moments, 1e-9) is not None) is has_image


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", range(4))
def test_what_is_not_finite_fixes_no_pose(row, value):
    arrays = np.tile(np.stack([np.eye(3), np.eye(3)[[1, 2, 0]]]), (2, 1, 1))
    assert _core.align_lines(*arrays) is not None
    arrays[row, 1, 2] = value
    assert _core.align_lines(*arrays) is None
