# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from messages import mentions
from pose_scenes import distance, image_of, observation, random_view, views
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from strategies import numbers

from paper.pose_quadrifolium import EXPERIMENTS
from plsing_ros.errors import ObservationError, ParameterError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import EstimationParameters, PoseEstimatorParameters
from plsing_ros.pose import PoseEstimator, Verdict, lift_lines
from plsing_ros.simulation.simulated_camera import noisy_lines
from plsing_ros.singularities import singular_set

PAPER = LineSet.from_points_directions(
    [[0, 0, 0], [0, 0, 2], [3, 5, 0], [0, 1, 7]], [[1, 0, 0], [4, -5, 0], [3, 7, 3], [-2, 1, 13]]
)
AWAY = Pose.look_at((5.0, 2.0, 3.0), (0.0, 0.0, 0.0))


def finite(estimate):
    parts = [
        estimate.covariance,
        estimate.least_observable_direction,
        estimate.position_deviation,
        estimate.rotation_deviation,
    ]
    parts += [estimate.nonlinearity, estimate.inverse_condition_number, estimate.least_observable_standard_deviation]
    parts += [estimate.residual, [each.likelihood_ratio for each in estimate.alternatives]]
    if estimate.nearest is not None:
        parts += [estimate.nearest.distance, estimate.nearest.closest_point]
    return all(np.isfinite(np.asarray(part, dtype=float)).all() for part in parts)


@settings(max_examples=50)
@given(view=views(4, 7))
def test_an_exact_image_gives_the_exact_pose(view):
    lines, pose = view
    estimate = PoseEstimator(lines).estimate(image_of(lines, pose))
    found = [estimate.T_world_camera, *(each.T_world_camera for each in estimate.alternatives)]
    assert min(distance(each, pose) for each in found) < 1e-6
    if estimate.verdict is Verdict.OK:
        assert distance(estimate.T_world_camera, pose) < 1e-6
        assert estimate.used_ids == lines.ids
    assert finite(estimate)


@settings(max_examples=50)
@given(view=views(3, 3))
def test_three_lines_give_the_pose_among_the_alternatives_and_the_last_pose_chooses(view):
    lines, pose = view
    estimator, seen = PoseEstimator(lines), image_of(lines, pose)
    estimate = estimator.estimate(seen)
    found = [estimate.T_world_camera, *(each.T_world_camera for each in estimate.alternatives)]
    assert min(distance(each, pose) for each in found) < 1e-5
    assert (estimate.verdict is Verdict.AMBIGUOUS) == (len(estimate.alternatives) > 0)
    assert estimate.residual == 0.0
    last = estimator.estimate(seen, pose.integrate([1e-3, -1e-3, 1e-3, 1e-3, 0.0, -1e-3], 1.0))
    assert distance(last.T_world_camera, pose) < 1e-5
    assert all(0.0 <= each.likelihood_ratio <= 1.0 for each in last.alternatives)


@pytest.mark.parametrize("seed", range(6))
def test_backends_agree(seed):
    pytest.importorskip("poselib", reason="PoseLib has wheels for x86-64 only")
    generator = np.random.default_rng(seed)
    lines, pose = random_view(generator, 5)
    seen = image_of(lines, pose, 1e-3, generator)
    ours, theirs = (
        PoseEstimator(lines, EstimationParameters(backend=backend)).estimate(seen) for backend in ("numpy", "poselib")
    )
    assert distance(ours.T_world_camera, theirs.T_world_camera) < 1e-6
    assert ours.verdict is theirs.verdict


@pytest.mark.parametrize(
    "noise", [{"noise_image": 1e-3}, {"noise_image": 0.0, "noise_scene": 1e-4}], ids=["image", "scene"]
)
def test_covariance_matches_the_errors_away_from_the_loci(noise):
    generator = np.random.default_rng(5)
    count, total = 150, 0.0
    settings_ = EstimationParameters(**noise)
    for _ in range(count):
        if "noise_scene" in noise:
            direction = PAPER.direction + generator.normal(scale=1e-4, size=(4, 3))
            moment = PAPER.moment + generator.normal(scale=1e-4, size=(4, 3))
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
            moment -= np.einsum("ij,ij->i", moment, direction)[:, np.newaxis] * direction
            known, seen = LineSet(direction, moment, "world"), image_of(PAPER, AWAY)
        else:
            known, seen = PAPER, image_of(PAPER, AWAY, noise["noise_image"], generator)
        estimate = PoseEstimator(known, settings_).estimate(seen)
        assert estimate.covariance_trusted
        turn = Rotation.from_matrix(AWAY.rotation @ estimate.T_world_camera.rotation.T).as_rotvec()
        error = np.concatenate([AWAY.translation - estimate.T_world_camera.translation, turn])
        total += error @ np.linalg.solve(estimate.covariance, error)
    assert chi2.ppf(0.0005, 6 * count) < total < chi2.ppf(0.9995, 6 * count)


def test_covariance_has_the_frame_and_order_that_ros_defines():
    estimate = PoseEstimator(PAPER).estimate(image_of(PAPER, AWAY))
    R = estimate.T_world_camera.rotation
    weak = np.concatenate([R @ estimate.least_observable_direction[:3], R @ estimate.least_observable_direction[3:]])
    deviation = np.sqrt(weak @ estimate.covariance @ weak)
    assert deviation == pytest.approx(estimate.least_observable_standard_deviation)
    assert deviation**2 == pytest.approx(np.linalg.eigvalsh(estimate.covariance)[-1])
    np.testing.assert_allclose(estimate.covariance, estimate.covariance.T)


@pytest.mark.parametrize("offset", [0.0, 1e-4, 3e-3])
@pytest.mark.parametrize("center", [(0.7809, -2.024, 3.50), (-9.858, -2.473, -1.841)], ids=["L_M", "P1"])
def test_on_a_locus_nothing_is_presented_as_ok(center, offset):
    generator = np.random.default_rng(7)
    closest = singular_set(PAPER).distances(center)[0].closest_point
    pose = Pose(Pose.look_at(center, (0, 0, 0)).rotation, closest + offset * np.array([0.6, 0.0, 0.8]))
    estimator = PoseEstimator(PAPER, EstimationParameters(noise_image=2e-4))
    for _ in range(8):
        estimate = estimator.estimate(image_of(PAPER, pose, 2e-4, generator))
        assert estimate.verdict is not Verdict.OK
        assert estimate.reason
        assert finite(estimate)


def test_a_pose_next_to_a_line_that_explains_the_image_by_its_covariance_alone_is_not_taken():
    # On L_M of five lines, refinement without the determinant of the covariance ends 1 mm from the fifth line.
    experiment, generator = EXPERIMENTS[3], np.random.default_rng(1)
    pose = experiment.poses(401)[50]
    known = [noisy_lines(experiment.scene, experiment.noise, generator) for _ in range(51)][-1]
    settings_ = EstimationParameters(noise_image=0.0, noise_scene=experiment.noise)
    estimate = PoseEstimator(known, settings_).estimate(image_of(experiment.scene, pose))
    assert estimate.verdict is not Verdict.OK
    seen = known.transformed(estimate.T_world_camera.inverse(), "camera")
    assert np.linalg.norm(seen.moment, axis=1).min() > 0.1


@pytest.mark.parametrize(("n", "row"), [(4, 0), (4, 3), (5, 2), (7, 6)])
def test_a_reversed_line_is_used_and_named(n, row):
    lines, pose = random_view(np.random.default_rng(n + row), n)
    image = image_of(lines, pose).image_lines.copy()
    image[row] *= -1.0
    estimate = PoseEstimator(lines).estimate(observation(lines, image))
    assert distance(estimate.T_world_camera, pose) < 1e-6
    assert estimate.reversed_ids == (lines.ids[row],)
    assert estimate.outlier_ids == ()


@pytest.mark.parametrize("wrong", [(1,), (0, 4), (2, 3, 7)])
def test_wrong_matches_are_left_out(wrong):
    generator = np.random.default_rng(31)
    lines, pose = random_view(generator, 9)
    image = image_of(lines, pose, 1e-3, generator).image_lines.copy()
    image[list(wrong)] = image[np.roll(list(wrong), 1)] if len(wrong) > 1 else [0.6, 0.8, 1.3]
    estimate = PoseEstimator(lines).estimate(observation(lines, image))
    assert estimate.outlier_ids == tuple(lines.ids[i] for i in wrong)
    assert set(estimate.used_ids) == set(lines.ids) - set(estimate.outlier_ids)
    assert distance(estimate.T_world_camera, pose) < 0.02


def test_a_wrong_match_among_four_lines_is_not_presented_as_ok():
    lines, pose = random_view(np.random.default_rng(12), 4)
    image = image_of(lines, pose).image_lines.copy()
    image[2] = [0.6, -0.8, 0.9]
    estimate = PoseEstimator(lines).estimate(observation(lines, image))
    assert estimate.verdict is not Verdict.OK


def test_lines_out_of_sight_are_not_used():
    lines, pose = random_view(np.random.default_rng(2), 6)
    image = image_of(lines, pose).image_lines.copy()
    usable = np.array([True, True, False, True, True, True])
    image[2] = 0.0
    estimate = PoseEstimator(lines).estimate(observation(lines, image, usable))
    assert distance(estimate.T_world_camera, pose) < 1e-6
    assert estimate.used_ids == tuple(i for i, use in zip(lines.ids, usable, strict=True) if use)


def test_fewer_than_three_lines_fail_with_a_reason():
    seen = image_of(PAPER, AWAY)
    usable = np.array([True, False, True, False])
    estimate = PoseEstimator(PAPER).estimate(observation(PAPER, seen.image_lines, usable))
    assert estimate.verdict is Verdict.FAILED
    assert estimate.T_world_camera is None
    assert mentions(estimate.reason, "2 usable")


@pytest.mark.parametrize(
    ("points", "directions"),
    [
        ([[0, 0, 0], [1, 2, 0], [0, 1, 1], [2, 0, 3]], [[0, 0, 1]] * 4),
        ([[1, 1, 1]] * 4, [[1, 0, 0], [0, 1, 0], [0, 0.6, 0.8], [1, 1, 1]]),
    ],
    ids=["parallel", "concurrent"],
)
def test_scenes_that_fix_no_pose_fail(points, directions):
    lines = LineSet.from_points_directions(points, directions)
    pose = Pose.look_at((4.0, -3.0, 2.0), (0.1, 0.2, -0.1))
    estimate = PoseEstimator(lines).estimate(image_of(lines, pose))
    assert estimate.verdict is not Verdict.OK
    assert finite(estimate)


def test_an_unknown_line_is_refused():
    seen = image_of(PAPER, AWAY)
    other = LineObservation((1, 2, 3, 9), seen.image_lines, seen.usable, None)
    with pytest.raises(ObservationError, match=r"\bid 9\b.*scene"):
        PoseEstimator(PAPER).estimate(other)


@settings(max_examples=60)
@given(
    angles=st.lists(numbers(-3.1, 3.1), min_size=6, max_size=6),
    offsets=st.lists(numbers(-1e3, 1e3), min_size=6, max_size=6),
    count=st.integers(3, 6),
    seed=st.integers(0, 3),
)
def test_whatever_is_seen_the_answer_is_finite(angles, offsets, count, seed):
    lines, _ = random_view(np.random.default_rng(seed), count)
    image = np.stack([np.cos(angles), np.sin(angles), offsets], axis=1)[:count]
    estimate = PoseEstimator(lines).estimate(observation(lines, image))
    assert finite(estimate)
    assert (estimate.T_world_camera is None) == (estimate.verdict is Verdict.FAILED)
    assert bool(estimate.reason) == (estimate.verdict is not Verdict.OK)


def test_lines_seen_anywhere_are_not_presented_as_ok():
    generator = np.random.default_rng(3)
    for _ in range(25):
        lines, _ = random_view(generator, 6)
        angle = generator.uniform(-np.pi, np.pi, 6)
        image = np.stack([np.cos(angle), np.sin(angle), generator.normal(size=6)], axis=1)
        assert PoseEstimator(lines).estimate(observation(lines, image)).verdict is not Verdict.OK


def test_completed_lines_are_those_of_the_pose():
    lines, pose = random_view(np.random.default_rng(9), 7)
    seen = image_of(lines, pose)
    image = seen.image_lines.copy()
    image[1] *= -1.0
    image[4] = [0.6, 0.8, -1.7]
    covariances = np.tile([1e-4, 5e-5, 2e-4], (7, 1))
    ends = np.arange(28.0).reshape(7, 4)
    shown = replace(observation(lines, image), covariances=covariances, ends=ends)
    estimate = PoseEstimator(lines).estimate(shown)
    completed = lift_lines(lines, estimate, shown)
    assert completed.usable_ids == (1, 2, 3, 4, 6, 7)
    # What the tracker said of the lines goes with them; line 2 is turned round, and its offset with it.
    np.testing.assert_array_equal(completed.ends, ends)
    np.testing.assert_array_equal(completed.covariances[[0, 2]], covariances[[0, 2]])
    np.testing.assert_array_equal(completed.covariances[1], covariances[1] * [1, -1, 1])
    np.testing.assert_allclose(completed.usable_image_lines, seen.image_lines[[0, 1, 2, 3, 5, 6]])
    true = lines.select([0, 1, 2, 3, 5, 6]).transformed(pose.inverse(), "camera")
    np.testing.assert_allclose(completed.lines_camera.direction, true.direction, atol=1e-6)
    np.testing.assert_allclose(completed.lines_camera.moment, true.moment, atol=1e-5)


def test_nothing_is_lifted_by_a_pose_that_rests_on_no_line_of_the_image():
    """As of a filter that dead-reckons: the pose is known, and every line of the image was left out."""
    seen = image_of(PAPER, AWAY)
    estimate = replace(PoseEstimator(PAPER).estimate(seen), used_ids=())
    completed = lift_lines(PAPER, estimate, seen)
    assert completed.usable_ids == () and completed.lines_camera is None


def test_without_a_pose_nothing_is_completed():
    seen = observation(PAPER, image_of(PAPER, AWAY).image_lines, np.zeros(4, dtype=bool))
    with pytest.raises(ObservationError, match="pose"):
        lift_lines(PAPER, PoseEstimator(PAPER).estimate(seen), seen)


def test_parameters_without_noise_or_with_two_lines_are_refused():
    with pytest.raises(ParameterError, match=r"noise.*\b0\b"):
        EstimationParameters(noise_image=0.0)
    with pytest.raises(ParameterError, match="failed.residual"):
        EstimationParameters(failed_residual=2.0)
    with pytest.raises(ParameterError, match="2 line"):
        PoseEstimatorParameters(lines_points=(0.0,) * 6, lines_directions=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0))


def test_more_noise_than_stated_is_noticed():
    generator = np.random.default_rng(1)
    lines, pose = random_view(generator, 4)
    estimator = PoseEstimator(lines, EstimationParameters(noise_image=1e-4))
    residuals = [estimator.estimate(image_of(lines, pose, 2e-3, generator)).residual for _ in range(10)]
    assert np.sqrt(np.mean(np.square(residuals))) == pytest.approx(20.0, rel=0.6)


def test_lines_of_one_plane_need_a_field_of_view():
    door = LineSet.from_points_directions(
        [[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 2]], [[0, 0, 1], [0, 0, 1], [1, 0, 0], [1, 0, 0]]
    )
    pose = Pose.look_at((2.0, -3.0, 1.5), (0.5, 0.0, 1.0))
    seen = image_of(door, pose)
    estimate = PoseEstimator(door).estimate(seen)
    assert estimate.verdict is Verdict.AMBIGUOUS
    # A camera mirrored in the plane, with the door behind it, sees the same infinite lines.
    found = [estimate.T_world_camera, estimate.alternatives[0].T_world_camera]
    mirrored = pose.translation * (1.0, -1.0, 1.0)
    for center in (pose.translation, mirrored):
        assert min(np.abs(each.translation - center).max() for each in found) < 1e-6
    narrow = PoseEstimator(door, EstimationParameters(max_angle=0.6)).estimate(seen)
    assert narrow.verdict is Verdict.OK
    assert distance(narrow.T_world_camera, pose) < 1e-6
