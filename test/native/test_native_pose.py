# SPDX-License-Identifier: Apache-2.0
"""The loops that estimate poses against projections, central differences and scipy."""

import numpy as np
import pytest
from pose_scenes import arrays, distance, image_covariances, image_of, random_view
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from plsing_ros import _core
from plsing_ros.features import interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.pose.residuals import known_lines

IMAGE, SCENE, ALL = (1e-3, 0.0, 0.0), (0.0, 1e-4, 0.0), (2e-3, 1e-3, 3e-3)
COSTS = np.array([20.0, 12.0])


def known(lines, image, noise=IMAGE):
    covariances = np.tile([noise[0] ** 2, 0.0, noise[0] ** 2], (len(lines), 1))
    return known_lines(lines), np.hstack([image, covariances]), np.array([*noise[1:], 0.0])


def pose_of(rotation, translation):
    return Pose(rotation.T, -rotation.T @ translation)


def residuals(scene, *poses):
    return _core.image_residuals(*scene, *arrays(*poses))


def squares(scene, pose):
    return (residuals(scene, pose)[0, 2:4] ** 2).sum(axis=0)


def uncertainty(scene, pose, weight):
    rotation, translation = arrays(pose)
    return _core.pose_uncertainty(*scene, rotation[0], translation[0], weight)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 9])
def test_translations_are_the_shortest_of_least_squares(n):
    generator = np.random.default_rng(n)
    normals, points = generator.normal(size=(n, 3)), generator.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rotation = Rotation.random(5, generator).as_matrix()
    for R, found in zip(rotation, _core.translations(rotation, normals, points), strict=True):
        expected = np.linalg.lstsq(normals, -np.einsum("ij,ij->i", normals, points @ R.T), rcond=None)[0]
        np.testing.assert_allclose(found, expected, atol=1e-10)


@pytest.mark.parametrize("wrong", [False, True])
def test_refinement_ends_at_the_minimum_that_scipy_finds(wrong):
    generator = np.random.default_rng(6)
    lines, pose = random_view(generator, 6)
    image = image_of(lines, pose, 1e-3, generator).image_lines.copy()
    weight = np.ones((2, 6))
    if wrong:
        image[2], weight[:, 2] = [0.6, 0.8, -1.7], 0.0
    scene = known(lines, image)
    starts = arrays(*(pose.integrate(generator.normal(scale=0.03, size=6), 1.0) for _ in range(2)))
    rotation, translation = _core.refine_poses(*scene, weight, *starts, 40)
    solution = least_squares(
        lambda motion: (residuals(scene, pose.integrate(motion, 1.0))[0, 2:4] * weight[0]).ravel(), np.zeros(6)
    )
    expected = pose.integrate(solution.x, 1.0)
    for i in range(2):
        assert distance(pose_of(rotation[i], translation[i]), expected) < 1e-6
    unmoved = _core.refine_poses(*scene, weight, *starts, 0)
    np.testing.assert_array_equal(unmoved[0], starts[0])


def test_the_search_finds_the_pose_once_and_says_where_from():
    generator = np.random.default_rng(3)
    lines, pose = random_view(generator, 5)
    scene = known(lines, image_of(lines, pose).image_lines)
    far = [Pose.look_at(generator.normal(scale=4.0, size=3), (0.0, 0.0, 0.0)) for _ in range(30)]
    near = [pose.integrate(generator.normal(scale=0.02, size=6), 1.0) for _ in range(3)]
    found = _core.search_poses(*scene, *arrays(*far, *near), COSTS)
    assert 1 <= len(found) <= 6
    poses, cost = [pose_of(*each[:2]) for each in found], [each[2] for each in found]
    assert distance(poses[0], pose) < 1e-6
    assert found[0][3] >= 30
    # Image noise alone: the determinant of each line's covariance is sigma^4.
    assert cost[0] == pytest.approx(5 * 4 * np.log(1e-3), abs=1e-6)
    assert (np.diff(cost) >= -1e-3).all()
    assert all(distance(first, second) > 1e-4 for i, first in enumerate(poses) for second in poses[:i])


def test_the_search_among_none_or_what_is_no_number_finds_none():
    lines, pose = random_view(np.random.default_rng(3), 4)
    scene = known(lines, image_of(lines, pose).image_lines)
    assert _core.search_poses(*scene, np.empty((0, 3, 3)), np.empty((0, 3)), COSTS) == []
    assert _core.search_poses(*scene, np.full((2, 3, 3), np.nan), np.zeros((2, 3)), COSTS) == []


def test_the_cheapest_that_differ_by_more_than_noise():
    turns = np.array([0.0, 0.02, 0.5, 0.51, 1.0, 1.5])
    rotation = Rotation.from_rotvec(turns[:, np.newaxis] * [0.0, 0.6, 0.8]).as_matrix()
    cost = np.array([3.0, 1.0, 2.0, np.inf, 2.0, 5.0])
    assert _core.cheapest_different(rotation, cost, 9).tolist() == [1, 2, 4, 5]
    assert _core.cheapest_different(rotation, cost, 2).tolist() == [1, 2]


@pytest.mark.parametrize("noise", [IMAGE, SCENE, ALL], ids=["image", "scene", "all"])
def test_the_covariance_is_that_of_central_differences_in_the_world(noise):
    lines, pose = random_view(np.random.default_rng(8), 5)
    scene = known(lines, image_of(lines, pose.integrate(np.full(6, 1e-5), 1.0)).image_lines, noise)
    weight = np.array([1.0, 1.0, 0.0, 1.0, 1.0])
    deviation, axes, covariance, position, orientation, _, condition, squared = uncertainty(scene, pose, weight)
    step, columns = 1e-6, []
    for axis in np.eye(6):
        ends = [
            Pose(Rotation.from_rotvec(s * axis[3:]).as_matrix() @ pose.rotation, pose.translation + s * axis[:3])
            for s in (step, -step)
        ]
        table = residuals(scene, *ends)
        columns.append((table[0, :2] - table[1, :2]) / (2.0 * step))
    jacobian = np.stack(columns, axis=-1)
    inverse = np.linalg.inv(image_covariances(lines, pose, *noise))
    normal = np.einsum("ina,nij,jnb,n->ab", jacobian, inverse, jacobian, weight)
    np.testing.assert_allclose(covariance @ normal, np.eye(6), atol=1e-4)
    assert position**2 == pytest.approx(np.linalg.eigvalsh(covariance[:3, :3])[-1])
    assert orientation**2 == pytest.approx(np.linalg.eigvalsh(covariance[3:, 3:])[-1])
    np.testing.assert_allclose(axes @ axes.T, np.eye(6), atol=1e-12)
    assert (np.diff(deviation) <= 0.0).all()
    assert deviation[0] ** 2 == pytest.approx(np.linalg.eigvalsh(covariance)[-1])
    matrix = interaction_matrix(lines.select([0, 1, 3, 4]).transformed(pose.inverse(), "camera"))
    size = np.linalg.svd(matrix, compute_uv=False)
    assert condition == pytest.approx(size[-1] / size[0])
    assert squared == pytest.approx(squares(scene, pose) @ weight)


@pytest.mark.parametrize(("noise", "linear"), [(1e-6, True), (0.05, False)])
def test_nonlinearity_is_how_far_the_misfit_is_from_a_quadratic(noise, linear):
    lines, pose = random_view(np.random.default_rng(8), 4)
    scene = known(lines, image_of(lines, pose).image_lines, (noise, 0.0, 0.0))
    deviation, axes, *_, nonlinearity, _, _ = uncertainty(scene, pose, np.ones(4))
    changes = []
    for i in range(2):
        for sign in (2.0, -2.0):
            motion = sign * deviation[i] * axes[i]
            # By Cayley's rotation, of which only the angle differs from that of the exponential.
            angle = np.linalg.norm(motion[3:])
            cayley = motion[3:] / angle * 2.0 * np.arctan(angle / 2.0)
            rotation = pose.rotation @ Rotation.from_rotvec(cayley).as_matrix()
            changes.append(squares(scene, Pose(rotation, pose.translation + pose.rotation @ motion[:3])).sum() / 4.0)
    assert nonlinearity == pytest.approx(np.abs(np.array(changes) - 1.0).max(), rel=1e-3, abs=1e-6)
    assert (nonlinearity < 0.01) == linear


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("row", [0, 3])
def test_a_misfit_that_is_not_finite_is_no_quadratic(row, value):
    lines, pose = random_view(np.random.default_rng(8), 4)
    image = image_of(lines, pose).image_lines.copy()
    image[row, 2] = value
    assert uncertainty(known(lines, image), pose, np.ones(4))[5] == 1e6


def test_poses_that_are_not_determined_have_no_uncertainty():
    lines = LineSet.from_points_directions([[0, 0, 0], [1, 2, 0], [0, 1, 1], [2, 0, 3]], [[0, 0, 1]] * 4)
    pose = Pose.look_at((4.0, -3.0, 2.0), (0.1, 0.2, -0.1))
    scene = known(lines, image_of(lines, pose).image_lines)
    assert uncertainty(scene, pose, np.ones(4)) is None
    assert uncertainty(scene, pose, np.zeros(4)) is None
    lines, pose = random_view(np.random.default_rng(8), 2)
    assert uncertainty(known(lines, image_of(lines, pose).image_lines), pose, np.ones(2)) is None
