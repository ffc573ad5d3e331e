# SPDX-License-Identifier: Apache-2.0
"""The stages of the singular set, each against its definition or exact arithmetic."""

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from strategies import seen_lines, vectors

from plsing_ros import _core
from plsing_ros.singularities.ternary_forms import basis_values, half_sphere_points, multiplication_maps

ON_LINE = 1e-12
SAMPLES = half_sphere_points(15)
INTERPOLATE = np.linalg.inv(basis_values(4, SAMPLES))
MULTIPLY = multiplication_maps(4)
FORMS = np.array([[0.62, -0.35, 0.71], [0.30, 0.83, 0.47]])


def scene(seed, n=4):
    """Unit directions and the points closest to the origin, each (1, n, 3)."""
    direction, point = np.random.default_rng(seed).normal(size=(2, 1, n, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    return direction, point - (point * direction).sum(axis=2, keepdims=True) * direction


def ratios(direction, point, centers):
    return _core.singularity_ratios(direction, point, np.ascontiguousarray(centers, dtype=complex), ON_LINE)


def xi(direction, point, center):
    """[f, |f|^2 u] and [0, u x f] of each line, lengths in the root mean square distance, rows of unit length."""
    f = np.cross(direction, point - center)
    f /= np.sqrt((np.abs(f) ** 2).sum(axis=1).mean())
    rows = np.hstack([f, (f * f).sum(axis=1, keepdims=True) * direction])
    rows = np.vstack([rows, np.hstack([np.zeros_like(f), np.cross(direction, f)])])
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


@given(lines=seen_lines(min_size=3), real=vectors(), imaginary=vectors())
def test_ratios_are_those_of_the_definition(lines, real, imaginary):
    direction, point = lines.direction[np.newaxis], lines.point[np.newaxis]
    centers = np.array([real, real + 1j * np.asarray(imaginary)])
    ratio, distance = ratios(direction, point, centers)
    for i in range(2):
        away = np.linalg.norm(np.cross(direction[0], point[0] - centers[i]), axis=1)
        nearest = away.min() / np.sqrt((away**2).mean())
        assume(nearest > 1e-6)
        values = np.linalg.svd(xi(direction[0], point[0], centers[i]), compute_uv=False)
        assert ratio[i] == pytest.approx(values[5] / values[0], abs=1e-13)
        assert distance[i] == pytest.approx(nearest, rel=1e-9)


@pytest.mark.parametrize("offset", [0.0, 1e-12, 1e-9, 1e-6j, 1e-3 + 1e-4j])
def test_small_ratios_are_as_exact_as_rounding_of_the_matrix_allows(offset):
    direction, point = scene(1)
    # On a line that meets all four.
    path, origin = np.array([0.3, -0.5, 0.8]), np.array([0.2, 0.1, -0.4])
    point[0] = origin + path * np.array([[-2.0], [-1.0], [0.5], [1.5]])
    center = origin + 0.1 * path + offset * np.array([0.4, 0.3, -0.2])
    with mpmath.workdps(50):
        matrix = mpmath.matrix(xi(direction[0], point[0], center).tolist())
        values = mpmath.eighe(matrix.transpose_conj() * matrix, eigvals_only=True)
        exact = float(mpmath.sqrt(abs(min(values)) / max(values)))
    assert ratios(direction, point, center[np.newaxis])[0][0] == pytest.approx(exact, abs=2e-15)


def test_each_centre_may_have_its_own_lines():
    direction, point = (np.concatenate([scene(seed)[i] for seed in range(3)]) for i in range(2))
    centers = np.arange(9.0).reshape(3, 3)
    together = ratios(direction, point, centers)
    for i in range(3):
        alone = ratios(direction[i : i + 1], point[i : i + 1], centers[i : i + 1])
        np.testing.assert_allclose([together[0][i], together[1][i]], np.ravel(alone), rtol=1e-13)


def test_ratio_of_many_lines_and_where_nothing_is_fixed():
    direction, point = scene(2, n=70)
    center = np.array([[0.3, 0.2, 1j]])
    values = np.linalg.svd(xi(direction[0], point[0], center[0]), compute_uv=False)
    assert ratios(direction, point, center)[0][0] == pytest.approx(values[5] / values[0], rel=1e-12)
    # Parallel lines, and three lines through one point with the centre at it: all rows of xi are zero.
    assert ratios(np.broadcast_to([0.0, 0.0, 1.0], (1, 4, 3)).copy(), point[:, :4].copy(), center)[0][0] < 1e-15
    ratio, distance = ratios(np.eye(3)[np.newaxis], np.zeros((1, 3, 3)), np.zeros((1, 3)))
    assert (ratio[0], distance[0]) == (0.0, 0.0)


def test_rows_of_a_line_through_the_centre_are_zero():
    direction, point = scene(3, n=5)
    center = point[:, 0] + 2.0 * direction[:, 0]
    ratio, distance = ratios(direction, point, center)
    assert distance[0] <= ON_LINE
    rows = xi(np.delete(direction[0], 0, 0), np.delete(point[0], 0, 0), center[0])
    # The unit of length is that of all five lines.
    rows[:4, :3] /= np.sqrt(5.0 / 4.0)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    values = np.linalg.svd(rows, compute_uv=False)
    assert ratio[0] == pytest.approx(values[5] / values[0], rel=1e-9)


# Not finite; with a square that overflows; along the first line, whose own distance stays finite.
@pytest.mark.parametrize("far", [(0, np.nan, 2), (0, np.inf, 2), (0, -np.inf, 2), (0, 1e200, 2), (1e155, 0, 0)])
def test_centres_that_are_not_finite_or_whose_distances_overflow_are_not_singular(far):
    direction, point = np.concatenate([np.eye(3), [[0.6, 0.8, 0.0]]])[np.newaxis], scene(5)[1]
    ratio, distance = ratios(direction, point, np.array([[0.0, 1.0, 2.0], far]))
    assert (ratio[1], distance[1]) == (1.0, np.inf)
    assert ratio[0] < 1.0


@pytest.mark.parametrize("scale", [1e-140, 1e-100, 1e77, 1e100, 1e150])
def test_ratios_do_not_depend_on_the_unit_of_length(scale):
    direction, point = scene(5)
    centers = np.array([[0.3, 0.2, -0.5], [0.1, 0.4j, 0.2]])
    np.testing.assert_allclose(
        ratios(direction, point * scale, centers * scale), ratios(direction, point, centers), rtol=1e-12
    )


def framed(direction, foot):
    return _core.scene_coordinates(direction, foot, 1e-9, 1e-12)


@pytest.mark.parametrize("n", [2, 4, 9])
@pytest.mark.parametrize("away", [0.0, 1e3])
def test_scene_frames(n, away):
    direction, foot = (np.concatenate([scene(seed, n)[i] for seed in range(5)]) for i in range(2))
    foot = foot + away
    center, length, relative = framed(direction, foot)
    np.testing.assert_allclose((relative * direction).sum(axis=2), 0.0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(relative, axis=2).mean(axis=1), 1.0, rtol=1e-14)
    # The sum of the offsets is the gradient of the sum of squared distances.
    np.testing.assert_allclose(relative.sum(axis=1), 0.0, atol=1e-12)
    back = center[:, np.newaxis] + relative * length[:, np.newaxis, np.newaxis]
    np.testing.assert_allclose(np.cross(back - foot, direction), 0.0, atol=1e-12 * (1.0 + away))


def test_scene_frames_of_parallel_and_concurrent_lines():
    direction, foot = scene(6)
    parallel = np.broadcast_to(direction[:, :1], direction.shape).copy()
    center, _, relative = framed(parallel, foot)
    assert float((center[0] - foot[0].mean(axis=0)) @ direction[0, 0]) == pytest.approx(0.0, abs=1e-14)
    np.testing.assert_allclose(relative.sum(axis=1), 0.0, atol=1e-13)
    common = np.array([3.0, -2.0, 5.0])
    center, length, _ = framed(direction, common + direction * np.arange(4.0)[:, np.newaxis])
    np.testing.assert_allclose(center[0], common, rtol=1e-13)
    assert length[0] == 0.0


def test_scene_frames_that_overflow_are_refused():
    for value in (np.inf, np.nan, 1e308):
        direction, foot = scene(7)
        foot[0, 1, 2] = value
        assert framed(direction, foot) is None
        direction[0, 1, 2] = value
        assert framed(direction, scene(7)[1]) is None


def ten_points(direction, point, forms=FORMS):
    return _core.isolated_points(direction, point, forms, SAMPLES, INTERPOLATE, MULTIPLY, ON_LINE, 1e-3, 1e-9)


def across(direction, w):
    return w - (direction @ w)[:, np.newaxis] * direction


@pytest.mark.parametrize("seed", range(8))
def test_the_ten_points_solve_what_defines_them(seed):
    direction, point = scene(seed)
    center, h, w, residual, margin = (each[0] for each in ten_points(direction, point))
    assert 1e-9 < margin <= 1.0
    np.testing.assert_allclose(np.linalg.norm(h, axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(h[:, 1:] / h[:, :1], center, rtol=1e-12)
    for C, axis, ratio in zip(center, w, residual, strict=True):
        # P_i w . (M_i - C) = 0 for each line, and the rank basis is singular there.
        off = (across(direction[0], axis) * (point[0] - C)).sum(axis=1)
        np.testing.assert_allclose(off, 0.0, atol=1e-9 * (1.0 + np.abs(C).max()))
        values = np.linalg.svd(xi(direction[0], point[0], C), compute_uv=False)
        assert ratio == pytest.approx(values[5] / values[0], abs=1e-14)
        assert ratio < 1e-10
    # Ten different ones, in conjugate pairs, whatever the linear forms are.
    apart = np.abs(center[:, np.newaxis] - center).max(axis=2) + np.eye(10)
    assert apart.min() > 1e-6
    assert np.abs(center[:, np.newaxis] - center.conj()).max(axis=2).min(axis=1).max() < 1e-9 * np.abs(center).max()
    again = ten_points(direction, point, np.array([[0.48, 0.65, -0.59], [-0.77, 0.42, 0.48]]))[0][0]
    distance = np.abs(center[:, np.newaxis] - again).max(axis=2).min(axis=1)
    assert (distance < 1e-7 * (1.0 + np.abs(center).max(axis=1))).all()


def test_scenes_are_solved_one_by_one():
    direction, point = (np.concatenate([scene(seed)[i] for seed in range(4)]) for i in range(2))
    together = ten_points(direction, point)
    for i in range(4):
        for part, alone in zip(together, ten_points(direction[i : i + 1], point[i : i + 1]), strict=True):
            np.testing.assert_array_equal(part[i], alone[0])


def test_the_margin_tells_a_special_scene_and_what_is_not_finite():
    direction, point = scene(8)
    # Two parallel pairs.
    direction[0, 2:] = direction[0, :2]
    point -= (point * direction).sum(axis=2, keepdims=True) * direction
    assert ten_points(direction, point)[4][0] < 1e-12
    direction, point = scene(7)
    point[0, 1, 2] = np.nan
    center, _, _, residual, margin = ten_points(direction, point)
    assert np.isnan(margin[0])
    assert np.isnan(center).all()
    assert (residual == 1.0).all()
