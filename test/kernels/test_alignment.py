"""Poses from lines against the poses they were made with, and against the best fit of noisy ones."""

import numpy as np
import pytest
from hypothesis import assume, given
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from strategies import line_sets, numbers, poses

from plsing_ros.geometry import LineSet
from plsing_ros.kernels import compiled, of_numpy

BOTH = pytest.mark.parametrize("the", [compiled, of_numpy], ids=["compiled", "numpy"])


def aligned(the, scene, direction, moment):
    """Return rotation, translation and quality, or None."""
    rotation, translation, quality = np.empty((3, 3)), np.empty(3), np.empty(3)
    fixed = the.align(scene.direction, scene.moment, direction, moment, rotation, translation, quality)
    return (rotation, translation, quality) if fixed else None


@BOTH
@given(lines=line_sets(min_size=2), pose=poses())
def test_the_pose_comes_back(the, lines, pose):
    spread = np.linalg.svd(lines.direction.T @ lines.direction, compute_uv=False)[1]
    assume(spread > 0.05)
    seen = lines.transformed(pose.inverse(), "camera")
    rotation, translation, quality = aligned(the, lines, seen.direction, seen.moment)
    np.testing.assert_allclose(rotation, pose.rotation, atol=1e-12)
    np.testing.assert_allclose(translation, pose.translation, atol=1e-10)
    np.testing.assert_allclose(quality, [spread, 1.0, 0.0], atol=1e-10)
    assert the.least_cosine(lines.direction, pose.rotation, seen.direction) == pytest.approx(1.0, abs=1e-12)


@BOTH
@pytest.mark.parametrize("count", [3, 5, 100])
def test_no_other_pose_fits_noisy_lines_better(the, count):
    generator = np.random.default_rng(count)
    scene = LineSet.from_points_directions(generator.normal(size=(count, 3)), generator.normal(size=(count, 3)))
    turn = Rotation.from_rotvec([0.3, -2.0, 1.0]).as_matrix()
    direction = scene.direction @ turn + 0.05 * generator.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    moment = scene.moment @ turn + 0.05 * generator.normal(size=(count, 3))
    rotation, translation, quality = aligned(the, scene, direction, moment)
    best, _ = Rotation.align_vectors(scene.direction, direction)
    np.testing.assert_allclose(rotation, best.as_matrix(), atol=1e-7)

    def misfit(t):
        return (np.cross(t, scene.direction) - scene.moment + moment @ rotation.T).ravel()

    fit = least_squares(misfit, np.zeros(3), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    np.testing.assert_allclose(translation, fit.x, atol=1e-7)
    assert quality[1] == pytest.approx(np.einsum("ij,ij->i", scene.direction, direction @ rotation.T).min())
    assert quality[2] == pytest.approx(np.sqrt(2.0 * fit.cost / count))


@BOTH
@given(angle=numbers(-3.0, 3.0), pose=poses())
def test_directions_in_a_plane_fix_a_rotation_and_no_mirror(the, angle, pose):
    assume(0.1 < abs(angle) < 3.0)
    lines = LineSet.from_points_directions(np.eye(3), [[1, 0, 0], [np.cos(angle), np.sin(angle), 0], [1, 0, 0]])
    seen = lines.transformed(pose.inverse(), "camera")
    rotation, translation, _ = aligned(the, lines, seen.direction, seen.moment)
    np.testing.assert_allclose(rotation, pose.rotation, atol=1e-10)
    np.testing.assert_allclose(translation, pose.translation, atol=1e-9)


@BOTH
@pytest.mark.parametrize("count", [1, 2, 4])
def test_parallel_lines_fix_nothing(the, count):
    scene = LineSet.from_points_directions(np.eye(4, 3)[:count], [[0, 0, 1]] * count)
    found = aligned(the, scene, scene.direction, scene.moment)
    assert found is None or found[2][0] < 1e-12


@BOTH
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", range(4))
def test_what_is_not_finite_fixes_nothing(the, row, value):
    arrays = np.tile(np.stack([np.eye(3), np.eye(3)[[1, 2, 0]]]), (2, 1, 1))
    assert the.align(*arrays, np.empty((3, 3)), np.empty(3), np.empty(3))
    arrays[row, 1, 2] = value
    assert not the.align(*arrays, np.empty((3, 3)), np.empty(3), np.empty(3))


@BOTH
@given(lines=line_sets(min_size=1), pose=poses())
def test_the_least_cosine_is_that_of_the_reversed_line(the, lines, pose):
    seen = lines.transformed(pose.inverse(), "camera").direction.copy()
    seen[-1] *= -1.0
    assert the.least_cosine(lines.direction, pose.rotation, seen) == pytest.approx(-1.0, abs=1e-12)
