# SPDX-License-Identifier: Apache-2.0
"""Poses from lines against the poses they were made with, and against the best fit of noisy ones."""

import numpy as np
import pytest
from hypothesis import assume, given
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from strategies import line_sets, numbers, poses, seen_lines

from plsing_ros import _core
from plsing_ros.geometry import LineSet, Pose


def aligned(scene, direction, moment):
    return _core.align_lines(scene.direction, scene.moment, direction, moment)


@given(lines=line_sets(min_size=2), pose=poses())
def test_the_pose_comes_back(lines, pose):
    spread = np.linalg.svd(lines.direction.T @ lines.direction, compute_uv=False)[1]
    assume(spread > 0.05)
    seen = lines.transformed(pose.inverse(), "camera")
    rotation, translation, *quality = aligned(lines, seen.direction, seen.moment)
    np.testing.assert_allclose(rotation, pose.rotation, atol=1e-12)
    np.testing.assert_allclose(translation, pose.translation, atol=1e-10)
    np.testing.assert_allclose(quality, [spread, 1.0, 0.0], atol=1e-10)


@pytest.mark.parametrize("count", [3, 5, 100])
def test_no_other_pose_fits_noisy_lines_better(count):
    generator = np.random.default_rng(count)
    scene = LineSet.from_points_directions(generator.normal(size=(count, 3)), generator.normal(size=(count, 3)))
    turn = Rotation.from_rotvec([0.3, -2.0, 1.0]).as_matrix()
    direction = scene.direction @ turn + 0.05 * generator.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    moment = scene.moment @ turn + 0.05 * generator.normal(size=(count, 3))
    rotation, translation, _, cosine, offset = aligned(scene, direction, moment)
    best, _ = Rotation.align_vectors(scene.direction, direction)
    np.testing.assert_allclose(rotation, best.as_matrix(), atol=1e-7)

    def misfit(t):
        return (np.cross(t, scene.direction) - scene.moment + moment @ rotation.T).ravel()

    fit = least_squares(misfit, np.zeros(3), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    np.testing.assert_allclose(translation, fit.x, atol=1e-7)
    assert cosine == pytest.approx(np.einsum("ij,ij->i", scene.direction, direction @ rotation.T).min())
    assert offset == pytest.approx(np.sqrt(2.0 * fit.cost / count))


@given(angle=numbers(-3.0, 3.0), pose=poses())
def test_directions_in_a_plane_fix_a_rotation_and_no_mirror(angle, pose):
    assume(0.1 < abs(angle) < 3.0)
    lines = LineSet.from_points_directions(np.eye(3), [[1, 0, 0], [np.cos(angle), np.sin(angle), 0], [1, 0, 0]])
    seen = lines.transformed(pose.inverse(), "camera")
    rotation, translation, *_ = aligned(lines, seen.direction, seen.moment)
    np.testing.assert_allclose(rotation, pose.rotation, atol=1e-10)
    np.testing.assert_allclose(translation, pose.translation, atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_parallel_lines_fix_nothing(count):
    scene = LineSet.from_points_directions(np.eye(4, 3)[:count], [[0, 0, 1]] * count)
    found = aligned(scene, scene.direction, scene.moment)
    assert found is None or found[2] < 1e-12


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", range(4))
def test_what_is_not_finite_fixes_nothing(row, value):
    arrays = np.tile(np.stack([np.eye(3), np.eye(3)[[1, 2, 0]]]), (2, 1, 1))
    assert _core.align_lines(*arrays) is not None
    arrays[row, 1, 2] = value
    assert _core.align_lines(*arrays) is None


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


def test_images():
    good = np.array([[0.6, -0.8, 5.0], [0.0, 1.0, 0.0]])
    assert _core.are_image_lines(good, 1e-3)
    assert _core.are_image_lines(good * 1.0009, 1e-3)
    assert not _core.are_image_lines(good * 1.0011, 1e-3)
    for value in (np.nan, np.inf):
        for column in range(3):
            bad = good.copy()
            bad[1, column] = value
            assert not _core.are_image_lines(bad, 1e-3)


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


def test_rotations():
    rotation = Pose.look_at([1, 2, 3], [0.3, 0.1, 0.2]).rotation
    assert _core.is_rotation(rotation, 1e-6)
    assert not _core.is_rotation(-rotation, 1e-6)
    assert not _core.is_rotation(rotation * 1.001, 1e-6)
    assert not _core.is_rotation(np.full((3, 3), np.nan), 1e-6)
    assert not _core.is_rotation(np.diag([np.inf, 0.0, 0.0]), 1e-6)
