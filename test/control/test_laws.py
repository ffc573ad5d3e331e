# SPDX-License-Identifier: Apache-2.0
"""The inverses of L against independent formulas."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import numbers, seen_lines, vectors

from plsing_ros.control.compute_twist import compute_twist
from plsing_ros.control.inverses import (
    adaptive_damping,
    dls_factors,
    limited_amplitudes,
    null_space_part,
    pinv_factors,
    pose_shares,
    smooth_step,
)
from plsing_ros.features import decompose, interaction_matrix
from plsing_ros.features.target import TargetView
from plsing_ros.geometry import LineSet
from plsing_ros.parameters import ControllerParameters

lines_and_right_side = seen_lines(min_size=3, max_size=6).flatmap(
    lambda lines: st.tuples(st.just(interaction_matrix(lines)), vectors(3 * len(lines), -2.0, 2.0))
)


def solve_least_squares(L, factors, b):
    """What a law makes of a right side with the factors of its singular values."""
    left, _, right = decompose(L)
    return right.T @ (factors * (left.T @ b))


@given(case=lines_and_right_side, threshold=st.sampled_from([1e-9, 1e-3, 0.1]))
def test_pinv_is_that_of_numpy(case, threshold):
    L, b = case
    values = np.linalg.svd(L, compute_uv=False)
    # Rounding decides about a singular value that is at the threshold.
    assume(abs(values - threshold * values[0]).min() > 1e-12 * values[0])
    expected = np.linalg.pinv(L, rcond=threshold) @ b
    ours = solve_least_squares(L, pinv_factors(decompose(L).singular_values, threshold), b)
    np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-6 * (1.0 + np.abs(expected).max()))


@given(case=lines_and_right_side, damping=st.floats(1e-3, 10.0))
def test_dls_minimises_the_damped_sum_of_squares(case, damping):
    """|L t - b|^2 + mu^2 |t|^2 is least squares with mu I below L; solved by QR, not by singular values."""
    L, b = case
    q, r = np.linalg.qr(np.vstack([L, damping * np.eye(6)]))
    expected = np.linalg.solve(r, q.T @ np.concatenate([b, np.zeros(6)]))
    ours = solve_least_squares(L, dls_factors(decompose(L).singular_values, 0.0, damping), b)
    np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-8 * (1.0 + np.abs(expected).max()))


@given(case=lines_and_right_side, damping=st.floats(1e-3, 10.0), pose=vectors(6, -2.0, 2.0))
def test_image_and_pose_minimise_both_sums_of_squares(case, damping, pose):
    """|L t - b|^2 + mu^2 |t - pose|^2 is least squares with mu I below L; solved by QR, not by singular values."""
    L, b = case
    q, r = np.linalg.qr(np.vstack([L, damping * np.eye(6)]))
    expected = np.linalg.solve(r, q.T @ np.concatenate([b, damping * pose]))
    left, values, right = decompose(L)
    factors = dls_factors(values, 0.0, damping)
    ours = right.T @ (factors * (left.T @ b) + pose_shares(values, factors) * (right @ pose))
    np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-8 * (1.0 + np.abs(expected).max()))


@given(case=lines_and_right_side, onset=st.floats(1e-3, 2.0), largest=st.floats(1e-3, 2.0))
def test_adaptive_dls_damps_the_nearly_lost_motions_alone(case, onset, largest):
    """The minimum of |L t - b|^2 + sum mu_i^2 (v_i . t)^2 over the motions v_i with sigma_i below the onset."""
    L, b = case
    normal = L.T @ L
    squares, motions = np.linalg.eigh(normal)
    penalty = np.zeros((6, 6))
    for square, motion in zip(squares, motions.T, strict=True):
        if square < onset**2:
            penalty += largest**2 * (1.0 - max(square, 0.0) / onset**2) * np.outer(motion, motion)
    values = decompose(L).singular_values
    # The normal equations above have no digits left otherwise.
    assume(abs(values - onset).min() > 1e-6 and np.linalg.cond(normal + penalty) < 1e8)
    ours = solve_least_squares(L, dls_factors(values, 0.0, adaptive_damping(values, onset, largest)), b)
    expected = np.linalg.solve(normal + penalty, L.T @ b)
    np.testing.assert_allclose(ours, expected, rtol=1e-5, atol=1e-5 * (1.0 + np.abs(expected).max()))


def test_adaptive_damping_grows_only_below_the_onset():
    values = np.array([2.0, 1.0, 0.8, 0.4, 0.0])
    damping = adaptive_damping(values, 0.8, 0.5)
    np.testing.assert_array_equal(damping[:3], 0.0)
    assert damping[3] == pytest.approx(0.5 * np.sqrt(0.75))
    assert damping[4] == 0.5


@given(
    amplitudes=vectors(6, -100.0, 100.0),
    health=st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6).map(np.array),
    share=st.floats(0.0, 10.0),
    least=st.floats(0.0, 1.0),
)
def test_lost_motions_are_limited_and_the_rest_is_kept(amplitudes, health, share, least):
    limited = limited_amplitudes(amplitudes, health, share, least)
    kept = health >= 1.0
    np.testing.assert_array_equal(limited[kept], amplitudes[kept])
    assert (np.abs(limited) <= np.abs(amplitudes)).all()
    assert (limited * amplitudes >= 0.0).all()
    # Squares of the smallest numbers would vanish.
    rest = math.hypot(*amplitudes[kept])
    for own, h in zip(limited[~kept], health[~kept], strict=True):
        assert abs(own) <= (share * rest + least) * h / (1.0 - h) * (1.0 + 1e-12)


def test_the_limit_sets_in_without_a_jump():
    amplitudes = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 5.0])
    just_lost = limited_amplitudes(amplitudes, np.array([1.0, 1, 1, 1, 1, 1.0 - 1e-9]), 1.0, 0.0)
    np.testing.assert_array_equal(just_lost, amplitudes)
    np.testing.assert_array_equal(limited_amplitudes(amplitudes, np.array([1.0, 1, 1, 1, 1, 0.0]), 1.0, 0.0)[5], 0.0)


@pytest.mark.parametrize(("others", "rest"), [(0.0, 0.0), (0.3, 0.03)])
def test_a_nearly_lost_motion_may_be_a_share_of_the_rest_and_creeps_without(others, rest):
    """The limit of docs/controller.md, by hand: the last singular value is at a quarter of the onset."""
    chosen = ControllerParameters(
        target_source="topic", law="guarded", guard_unobservable_share=2.0, max_linear_speed=0.4
    )
    L = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.125])
    error = np.array([others, 0.0, 0.0, 0.0, 0.0, -1.0])
    asked = compute_twist(chosen, L, np.zeros(6), error, None, TargetView(np.zeros(6), None, np.ones(6)))
    h = 3.0 / 16.0 - 2.0 / 64.0
    expected = [-0.1 * others, 0.0, 0.0, 0.0, 0.0, (2.0 * rest + 0.004) * h / (1.0 - h)]
    np.testing.assert_allclose(asked.twist, expected, rtol=1e-12, atol=1e-15)
    assert asked.health == pytest.approx(0.25)


def test_the_guard_looks_at_the_present_L_whatever_is_inverted():
    chosen = ControllerParameters(target_source="topic", law="guarded", interaction="mean")
    image = np.array([1.0, 0.0, 0.2, 0.0, 1.0, -0.3])
    there = TargetView(image, np.eye(6), np.ones(6))
    asked = compute_twist(chosen, np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.1]), image, np.zeros(6), None, there)
    assert asked.values[-1] == pytest.approx(0.5)
    assert asked.health == pytest.approx(0.2)


def test_without_3_d_lines_of_the_target_a_ten_thousandth_of_the_largest_singular_value_stands_in():
    chosen = ControllerParameters(target_source="topic", law="dls", damping=0.5)
    L = np.diag([4.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    asked = compute_twist(chosen, L, np.zeros(6), np.zeros(6), None, TargetView(np.zeros(6), None, None))
    assert asked.damping == pytest.approx(0.5 * 1e-4 * 4.0)


@given(ratio=st.floats(-2.0, 3.0))
def test_smooth_step_is_continuous_with_its_slope(ratio):
    h = 1e-5
    below, at, above = smooth_step(np.array([ratio - h, ratio, ratio + h]))
    assert 0.0 <= at <= 1.0
    slope = 6.0 * ratio * (1.0 - ratio) if 0.0 < ratio < 1.0 else 0.0
    assert (above - below) / (2.0 * h) == pytest.approx(slope, abs=1e-4)


@given(wanted=vectors(6, -1.0, 1.0), shift=numbers(-1.0, 1.0))
def test_the_secondary_task_moves_no_image_line(wanted, shift):
    """A corridor: along four parallel lines the camera is free."""
    along = np.array([0.6, 0.0, 0.8])
    points = np.array([[-1.0, -1.0, 3.0], [1.0, -1.0 + 0.1 * shift, 3.5], [1.0, 1.2, 3.0], [-1.3, 1.0, 3.0]])
    lines = LineSet.from_points_directions(points, np.tile(along, (4, 1)), "camera")
    L = interaction_matrix(lines)
    _, values, right = decompose(L)
    part = null_space_part(right, pinv_factors(values, 1e-9), wanted)
    expected = np.concatenate([(along @ wanted[:3]) * along, np.zeros(3)])
    np.testing.assert_allclose(part, expected, atol=1e-9)
    np.testing.assert_allclose(L @ part, 0.0, atol=1e-9)
