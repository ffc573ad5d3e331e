# SPDX-License-Identifier: Apache-2.0
"""The loops that estimate poses against projections, central differences and scipy."""

import numpy as np
import pytest
from hypothesis import given, settings
from pose_scenes import distance, image_of, random_view, views
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from strategies import twists

from plsing_ros import _core
from plsing_ros.features import interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.pose.residuals import known_lines

IMAGE, SCENE, ALL = (1e-3, 0.0, 0.0), (0.0, 1e-4, 0.0), (2e-3, 1e-3, 3e-3)
COSTS = np.array([20.0, 12.0])


def known(lines, image, noise=IMAGE, least_cosine=0.0):
    covariances = np.tile([noise[0] ** 2, 0.0, noise[0] ** 2], (len(lines), 1))
    return known_lines(lines), np.hstack([image, covariances]), np.array([*noise[1:], least_cosine])


def arrays(*poses):
    """Rotations and translations of T_camera_world."""
    inverse = [pose.inverse() for pose in poses]
    return np.array([each.rotation for each in inverse]), np.array([each.translation for each in inverse])


def pose_of(rotation, translation):
    return Pose(rotation.T, -rotation.T @ translation)


def residuals(scene, *poses):
    return _core.image_residuals(*scene, *arrays(*poses))


def squares(scene, pose):
    return (residuals(scene, pose)[0, 2:4] ** 2).sum(axis=0)


def uncertainty(scene, pose, weight):
    rotation, translation = arrays(pose)
    return _core.pose_uncertainty(*scene, rotation[0], translation[0], weight)


def polar_image(coordinates, rotation, translation):
    """Angle and offset of lines (u, l) (n, 6) in a camera frame, l made orthogonal to u first, shape (n, 2)."""
    u, l = coordinates[:, :3], coordinates[:, 3:]  # noqa: E741, the literature's name
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    l = l - (l * u).sum(axis=1, keepdims=True) * u  # noqa: E741
    moment = l @ rotation.T + np.cross(translation, u @ rotation.T)
    return np.column_stack(
        [np.arctan2(moment[:, 1], moment[:, 0]), moment[:, 2] / np.hypot(moment[:, 0], moment[:, 1])]
    )


def covariances(lines, pose, noise):
    """Of angle and offset of each line, by central differences over all coordinates, shape (n, 2, 2)."""
    rotation, translation = (each[0] for each in arrays(pose))
    seen = lines.transformed(pose.inverse(), "camera")
    total = np.tile(noise[0] ** 2 * np.eye(2), (len(lines), 1, 1))
    frames = ((lines, rotation, translation, noise[1]), (seen, np.eye(3), np.zeros(3), noise[2]))
    for own, turn, shift, sigma in frames:
        coordinates = np.hstack([own.direction, own.moment])
        for step in 1e-6 * np.eye(6):
            ends = polar_image(coordinates + step, turn, shift), polar_image(coordinates - step, turn, shift)
            change = (ends[0] - ends[1] + [np.pi, 0.0]) % [2.0 * np.pi, np.inf] - [np.pi, 0.0]
            change[:, 1] = ends[0][:, 1] - ends[1][:, 1]
            total += sigma**2 * np.einsum("ni,nj->nij", change, change) / 4e-12
    return total


@settings(max_examples=30)
@given(view=views(), twist=twists())
def test_residuals_are_differences_of_projections_and_jacobians_their_derivatives(view, twist):
    lines, pose = view
    image = image_of(lines, pose.integrate(0.01 * twist, 1.0)).image_lines
    step, scene = 1e-6, known(lines, image)
    table = residuals(scene, pose, pose.integrate(twist, step), pose.integrate(twist, -step))
    line = project_lines(lines.transformed(pose.inverse(), "camera")).reshape(-1, 3)
    against = np.einsum("ij,ij->i", line[:, :2], image[:, :2]) < 0.0
    line[against] *= -1.0
    turn = np.arctan2(line[:, 1], line[:, 0]) - np.arctan2(image[:, 1], image[:, 0])
    np.testing.assert_allclose(np.exp(1j * table[0, 0]), np.exp(1j * turn), atol=1e-9)
    np.testing.assert_allclose(table[0, 1], line[:, 2] - image[:, 2], atol=1e-9 * (1.0 + np.abs(line[:, 2]).max()))
    assert ((table[0, 4] > 0.0) == against).all()
    raw, whitened = _core.image_jacobians(*scene, *arrays(pose))
    expected = (table[1, :2] - table[2, :2]) / (2.0 * step)
    np.testing.assert_allclose(raw[0] @ twist, expected, atol=1e-4 * (1.0 + np.abs(expected).max()))
    np.testing.assert_allclose(whitened, raw * 1e3)


def map_covariances(lines, pose):
    """What the tolerances of the lines make of angle and offset, by central differences, shape (n, 2, 2)."""
    total = np.zeros((len(lines), 2, 2))
    for i, u in enumerate(lines.direction):
        for across in np.linalg.svd(u[np.newaxis])[2][1:]:
            for shift, turn in ((lines.position_std[i] * across, 0.0 * u), (0.0 * u, lines.direction_std[i] * across)):
                ends = []
                for sign in (-1e-3, 1e-3):
                    moved = LineSet.from_points_directions([lines.pivot[i] + sign * shift], [u + sign * turn])
                    ends.append(image_of(moved, pose).image_lines[0])
                sine = ends[0][0] * ends[1][1] - ends[0][1] * ends[1][0]
                change = np.array([np.arcsin(sine), ends[1][2] - ends[0][2]]) / 2e-3
                total[i] += np.outer(change, change)
    return total


@pytest.mark.parametrize("seed", range(5))
def test_what_is_whitened_has_the_covariance_of_image_and_map(seed):
    generator = np.random.default_rng(seed)
    lines, pose = random_view(generator, 5)
    lines = LineSet.from_points_directions(
        lines.point + lines.direction * generator.normal(size=(5, 1)),
        lines.direction,
        position_std=generator.uniform(0.0, 0.02, size=5),
        direction_std=generator.uniform(0.0, 0.02, size=5),
    )
    root = 1e-3 * generator.normal(size=(5, 2, 2))
    own = root @ root.transpose(0, 2, 1) + 1e-8 * np.eye(2)
    lines_known, image, options = known(lines, image_of(lines, pose).image_lines)
    image[:, 3:] = np.stack([own[:, 0, 0], own[:, 0, 1], own[:, 1, 1]], axis=1)
    raw, whitened = (each[0] for each in _core.image_jacobians(lines_known, image, options, *arrays(pose)))
    inverse = np.linalg.inv(own + map_covariances(lines, pose))
    normal = np.einsum("ina,nij,jnb->nab", raw, inverse, raw)
    size = np.abs(normal).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(np.einsum("ina,inb->nab", whitened, whitened) / size, normal / size, atol=1e-4)


@pytest.mark.parametrize("noise", [IMAGE, SCENE, ALL], ids=["image", "scene", "all"])
@pytest.mark.parametrize("seed", range(5))
def test_what_is_whitened_has_the_covariance_of_the_noise(seed, noise):
    lines, pose = random_view(np.random.default_rng(seed), 6)
    scene = known(lines, image_of(lines, pose.integrate(np.full(6, 0.01), 1.0)).image_lines, noise)
    table, (raw, whitened) = (
        residuals(scene, pose)[0],
        [each[0] for each in _core.image_jacobians(*scene, *arrays(pose))],
    )
    covariance = covariances(lines, pose, noise)
    inverse = np.linalg.inv(covariance)
    expected = np.einsum("in,nij,jn->n", table[:2], inverse, table[:2])
    np.testing.assert_allclose((table[2:4] ** 2).sum(axis=0), expected, rtol=1e-4)
    np.testing.assert_allclose(table[6], np.log(np.linalg.det(covariance)), atol=1e-4)
    normal = np.einsum("ina,nij,jnb->nab", raw, inverse, raw)
    size = np.abs(normal).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(np.einsum("ina,inb->nab", whitened, whitened) / size, normal / size, atol=1e-4)


@pytest.mark.parametrize(
    ("height", "min_cosine", "hidden"), [(3.0, 0.0, False), (-3.0, 0.5, True), (-3.0, 0.05, False)]
)
def test_a_line_behind_the_camera_is_hidden_unless_it_comes_into_the_field_of_view(height, min_cosine, hidden):
    lines = LineSet.from_points_directions([[0.0, 1.0, height]], [[1.0, 0.0, 0.1]], "world")
    camera = Pose(np.eye(3), np.zeros(3))
    scene = known(lines, project_lines(lines).reshape(-1, 3), IMAGE, min_cosine)
    assert residuals(scene, camera)[0, 5, 0] == hidden


def solutions(lines, image):
    normals = image / np.linalg.norm(image, axis=1, keepdims=True)
    rotation, triplet, degenerate = _core.triplet_rotations(lines.direction[np.newaxis], normals[np.newaxis])
    assert (triplet == 0).all()
    return rotation, bool(degenerate[0])


@settings(max_examples=40)
@given(view=views(3, 3))
def test_the_rotation_is_among_those_of_three_lines(view):
    lines, pose = view
    image = image_of(lines, pose).image_lines
    rotation, degenerate = solutions(lines, image)
    assert not degenerate
    orthonormal = np.broadcast_to(np.eye(3), rotation.shape)
    np.testing.assert_allclose(rotation @ rotation.transpose(0, 2, 1), orthonormal, atol=1e-12)
    # Near a double solution, the root of rounding is left.
    assert np.abs(rotation - pose.rotation.T).max(axis=(1, 2)).min() < 1e-5


def test_rotations_of_many_triplets_are_those_of_each():
    lines, pose = random_view(np.random.default_rng(2), 5)
    image = image_of(lines, pose).image_lines
    rows = np.array([[0, 1, 2], [1, 2, 4], [0, 3, 4]])
    normals = image / np.linalg.norm(image, axis=1, keepdims=True)
    rotation, triplet, _ = _core.triplet_rotations(lines.direction[rows], normals[rows])
    expected = [solutions(lines.select(list(row)), image[row])[0] for row in rows]
    np.testing.assert_array_equal(triplet, np.repeat([0, 1, 2], [len(each) for each in expected]))
    np.testing.assert_allclose(rotation, np.concatenate(expected), atol=1e-12)


def test_special_triplets():
    pose = Pose.look_at((4.0, -3.0, 2.0), (0.1, 0.2, -0.1))
    concurrent = LineSet.from_points_directions([[1, 1, 1]] * 3, [[1, 0, 0], [0, 1, 0], [0, 0.6, 0.8]])
    rotation, degenerate = solutions(concurrent, image_of(concurrent, pose).image_lines)
    assert not degenerate and len(rotation) == 0
    # Planes that coincide leave a continuum, and parallel lines have no rotation.
    plane = LineSet.from_points_directions([[0, 0, 0], [2, 0, 0], [0, 1, 0]], [[1, 0.2, 0], [0.1, 1, 0], [1, -1, 0]])
    rotation, degenerate = solutions(plane, np.array([[0.0, 1.0, 0.0]] * 3))
    assert degenerate and len(rotation) == 0
    parallel = LineSet.from_points_directions([[0, 0, 0], [1, 2, 0], [0, 1, 1]], [[0, 0, 1]] * 3)
    assert len(solutions(parallel, image_of(parallel, pose).image_lines)[0]) == 0


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
    rotation, translation, gain, final = _core.refine_poses(*scene, weight, *starts, 40)
    assert (final == 1.0).all()
    assert (gain < 1e-4).all()
    solution = least_squares(
        lambda motion: (residuals(scene, pose.integrate(motion, 1.0))[0, 2:4] * weight[0]).ravel(), np.zeros(6)
    )
    expected = pose.integrate(solution.x, 1.0)
    for i in range(2):
        assert distance(pose_of(rotation[i], translation[i]), expected) < 1e-6


def test_without_iterations_nothing_moves():
    lines, pose = random_view(np.random.default_rng(1), 4)
    scene = known(lines, image_of(lines, pose).image_lines)
    rotation, _, gain, final = _core.refine_poses(*scene, np.ones((1, 4)), *arrays(pose), 0)
    np.testing.assert_array_equal(rotation[0], pose.rotation.T)
    assert (gain[0], final[0]) == (np.inf, 0.0)


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
    inverse = np.linalg.inv(covariances(lines, pose, noise))
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


FOUR = np.ones((4, 6)), np.ones((4, 3)), np.ones(4)
POSES = np.ones((2, 3, 3)), np.ones((2, 3))


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("image_residuals", (np.ones((3, 6)), *FOUR[1:], *POSES)),
        ("image_residuals", (np.ones((0, 6)), np.ones((0, 3)), np.ones(4), *POSES)),
        ("image_residuals", (*FOUR[:2], np.ones(3), *POSES)),
        ("image_jacobians", (*FOUR, np.ones((2, 9)), POSES[1])),
        ("refine_poses", (*FOUR, np.ones((2, 3)), *POSES, 3)),
        ("search_poses", (*FOUR, POSES[0], np.ones((3, 3)), COSTS)),
        ("search_poses", (*FOUR, *POSES, np.ones(3))),
        ("cheapest_different", (POSES[0], np.ones(3), 2)),
        ("translations", (POSES[0], np.ones((4, 3)), np.ones((5, 3)))),
        ("translations", (POSES[0], np.ones((0, 3)), np.ones((0, 3)))),
        ("pose_uncertainty", (*FOUR, np.eye(3), np.ones(3), np.ones(5))),
        ("triplet_rotations", (np.ones((2, 3, 3)), np.ones((3, 3, 3)))),
        ("same_pose", (np.eye(3), np.ones(3), np.eye(3), np.ones(2), 1e-3)),
    ],
)
def test_arrays_that_do_not_fit_are_refused(name, arguments):
    with pytest.raises(ValueError, match="must be"):
        getattr(_core, name)(*arguments)
