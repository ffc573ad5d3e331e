"""The kernels that estimate poses, compiled and of numpy, each against the definition or a library."""

import numpy as np
import pytest
from hypothesis import given, settings
from pose_scenes import distance, image_of, random_view, views
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from strategies import twists

from plsing_ros import kernels
from plsing_ros.features import interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.kernels import compiled, of_numpy
from plsing_ros.kernels.residuals import RESIDUAL_ROWS
from plsing_ros.kernels.search import FOUND_COLUMNS, MOST_FOUND
from plsing_ros.kernels.triplets import SAMPLING
from plsing_ros.parameters import EstimationParameters
from plsing_ros.pose import PoseEstimator
from plsing_ros.pose.minimal_solver import TripletDirections

BOTH = pytest.mark.parametrize("the", [compiled, of_numpy], ids=["compiled", "numpy"])
IMAGE, SCENE, ALL = (1e-3, 0.0, 0.0), (0.0, 1e-4, 0.0), (2e-3, 1e-3, 3e-3)
COSTS = np.array([20.0, 12.0])


def known(lines, image, noise=IMAGE, least_cosine=0.0):
    return np.hstack([lines.direction, lines.moment]), image, np.array([*noise, least_cosine])


def arrays(*poses):
    """Rotations and translations of T_camera_world."""
    inverse = [pose.inverse() for pose in poses]
    return np.array([each.rotation for each in inverse]), np.array([each.translation for each in inverse])


def pose_of(rotation, translation):
    return Pose(rotation.T, -rotation.T @ translation)


def tabled(the, scene, *poses):
    table = np.empty((len(poses), RESIDUAL_ROWS, len(scene[0])))
    the.image_residuals(*scene, *arrays(*poses), table)
    return table


def uncertain(the, scene, pose, weight):
    rotation, translation = arrays(pose)
    deviation, axes, covariance, figures = np.empty(6), np.empty((6, 6)), np.empty((6, 6)), np.empty(5)
    good = the.pose_uncertainty(*scene, rotation[0], translation[0], weight, deviation, axes, covariance, figures)
    return good, deviation, axes, covariance, figures


def solutions(the, lines, image):
    normals = image / np.linalg.norm(image, axis=1, keepdims=True)
    triplets = TripletDirections.of(lines.direction, np.array([[0, 1, 2]]))
    rotation, triplet, degenerate = np.empty((8, 3, 3)), np.empty(8), np.empty(1)
    count = the.triplet_rotations(
        triplets.frame, triplets.others, normals[triplets.rows], SAMPLING, rotation, triplet, degenerate
    )
    assert (triplet[:count] == 0.0).all()
    return rotation[:count], bool(degenerate[0])


@BOTH
@settings(max_examples=30)
@given(view=views(), twist=twists())
def test_residuals_are_differences_of_projections_and_jacobians_their_derivatives(the, view, twist):
    lines, pose = view
    image = image_of(lines, pose.moved(0.01 * twist, 1.0)).image_lines
    step = 1e-6
    table = tabled(the, known(lines, image), pose, pose.moved(twist, step), pose.moved(twist, -step))
    line = project_lines(lines.transformed(pose.inverse(), "camera")).reshape(-1, 3)
    against = np.einsum("ij,ij->i", line[:, :2], image[:, :2]) < 0.0
    line[against] *= -1.0
    turn = np.arctan2(line[:, 1], line[:, 0]) - np.arctan2(image[:, 1], image[:, 0])
    np.testing.assert_allclose(np.exp(1j * table[0, 0]), np.exp(1j * turn), atol=1e-9)
    np.testing.assert_allclose(table[0, 1], line[:, 2] - image[:, 2], atol=1e-9 * (1.0 + np.abs(line[:, 2]).max()))
    assert ((table[0, 12] > 0.0) == against).all()
    raw, value = np.empty((3, 2, len(lines), 6)), np.empty((3, 2, len(lines), 6))
    the.image_jacobians(table, raw, value)
    expected = (table[1, :2] - table[2, :2]) / (2.0 * step)
    np.testing.assert_allclose(raw[0] @ twist, expected, atol=1e-4 * (1.0 + np.abs(expected).max()))
    np.testing.assert_allclose(value, raw * 1e3)


@settings(max_examples=30)
@given(view=views(), twist=twists())
def test_both_tables_are_the_same(view, twist):
    lines, pose = view
    image = image_of(lines, pose.moved(0.01 * twist, 1.0)).image_lines
    for noise in (IMAGE, SCENE, ALL):
        tables = [tabled(the, known(lines, image, noise, 0.5), pose) for the in (compiled, of_numpy)]
        np.testing.assert_allclose(*tables, rtol=1e-8, atol=1e-9)


@BOTH
@settings(max_examples=40)
@given(view=views(3, 3))
def test_the_rotation_is_among_those_of_three_lines(the, view):
    lines, pose = view
    rotation, degenerate = solutions(the, lines, image_of(lines, pose).image_lines)
    assert not degenerate
    np.testing.assert_allclose(
        rotation @ rotation.transpose(0, 2, 1), np.broadcast_to(np.eye(3), rotation.shape), atol=1e-12
    )
    # Near a double solution, the root of rounding is left.
    assert np.abs(rotation - pose.rotation.T).max(axis=(1, 2)).min() < 1e-5


@pytest.mark.parametrize("seed", range(20))
def test_both_find_the_same_rotations(seed):
    lines, pose = random_view(np.random.default_rng(seed), 3)
    image = image_of(lines, pose).image_lines
    (ours, _), (theirs, _) = (solutions(the, lines, image) for the in (compiled, of_numpy))
    assert len(ours) == len(theirs)
    for each in ours:
        assert np.abs(theirs - each).max(axis=(1, 2)).min() < 1e-6


@BOTH
def test_rotations_of_many_triplets_are_those_of_each(the):
    lines, pose = random_view(np.random.default_rng(2), 5)
    image = image_of(lines, pose).image_lines
    rows = np.array([[0, 1, 2], [1, 2, 4], [0, 3, 4]])
    triplets = TripletDirections.of(lines.direction, rows)
    normals = image / np.linalg.norm(image, axis=1, keepdims=True)
    rotation, triplet, degenerate = np.empty((24, 3, 3)), np.empty(24), np.empty(3)
    count = the.triplet_rotations(
        triplets.frame, triplets.others, normals[triplets.rows], SAMPLING, rotation, triplet, degenerate
    )
    expected = [solutions(the, lines.select(list(row)), image[row])[0] for row in rows]
    np.testing.assert_array_equal(triplet[:count], np.repeat([0.0, 1.0, 2.0], [len(each) for each in expected]))
    np.testing.assert_allclose(rotation[:count], np.concatenate(expected), atol=1e-12)


@BOTH
def test_concurrent_lines_have_double_roots_and_no_solution(the):
    lines = LineSet.from_points_directions([[1, 1, 1]] * 3, [[1, 0, 0], [0, 1, 0], [0, 0.6, 0.8]])
    pose = Pose.looking_at((4.0, -3.0, 2.0), (0.1, 0.2, -0.1))
    rotation, degenerate = solutions(the, lines, image_of(lines, pose).image_lines)
    assert not degenerate
    assert len(rotation) == 0


@BOTH
def test_planes_that_coincide_leave_a_continuum(the):
    lines = LineSet.from_points_directions([[0, 0, 0], [2, 0, 0], [0, 1, 0]], [[1, 0.2, 0], [0.1, 1, 0], [1, -1, 0]])
    rotation, degenerate = solutions(the, lines, np.array([[0.0, 1.0, 0.0]] * 3))
    assert degenerate
    assert len(rotation) == 0


@BOTH
def test_three_parallel_lines_have_no_rotation(the):
    lines = LineSet.from_points_directions([[0, 0, 0], [1, 2, 0], [0, 1, 1]], [[0, 0, 1]] * 3)
    pose = Pose.looking_at((4.0, -3.0, 2.0), (0.1, 0.2, -0.1))
    assert len(solutions(the, lines, image_of(lines, pose).image_lines)[0]) == 0


@BOTH
@pytest.mark.parametrize("n", [3, 4, 9])
def test_translations_are_those_of_least_squares(the, n):
    generator = np.random.default_rng(n)
    normals, points = generator.normal(size=(n, 3)), generator.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rotation, t = Rotation.random(5, generator).as_matrix(), np.empty((5, 3))
    the.translations(rotation, normals, points, t)
    for R, found in zip(rotation, t, strict=True):
        expected = np.linalg.lstsq(normals, -np.einsum("ij,ij->i", normals, points @ R.T), rcond=None)[0]
        np.testing.assert_allclose(found, expected, atol=1e-10)


@BOTH
def test_translations_are_zero_where_nothing_is_left_of_a_direction(the):
    normals, t = np.array([[8.0, 8.0, 0.0]]), np.empty((1, 3))
    the.translations(np.eye(3)[np.newaxis], normals, np.ones((1, 3)), t)
    np.testing.assert_array_equal(t, 0.0)


@BOTH
@pytest.mark.parametrize("wrong", [False, True])
def test_refinement_ends_at_the_minimum_that_scipy_finds(the, wrong):
    generator = np.random.default_rng(6)
    lines, pose = random_view(generator, 6)
    image = image_of(lines, pose, 1e-3, generator).image_lines.copy()
    weight = np.ones((2, 6))
    if wrong:
        image[2], weight[:, 2] = [0.6, 0.8, -1.7], 0.0
    scene = known(lines, image)
    starts = [pose.moved(generator.normal(scale=0.03, size=6), 1.0) for _ in range(2)]
    rotation, translation = arrays(*starts)
    gain, final = np.empty(2), np.empty(2)
    the.refine_poses(*scene, weight, rotation, translation, gain, final, 40)
    assert (final == 1.0).all()
    assert (gain < 1e-4).all()
    solution = least_squares(
        lambda motion: (tabled(of_numpy, scene, pose.moved(motion, 1.0))[0, 2:4] * weight[0]).ravel(), np.zeros(6)
    )
    expected = pose.moved(solution.x, 1.0)
    for i in range(2):
        assert distance(pose_of(rotation[i], translation[i]), expected) < 1e-6


@BOTH
def test_without_iterations_nothing_moves(the):
    lines, pose = random_view(np.random.default_rng(1), 4)
    rotation, translation = arrays(pose)
    gain, final = np.empty(1), np.empty(1)
    scene = known(lines, image_of(lines, pose).image_lines)
    the.refine_poses(*scene, np.ones((1, 4)), rotation, translation, gain, final, 0)
    np.testing.assert_array_equal(rotation[0], pose.rotation.T)
    assert gain[0] == np.inf
    assert final[0] == 0.0


@BOTH
def test_the_search_finds_the_pose_once_and_says_where_from(the):
    generator = np.random.default_rng(3)
    lines, pose = random_view(generator, 5)
    scene = known(lines, image_of(lines, pose).image_lines)
    far = [Pose.looking_at(generator.normal(scale=4.0, size=3), (0.0, 0.0, 0.0)) for _ in range(30)]
    near = [pose.moved(generator.normal(scale=0.02, size=6), 1.0) for _ in range(3)]
    rotation, translation = arrays(*far, *near)
    found = np.full((MOST_FOUND, FOUND_COLUMNS), np.nan)
    count = the.search_poses(*scene, rotation, translation, COSTS, found)
    assert 1 <= count <= MOST_FOUND
    found = found[:count]
    poses = [pose_of(row[:9].reshape(3, 3), row[9:12]) for row in found]
    assert distance(poses[0], pose) < 1e-6
    assert found[0, 13] >= 30
    # Image noise alone: the determinant of each line's covariance is sigma^4.
    assert found[0, 12] == pytest.approx(5 * 4 * np.log(1e-3), abs=1e-6)
    assert (np.diff(found[:, 12]) >= -1e-3).all()
    assert all(distance(first, second) > 1e-4 for i, first in enumerate(poses) for second in poses[:i])


@BOTH
def test_the_search_among_none_or_what_is_no_number_finds_none(the):
    lines, pose = random_view(np.random.default_rng(3), 4)
    scene = known(lines, image_of(lines, pose).image_lines)
    found = np.empty((MOST_FOUND, FOUND_COLUMNS))
    assert the.search_poses(*scene, np.empty((0, 3, 3)), np.empty((0, 3)), COSTS, found) == 0
    with np.errstate(all="ignore"):
        assert the.search_poses(*scene, np.full((2, 3, 3), np.nan), np.zeros((2, 3)), COSTS, found) == 0


@BOTH
@pytest.mark.parametrize("noise", [IMAGE, SCENE, ALL], ids=["image", "scene", "all"])
def test_the_covariance_is_that_of_central_differences_in_the_world(the, noise):
    lines, pose = random_view(np.random.default_rng(8), 5)
    image = image_of(lines, pose.moved(np.full(6, 1e-5), 1.0)).image_lines
    scene = known(lines, image, noise)
    weight = np.array([1.0, 1.0, 0.0, 1.0, 1.0])
    good, deviation, axes, covariance, figures = uncertain(the, scene, pose, weight)
    assert good
    whitening, step, columns = tabled(of_numpy, scene, pose)[0, 4:7], 1e-6, []
    for axis in np.eye(6):
        ends = [
            Pose(Rotation.from_rotvec(s * axis[3:]).as_matrix() @ pose.rotation, pose.translation + s * axis[:3])
            for s in (step, -step)
        ]
        table = tabled(of_numpy, scene, *ends)
        angle, offset = (table[0, :2] - table[1, :2]) / (2.0 * step)
        columns.append(np.concatenate([whitening[0] * angle, whitening[1] * angle + whitening[2] * offset]))
    jacobian = np.stack(columns, axis=1) * np.tile(weight, 2)[:, np.newaxis]
    np.testing.assert_allclose(covariance @ jacobian.T @ jacobian, np.eye(6), atol=1e-5)
    assert figures[0] ** 2 == pytest.approx(np.linalg.eigvalsh(covariance[:3, :3])[-1])
    assert figures[1] ** 2 == pytest.approx(np.linalg.eigvalsh(covariance[3:, 3:])[-1])
    np.testing.assert_allclose(axes @ axes.T, np.eye(6), atol=1e-12)
    assert (np.diff(deviation) <= 0.0).all()
    assert deviation[0] ** 2 == pytest.approx(np.linalg.eigvalsh(covariance)[-1])
    matrix = interaction_matrix(lines.select([0, 1, 3, 4]).transformed(pose.inverse(), "camera"))
    size = np.linalg.svd(matrix, compute_uv=False)
    assert figures[3] == pytest.approx(size[-1] / size[0])
    assert figures[4] == pytest.approx(((tabled(of_numpy, scene, pose)[0, 2:4] ** 2) @ weight).sum())


@BOTH
@pytest.mark.parametrize(("noise", "linear"), [(1e-6, True), (0.05, False)])
def test_nonlinearity_is_how_far_the_misfit_is_from_a_quadratic(the, noise, linear):
    lines, pose = random_view(np.random.default_rng(8), 4)
    scene = known(lines, image_of(lines, pose).image_lines, (noise, 0.0, 0.0))
    _, deviation, axes, _, figures = uncertain(the, scene, pose, np.ones(4))
    changes = []
    for i in range(2):
        for sign in (2.0, -2.0):
            motion = sign * deviation[i] * axes[i]
            # By Cayley's rotation, of which only the angle differs from that of the exponential.
            angle = np.linalg.norm(motion[3:])
            cayley = motion[3:] / angle * 2.0 * np.arctan(angle / 2.0)
            moved = Pose(
                pose.rotation @ Rotation.from_rotvec(cayley).as_matrix(), pose.translation + pose.rotation @ motion[:3]
            )
            changes.append((tabled(of_numpy, scene, moved)[0, 2:4] ** 2).sum() / 4.0)
    assert figures[2] == pytest.approx(np.abs(np.array(changes) - 1.0).max(), rel=1e-3, abs=1e-6)
    assert (figures[2] < 0.01) == linear


@BOTH
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("row", [0, 3])
def test_a_misfit_that_is_not_finite_is_no_quadratic(the, row, value):
    lines, pose = random_view(np.random.default_rng(8), 4)
    image = image_of(lines, pose).image_lines.copy()
    image[row, 2] = value
    with np.errstate(invalid="ignore"):
        good, *_, figures = uncertain(the, known(lines, image), pose, np.ones(4))
    assert good
    assert figures[2] == 1e6


@BOTH
def test_poses_that_are_not_determined_have_no_uncertainty(the):
    lines = LineSet.from_points_directions([[0, 0, 0], [1, 2, 0], [0, 1, 1], [2, 0, 3]], [[0, 0, 1]] * 4)
    pose = Pose.looking_at((4.0, -3.0, 2.0), (0.1, 0.2, -0.1))
    scene = known(lines, image_of(lines, pose).image_lines)
    assert not uncertain(the, scene, pose, np.ones(4))[0]
    assert not uncertain(the, scene, pose, np.zeros(4))[0]


@pytest.mark.parametrize("noise", [{"noise_image": 1e-3}, {"noise_image": 0.0, "noise_scene": 1e-4}])
@pytest.mark.parametrize(("n", "wrong"), [(3, ()), (4, ()), (6, (1,)), (9, (0, 4, 5))])
def test_estimates_are_the_same_without_a_compiler(monkeypatch, n, wrong, noise):
    generator = np.random.default_rng(n)
    lines, pose = random_view(generator, n)
    seen = image_of(lines, pose, 1e-3 if noise["noise_image"] else 1e-5, generator)
    for row in wrong:
        seen.image_lines.setflags(write=True)
        seen.image_lines[row] = [0.6, 0.8, -1.7]
    estimator = PoseEstimator(lines, EstimationParameters(**noise))
    ours = estimator.estimate(seen)
    for name in kernels.__all__:
        monkeypatch.setattr(kernels, name, getattr(of_numpy, name))
    theirs = estimator.estimate(seen)
    assert ours.verdict is theirs.verdict
    assert ours.outlier_ids == theirs.outlier_ids == tuple(lines.ids[i] for i in wrong)
    assert distance(ours.T_world_camera, theirs.T_world_camera) < 1e-6
    np.testing.assert_allclose(ours.covariance, theirs.covariance, atol=1e-5 * np.abs(theirs.covariance).max())
    assert [each.plausibility for each in ours.alternatives] == pytest.approx(
        [each.plausibility for each in theirs.alternatives], rel=1e-3
    )


@BOTH
def test_two_lines_determine_no_pose(the):
    lines, pose = random_view(np.random.default_rng(8), 2)
    assert not uncertain(the, known(lines, image_of(lines, pose).image_lines), pose, np.ones(2))[0]


SCENE_ARRAYS = np.ones((4, 6)), np.ones((4, 3)), np.ones(4)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("image_residuals", (*SCENE_ARRAYS, np.ones((2, 3, 3)), np.ones((2, 3)), np.ones((2, RESIDUAL_ROWS - 1, 4)))),
        (
            "image_residuals",
            (np.ones((3, 6)), *SCENE_ARRAYS[1:], np.ones((2, 3, 3)), np.ones((2, 3)), np.ones((2, RESIDUAL_ROWS, 4))),
        ),
        ("image_residuals", (np.ones((0, 6)), np.ones((0, 3)), np.ones(4), np.eye(3), np.ones(3), np.ones(0))),
        ("image_jacobians", (np.ones((2, RESIDUAL_ROWS, 4)), np.ones((2, 2, 4, 6)), np.ones((2, 2, 3, 6)))),
        ("image_jacobians", (np.ones(8 * RESIDUAL_ROWS), np.ones(96), np.ones(96))),
        ("refine_poses", (*SCENE_ARRAYS, np.ones((2, 3)), np.ones((2, 9)), np.ones((2, 3)), np.ones(2), np.ones(2), 3)),
        (
            "search_poses",
            (*SCENE_ARRAYS, np.ones((2, 9)), np.ones((3, 3)), COSTS, np.ones((MOST_FOUND, FOUND_COLUMNS))),
        ),
        (
            "search_poses",
            (*SCENE_ARRAYS, np.ones((2, 9)), np.ones((2, 3)), COSTS, np.ones((MOST_FOUND - 1, FOUND_COLUMNS))),
        ),
        ("translations", (np.ones((2, 9)), np.ones((4, 3)), np.ones((5, 3)), np.ones((2, 3)))),
        ("translations", (np.ones((2, 9)), np.ones((0, 3)), np.ones((0, 3)), np.ones((2, 3)))),
        (
            "pose_uncertainty",
            (*SCENE_ARRAYS, np.eye(3), np.ones(3), np.ones(4), np.ones(6), np.ones(36), np.ones(35), np.ones(5)),
        ),
        (
            "triplet_rotations",
            (
                np.ones((2, 9)),
                np.ones((2, 6)),
                np.ones((2, 9)),
                SAMPLING[1:],
                np.ones((2, 72)),
                np.ones((2, 8)),
                np.ones(2),
            ),
        ),
    ],
)
def test_arrays_that_do_not_fit_are_refused(name, arguments):
    with pytest.raises(ValueError, match="of a size that does not fit|there must be 1 to|lines for"):
        getattr(compiled, name)(*arguments)


@pytest.mark.parametrize(
    "name",
    [
        "image_residuals",
        "image_jacobians",
        "refine_poses",
        "search_poses",
        "translations",
        "pose_uncertainty",
        "triplet_rotations",
    ],
)
def test_wrong_numbers_of_arguments_are_type_errors(name):
    with pytest.raises(TypeError):
        getattr(compiled, name)(np.ones(3))
