# SPDX-License-Identifier: Apache-2.0
"""The pose filter on sequences simulated here, across the paper's transversal and under wrong input."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pose_scenes import image_of, random_view
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from strategies import numbers, twists, vectors

from paper.scenes import four_lines
from plsing_ros import _core
from plsing_ros.errors import GeometryError, ObservationError, ParameterError
from plsing_ros.features import LineObservation, interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import FilterParameters
from plsing_ros.pose import PoseFilter, Verdict, filter_track
from plsing_ros.pose.filter_motion import Agreement
from plsing_ros.pose.twist_history import TwistHistory
from plsing_ros.singularities import singular_set

DT, NOISE = 0.04, 1e-3
LINES = four_lines()
TRANSVERSAL = singular_set(LINES).transversals[0]


def crossing(generator, frames, speed=0.2):
    """Poses of a camera that goes straight across the transversal, and its twist."""
    across = generator.normal(size=3)
    across -= across @ TRANSVERSAL.direction * TRANSVERSAL.direction
    across *= speed / np.linalg.norm(across)
    middle = np.array([0.7809, -2.024, 3.50])
    rotation = Pose.look_at(middle, np.zeros(3), down=generator.normal(size=3)).rotation
    twist = np.concatenate([rotation.T @ across, np.zeros(3)])
    start = Pose(rotation, middle - 0.5 * frames * DT * across)
    return [start.integrate(twist, k * DT) for k in range(frames)], twist


def along_the_unseen_motion(generator, frames, speed=0.1):
    """The same for a camera that goes across the transversal as the image there does not tell."""
    middle = np.array([0.7809, -2.024, 3.50])
    there = Pose.look_at(middle, np.zeros(3), down=generator.normal(size=3))
    unseen = np.linalg.svd(interaction_matrix(LINES.transformed(there.inverse(), "camera")))[2][-1]
    twist = speed / np.linalg.norm(unseen[:3]) * unseen
    start = there.integrate(twist, -0.5 * frames * DT)
    return [start.integrate(twist, k * DT) for k in range(frames)], twist


def off(pose, generator, position=0.01, turn=0.0035):
    rotation = Rotation.from_rotvec(turn * generator.normal(size=3)).as_matrix() @ pose.rotation
    start = Pose(rotation, pose.translation + position * generator.normal(size=3))
    return {"start": start, "start_covariance": np.diag([position**2] * 3 + [turn**2] * 3)}


def error(true, estimate):
    turn = Rotation.from_matrix(true.rotation @ estimate.pose.rotation.T).as_rotvec()
    return np.concatenate([true.translation - estimate.pose.translation, turn])


def squared_error(true, estimate):
    return error(true, estimate) @ np.linalg.solve(estimate.covariance, error(true, estimate))


def position_off_by(true, estimate):
    """How many standard deviations the position is off."""
    off_by = error(true, estimate)[:3]
    return math.sqrt(off_by @ np.linalg.solve(estimate.covariance[:3, :3], off_by))


def follow(pose_filter, poses, twist, generator, first=0):
    """Estimates of frame after frame; the twist given is wrong by 5 % of the speed in each direction."""
    estimates = []
    for k, pose in enumerate(poses, first):
        if k > 0:
            wrong = 0.05 * np.linalg.norm(twist[:3]) * generator.normal(size=3)
            pose_filter.predict(twist + np.concatenate([wrong, np.zeros(3)]), DT)
        estimates.append(pose_filter.update(image_of(LINES, pose, NOISE, generator), k * DT))
    return estimates


def test_across_a_transversal_the_error_is_small_and_what_the_covariance_says():
    runs, frames = 24, 40
    squares, errors = np.zeros((runs, frames)), np.zeros((runs, frames))
    for run in range(runs):
        generator = np.random.default_rng(run)
        poses, twist = crossing(generator, frames)
        pose_filter = PoseFilter(LINES, FilterParameters(noise_image=NOISE), **off(poses[0], generator))
        for k, estimate in enumerate(follow(pose_filter, poses, twist, generator)):
            assert estimate.verdict in (Verdict.OK, Verdict.POOR), estimate.reason
            squares[run, k] = squared_error(poses[k], estimate)
            errors[run, k] = np.linalg.norm(error(poses[k], estimate)[:3])
    assert np.quantile(errors, 0.95) < 0.03
    # Of runs that are independent of each other; beyond that once in a thousand by chance.
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], 6 * runs) / runs
    assert low < squares[:, -1].mean() < high
    assert low < squares.mean() < high


@settings(max_examples=25, deadline=None)
@given(
    shift=vectors(3, -0.02, 0.02),
    turn=vectors(3, -0.01, 0.01),
    position_std=st.sampled_from([0.0, 2e-3]),
    seed=st.integers(0, 50),
)
def test_an_update_is_the_best_estimate_of_pose_and_map_together(shift, turn, position_std, seed):
    generator = np.random.default_rng(seed)
    lines, pose = random_view(generator, 5)
    lines = LineSet.from_points_directions(
        lines.point, lines.direction, position_std=position_std, direction_std=0.5 * position_std
    )
    prior = Pose(Rotation.from_rotvec(turn).as_matrix() @ pose.rotation, pose.translation + shift)
    root = 0.01 * generator.normal(size=(6, 6))
    covariance = root @ root.T + 1e-5 * np.eye(6)
    image = image_of(lines, pose, NOISE, generator)
    state = _core.FilterState(prior.rotation, prior.translation, covariance, np.eye(6), 0 if lines.exact else 5)
    map_lines = _core.FilterMap(lines.direction, lines.pivot, lines.position_std, lines.direction_std)
    rows = np.tile([NOISE**2, 0.0, NOISE**2], (5, 1))
    assert state.update(map_lines, list(range(5)), image.image_lines, rows, [True] * 5, 20).good
    found = Pose(state.rotation, state.position)

    def residual(change):
        """Angles and offsets after a change of the pose found (6) and of the map (four numbers for each line)."""
        there = Pose(Rotation.from_rotvec(change[3:6]).as_matrix() @ found.rotation, found.translation + change[:3])
        number = change[6:].reshape(5, 4)
        across = np.stack([np.linalg.svd(u[np.newaxis])[2][1:] for u in lines.direction])
        points = lines.pivot + lines.position_std[:, np.newaxis] * np.einsum("ni,nij->nj", number[:, :2], across)
        ways = lines.direction + lines.direction_std[:, np.newaxis] * np.einsum("ni,nij->nj", number[:, 2:], across)
        seen = image_of(LineSet.from_points_directions(points, ways), there).image_lines
        sine = image.image_lines[:, 0] * seen[:, 1] - image.image_lines[:, 1] * seen[:, 0]
        return np.concatenate([np.arcsin(sine), seen[:, 2] - image.image_lines[:, 2]])

    step = 1e-6
    slope = np.stack([(residual(step * e) - residual(-step * e)) / (2 * step) for e in np.eye(26)], axis=1)
    noise = NOISE**2 * np.eye(10) + slope[:, 6:] @ slope[:, 6:].T
    information = np.linalg.inv(covariance) + slope[:, :6].T @ np.linalg.solve(noise, slope[:, :6])
    np.testing.assert_allclose(
        state.covariance, np.linalg.inv(information), rtol=0.05, atol=0.01 * np.abs(state.covariance).max()
    )
    # At the best estimate the pull of the image and that of the prior are equal.
    back = np.concatenate(
        [prior.translation - found.translation, Rotation.from_matrix(prior.rotation @ found.rotation.T).as_rotvec()]
    )
    pull = np.linalg.solve(covariance, back) - slope[:, :6].T @ np.linalg.solve(noise, residual(np.zeros(26)))
    assert np.linalg.norm(state.covariance @ pull / np.sqrt(np.diag(state.covariance))) < 0.2


@given(twist=twists(), seed=st.integers(0, 20))
def test_a_prediction_moves_the_pose_and_its_covariance_as_the_motion_does(twist, seed):
    generator = np.random.default_rng(seed)
    rotation, position = Rotation.random(random_state=seed).as_matrix(), generator.normal(size=3)
    root = 1e-3 * generator.normal(size=(6, 6))
    state = _core.FilterState(rotation, position, root @ root.T, np.eye(6), 0)
    state.predict(twist, np.zeros(6), np.zeros((6, 6)), 1.0, DT, 1.0)
    moved = Pose(rotation, position).integrate(twist, DT)
    np.testing.assert_allclose(state.rotation, moved.rotation, atol=1e-12)
    np.testing.assert_allclose(state.position, moved.translation, atol=1e-12)

    def after(change):
        start = Pose(Rotation.from_rotvec(change[3:]).as_matrix() @ rotation, position + change[:3])
        there = start.integrate(twist, DT)
        turn = Rotation.from_matrix(there.rotation @ moved.rotation.T).as_rotvec()
        return np.concatenate([there.translation - moved.translation, turn])

    step = 1e-6
    slope = np.stack([(after(step * e) - after(-step * e)) / (2 * step) for e in np.eye(6)], axis=1)
    np.testing.assert_allclose(state.covariance, slope @ root @ root.T @ slope.T, atol=1e-9)


@pytest.mark.parametrize("scale", [0.5, 0.8, 1.2, 1.5])
def test_a_twist_that_is_too_fast_or_slow_does_not_mislead(scale):
    for seed in range(6):
        generator = np.random.default_rng([seed, round(10 * scale)])
        poses, twist = crossing(generator, 40)
        pose_filter = PoseFilter(LINES, FilterParameters(noise_image=NOISE), **off(poses[0], generator))
        for pose, estimate in zip(poses, follow(pose_filter, poses, scale * twist, generator), strict=True):
            assert estimate.pose is not None and squared_error(pose, estimate) < 36.0


@pytest.mark.parametrize(("share", "frames", "wrong"), [(0.2, 90, 0.01), (0.5, 40, 0.02)])
def test_a_twist_that_is_wrong_anew_in_each_frame_does_not_mislead(share, frames, wrong):
    """A robot that stands still would explain such twists as well, if their mean did not."""
    off_by = []
    for seed in range(12):
        generator = np.random.default_rng([seed, 12])
        poses, twist = along_the_unseen_motion(generator, frames)
        size = np.repeat([np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])], 3)
        pose_filter = PoseFilter(LINES, FilterParameters(noise_image=NOISE), **off(poses[0], generator))
        for k, pose in enumerate(poses):
            if k > 0:
                pose_filter.predict(twist + share * generator.normal(size=6) * size, DT)
            estimate = pose_filter.update(image_of(LINES, pose, NOISE, generator), k * DT)
            if estimate.pose is not None:
                off_by.append(position_off_by(pose, estimate))
    assert np.mean(np.array(off_by) > 5.0) < wrong


def test_a_camera_teleported_beside_a_locus_is_not_taken_for_where_it_was():
    lost = 0
    for seed in range(12):
        generator = np.random.default_rng([seed, 13])
        poses, twist = crossing(generator, 40)
        pose_filter = PoseFilter(LINES, FilterParameters(noise_image=NOISE), **off(poses[0], generator))
        follow(pose_filter, poses[:15], twist, generator)
        shift = generator.normal(size=3)
        there = [Pose(each.rotation, each.translation + 0.5 * shift / np.linalg.norm(shift)) for each in poses[15:]]
        estimates = follow(pose_filter, there, twist, generator, first=15)
        if estimates[0].verdict is Verdict.LOST:
            lost += 1
            assert all(
                e.pose is None or position_off_by(pose, e) < 5.0 for pose, e in zip(there, estimates, strict=True)
            )
    # Images tell nothing of a shift along the transversal.
    assert lost >= 10


def test_from_a_start_that_is_far_off_the_covariance_is_right():
    squares = []
    for seed in range(40):
        generator = np.random.default_rng([seed, 9])
        poses, twist = crossing(generator, 10)
        start = off(poses[0], generator, position=0.115, turn=0.06)
        pose_filter = PoseFilter(LINES, FilterParameters(noise_image=NOISE), **start)
        squares.append(squared_error(poses[-1], follow(pose_filter, poses, twist, generator)[-1]))
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], 6 * len(squares)) / len(squares)
    assert low < np.mean(squares) < high


def test_without_a_start_it_begins_with_an_image_that_can_be_trusted():
    generator = np.random.default_rng(3)
    poses, twist = crossing(generator, 60)
    pose_filter = PoseFilter(LINES, noise={"image": NOISE})
    estimates = follow(pose_filter, poses, twist, generator)
    assert estimates[0].source == "image" and estimates[-1].source == "filter"
    assert estimates[-1].verdict in (Verdict.OK, Verdict.POOR)
    assert squared_error(poses[-1], estimates[-1]) < chi2.isf(1e-4, 6)


def test_a_wrong_line_is_left_out_and_a_reversed_one_is_named():
    generator = np.random.default_rng(5)
    poses, twist = crossing(generator, 20)
    pose_filter = PoseFilter(LINES, FilterParameters(noise_image=NOISE), **off(poses[0], generator))
    follow(pose_filter, poses[:-2], twist, generator)
    image = image_of(LINES, poses[-2], NOISE, generator).image_lines.copy()
    image[1] = 0.6, 0.8, 0.3
    image[2] *= -1.0
    pose_filter.predict(twist, DT)
    estimate = pose_filter.update(LineObservation(LINES.ids, image), 18 * DT)
    assert (estimate.outlier_ids, estimate.reversed_ids) == ((LINES.ids[1],), (LINES.ids[2],))
    assert squared_error(poses[-2], estimate) < chi2.isf(1e-4, 6)


def test_a_repeated_image_and_one_out_of_order_change_nothing():
    generator = np.random.default_rng(6)
    poses, twist = crossing(generator, 10)
    pose_filter = PoseFilter(LINES, FilterParameters(noise_image=NOISE), **off(poses[0], generator))
    latest = follow(pose_filter, poses, twist, generator)[-1]
    for late in (9 * DT, 5 * DT):
        assert pose_filter.update(image_of(LINES, poses[2], NOISE, generator), late) is latest


def test_images_that_come_late_are_placed_where_they_were_taken():
    generator = np.random.default_rng(8)
    poses, twist = crossing(generator, 40)
    pose_filter = PoseFilter(LINES, FilterParameters(noise_image=NOISE), **off(poses[0], generator))
    for k in range(40):
        if k > 0:
            pose_filter.predict(twist, DT)
        if k >= 3:
            estimate = pose_filter.update(image_of(LINES, poses[k - 3], NOISE, generator), (k - 3) * DT)
            assert squared_error(poses[k - 3], estimate) < chi2.isf(1e-6, 6)
    np.testing.assert_allclose(pose_filter.pose_at(39 * DT).translation, poses[39].translation, atol=0.03)


def test_a_teleported_camera_is_lost_at_once_and_found_within_a_second():
    generator = np.random.default_rng(7)
    lines, pose = random_view(generator, 6)
    pose_filter = PoseFilter(lines, FilterParameters(noise_image=NOISE), **off(pose, generator))
    for k in range(5):
        assert pose_filter.update(image_of(lines, pose, NOISE, generator), k * DT).verdict is Verdict.OK
        pose_filter.predict(np.zeros(6), DT)
    there = Pose(pose.rotation, pose.translation + np.array([0.5, -0.4, 0.3]))
    estimate = pose_filter.update(image_of(lines, there, NOISE, generator), 5 * DT)
    assert estimate.verdict is Verdict.LOST and estimate.pose is None and "contradicts" in estimate.reason
    for k in range(6, 30):
        pose_filter.predict(np.zeros(6), DT)
        estimate = pose_filter.update(image_of(lines, there, NOISE, generator), k * DT)
        if estimate.pose is not None:
            break
    assert k * DT < 1.0 and squared_error(there, estimate) < chi2.isf(1e-5, 6)


def test_without_images_the_covariance_grows_and_in_the_end_it_is_lost():
    generator = np.random.default_rng(9)
    poses, twist = crossing(generator, 40)
    limits = FilterParameters(noise_image=NOISE, max_dead_reckoning=0.5)
    pose_filter = PoseFilter(LINES, limits, **off(poses[0], generator))
    pose_filter.update(image_of(LINES, poses[0], NOISE, generator), 0.0)
    blind = LineObservation(LINES.ids, np.zeros((4, 3)), np.zeros(4, dtype=bool))
    deviation = 0.0
    for k in range(1, 12):
        pose_filter.predict(twist, DT)
        estimate = pose_filter.update(blind, k * DT)
        assert estimate.position_deviation > deviation and "dead reckoning" in estimate.reason
        deviation = estimate.position_deviation
    pose_filter.predict(twist, DT)
    pose_filter.predict(twist, DT)
    assert pose_filter.update(blind, 13 * DT).verdict is Verdict.LOST


def test_the_motion_decides_between_poses_that_explain_the_first_image():
    generator = np.random.default_rng(2)
    lines, pose = random_view(generator, 3)
    pose_filter = PoseFilter(lines, noise={"image": 1e-4})
    first = pose_filter.update(image_of(lines, pose, 1e-4, generator), 0.0)
    assert first.verdict is Verdict.AMBIGUOUS
    twist = np.array([0.3, -0.2, 0.2, 0.1, 0.2, -0.1])
    for k in range(1, 100):
        pose = pose.integrate(twist, DT)
        pose_filter.predict(twist, DT)
        estimate = pose_filter.update(image_of(lines, pose, 1e-4, generator), k * DT)
        if estimate.verdict is not Verdict.AMBIGUOUS:
            break
    assert estimate.verdict in (Verdict.OK, Verdict.POOR) and squared_error(pose, estimate) < chi2.isf(1e-5, 6)


def test_bad_input_is_refused_by_name():
    generator = np.random.default_rng(1)
    pose = crossing(generator, 2)[0][0]
    with pytest.raises(ParameterError, match="start_covariance"):
        PoseFilter(LINES, start=pose)
    with pytest.raises(ParameterError, match="positive definite"):
        PoseFilter(LINES, start=pose, start_covariance=np.zeros((6, 6)))
    with pytest.raises(ParameterError, match="noise"):
        PoseFilter(LINES, noise={"imag": 1.0})
    pose_filter = PoseFilter(LINES)
    with pytest.raises(ObservationError, match=r"\bdt\b.*-0\.1 s"):
        pose_filter.predict(np.zeros(6), -0.1)
    with pytest.raises(GeometryError, match="twist"):
        pose_filter.predict([0, 0, 0, 0, 0, np.nan], 0.1)
    with pytest.raises(ObservationError, match=r"\bid 9\b.*scene"):
        pose_filter.update(LineObservation((9,), np.array([[1.0, 0.0, 0.0]])), 0.0)
    with pytest.raises(ObservationError, match=r"time.*\bnan\b"):
        pose_filter.update(image_of(LINES, pose), float("nan"))


@given(size=st.sampled_from([1e-6, 1e8, 1e150]), shift=vectors(3, -1, 1))
def test_extreme_scenes_give_a_finite_estimate_or_none(size, shift):
    lines = LineSet.from_points_directions(
        np.minimum(size, 1e49) * LINES.point, LINES.direction, position_std=1e-3, direction_std=1e-3
    )
    image = image_of(LINES, Pose(np.eye(3), np.array([0.3, 0.2, -5.0])))
    start = Pose(np.eye(3), np.minimum(size, 1e49) * shift)
    pose_filter = PoseFilter(lines, start=start, start_covariance=np.eye(6) * 1e-4)
    for k in range(3):
        pose_filter.predict(np.full(6, 1e3), DT)
        estimate = pose_filter.update(image, (k + 1) * DT)
        assert np.isfinite(estimate.covariance).all()
        assert estimate.pose is None or np.isfinite(estimate.pose.translation).all()


@given(
    steps=st.lists(st.tuples(numbers(0.0, 1.0), numbers(-1.0, 1.0)), max_size=6),
    start=numbers(0.0, 2.0),
    length=numbers(0.0, 3.0),
    latency=numbers(0.0, 0.5),
)
def test_twists_fill_a_time_without_gap_or_overlap(steps, start, length, latency):
    history = TwistHistory(timeout=0.2, latency=latency)
    time, begins = 0.0, []
    for pause, value in steps:
        time += pause
        begins.append((time + latency, value))
        history.add(np.full(6, value), time)
    parts = list(history.between(start, start + length))
    assert sum(duration for duration, _ in parts) == pytest.approx(length, abs=1e-6)
    now = start
    for duration, twist in parts:
        middle = now + 0.5 * duration
        holding = [value for begin, value in begins if begin <= middle < begin + 0.2]
        if duration > 1e-5:
            assert (twist is None) == (not holding)
            assert twist is None or twist[0] == holding[-1]
        now += duration


def test_a_track_never_has_more_parts_than_allowed_however_far_from_linear_images_are(monkeypatch):
    monkeypatch.setattr(filter_track, "MAX_NONLINEARITY", 0.0)
    generator = np.random.default_rng(3)
    poses, twist = crossing(generator, 12)
    wide = FilterParameters(noise_image=NOISE, max_position_deviation=1e-9)
    exact, covariances = np.zeros(len(LINES)), np.tile((NOISE**2, 0.0, NOISE**2), (len(LINES), 1))
    map_lines = _core.FilterMap(LINES.direction, LINES.pivot, exact, exact)
    track = filter_track.FilterTrack(LINES, map_lines, *off(poses[0], generator, 0.2, 0.1).values(), wide)
    counts = []
    for pose in poses:
        image = image_of(LINES, pose, NOISE, generator).image_lines
        assert track.update(list(range(len(LINES))), image, covariances).agreement is not Agreement.CONTRADICTS
        counts.append(track.part_count)
        track.predict(twist, twist, DT)
    assert 1 < max(counts) <= filter_track.MAX_PARTS
