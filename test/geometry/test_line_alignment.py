# SPDX-License-Identifier: Apache-2.0
import warnings

import numpy as np
import pytest
from hypothesis import assume, given, settings
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from strategies import line_sets, numbers, poses

from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.geometry import LineSet, Pose, align_lines
from plsing_ros.geometry.line_alignment import lines_to_reverse, pose_by_lines


def spread(lines):
    return np.linalg.svd(lines.direction, compute_uv=False)[1]


@given(lines=line_sets(min_size=2), pose=poses())
def test_the_pose_comes_back(lines, pose):
    assume(spread(lines) ** 2 > 0.05)
    found = align_lines(lines, lines.transformed(pose.inverse(), "camera"))
    np.testing.assert_allclose(found.T_world_camera.rotation, pose.rotation, atol=1e-12)
    np.testing.assert_allclose(found.T_world_camera.translation, pose.translation, atol=1e-10)
    assert found.angle < 1e-6 and found.offset < 1e-10


@pytest.mark.parametrize("count", [3, 5, 100])
def test_no_other_pose_fits_noisy_lines_better(count):
    generator = np.random.default_rng(count)
    scene = LineSet.from_points_directions(generator.normal(size=(count, 3)), generator.normal(size=(count, 3)))
    exact = scene.transformed(Pose(Rotation.from_rotvec([0.3, -2.0, 1.0]).as_matrix(), np.ones(3)), "camera")
    points, directions = (each + 0.05 * generator.normal(size=(count, 3)) for each in (exact.point, exact.direction))
    seen = LineSet.from_points_directions(points, directions, "camera")
    found = align_lines(scene, seen)
    best, _ = Rotation.align_vectors(scene.direction, seen.direction)
    turned = best.as_matrix()
    np.testing.assert_allclose(found.T_world_camera.rotation, turned, atol=1e-7)
    fit = least_squares(
        lambda t: (np.cross(t, scene.direction) - scene.moment + seen.moment @ turned.T).ravel(), np.zeros(3)
    )
    np.testing.assert_allclose(found.T_world_camera.translation, fit.x, atol=1e-7)
    assert np.cos(found.angle) == pytest.approx(np.einsum("ij,ij->i", scene.direction, seen.direction @ turned.T).min())
    assert found.offset == pytest.approx(np.sqrt(2.0 * fit.cost / count))


@given(angle=numbers(-3.0, 3.0), pose=poses())
def test_directions_in_a_plane_fix_a_rotation_and_no_mirror(angle, pose):
    assume(0.1 < abs(angle) < 3.0)
    lines = LineSet.from_points_directions(np.eye(3), [[1, 0, 0], [np.cos(angle), np.sin(angle), 0], [1, 0, 0]])
    found = align_lines(lines, lines.transformed(pose.inverse(), "camera")).T_world_camera
    np.testing.assert_allclose(found.rotation, pose.rotation, atol=1e-10)
    np.testing.assert_allclose(found.translation, pose.translation, atol=1e-9)


@given(lines=line_sets(min_size=4, max_size=6), pose=poses())
def test_order_and_missing_lines_do_not_matter(lines, pose):
    seen = lines.transformed(pose.inverse(), "camera").select(range(len(lines) - 1, 0, -1))
    assume(spread(seen) > 0.2)
    np.testing.assert_allclose(align_lines(lines, seen).T_world_camera.translation, pose.translation, atol=1e-5)


def misfit_without(lines, seen, row):
    """Return how badly directions fit at best if a row is reversed."""
    direction = seen.direction.copy()
    direction[row] *= -1.0
    with warnings.catch_warnings():
        # That lines along the axes leave the rotation open is no news here.
        warnings.simplefilter("ignore", UserWarning)
        return Rotation.align_vectors(lines.direction, direction)[1]


@settings(max_examples=50)
@given(lines=line_sets(min_size=4, max_size=4), pose=poses())
def test_a_reversed_line_is_named(lines, pose):
    assume(np.linalg.svd(lines.direction, compute_uv=False)[2] > 0.6)
    seen = lines.transformed(pose.inverse(), "camera")
    sign = np.array([[1.0], [1.0], [-1.0], [1.0]])
    turned = LineSet(seen.direction * sign, seen.moment * sign, "camera", seen.ids)
    np.testing.assert_allclose(pose_by_lines(lines, seen).rotation, pose.rotation, atol=1e-6)
    assert align_lines(lines, turned).angle > 0.1
    # Lines along the axes fit as well when another one is reversed: the first that does is named.
    misfit = np.array([misfit_without(lines, turned, row) for row in range(4)])
    assume(not ((misfit > 1e-7) & (misfit < 1e-3)).any())
    assert misfit[2] <= 1e-7
    first = int(np.flatnonzero(misfit <= 1e-7)[0]) + 1
    assert lines_to_reverse(lines, turned, 1e-6) == (first,)
    if align_lines(lines, turned).angle > 0.6:
        with pytest.raises(ObservationError, match=r"\bline \d\b.*reversed"):
            pose_by_lines(lines, turned)


def test_what_does_not_fix_a_pose_is_refused():
    parallel = LineSet.from_points_directions([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1]] * 3)
    for count in (1, 2, 3):
        with pytest.raises(GeometryError, match=rf"\b{count} seen line.*parallel"):
            align_lines(parallel, parallel.select(range(count)))
    with pytest.raises(GeometryError, match=r"\bid 3\b.*\bids\b"):
        align_lines(parallel.select([0, 1]), parallel)
