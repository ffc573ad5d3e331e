# SPDX-License-Identifier: Apache-2.0
"""The loops of a control cycle against exact arithmetic, their definitions and LAPACK."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import numbers, seen_lines, vectors

from plsing_ros import _core
from plsing_ros.geometry import LineSet

MIN_DEPTH = 1e-9


def of_condition(rows, condition, seed=0):
    generator = np.random.default_rng(rows + seed)
    left, right = np.linalg.qr(generator.normal(size=(rows, 6)))[0], np.linalg.qr(generator.normal(size=(6, 6)))[0]
    return left * np.geomspace(1.0, 1.0 / condition, 6) @ right


def interaction_matrix(lines):
    """L by its definition: ds = (dl - s (s_x dl_x + s_y dl_y)) / |(l_x, l_y)|, with dl = u x v + l x omega."""
    rows = []
    for u, l in zip(lines.direction, lines.moment, strict=True):  # noqa: E741, the literature's name
        depth = np.hypot(l[0], l[1])
        s = l / depth
        change = np.cross(np.vstack([np.tile(u, (3, 1)), np.tile(l, (3, 1))]), np.tile(np.eye(3), (2, 1))).T
        rows.append((change - np.outer(s, s[:2] @ change[:2])) / depth)
    return np.vstack(rows)


def assert_decomposes(matrix):
    left, values, right = _core.svd(matrix)
    assert (np.diff(values) <= 0.0).all()
    np.testing.assert_allclose(left * values @ right, matrix, atol=1e-14 * values[0])
    np.testing.assert_allclose(right @ right.T, np.eye(len(right)), atol=1e-14)
    if len(left) >= len(right):
        np.testing.assert_allclose(left.T @ left, np.eye(len(right)), atol=1e-14)


@given(lines=seen_lines(min_size=3), exponent=numbers(0.0, 10.0), columns=st.integers(1, 6))
def test_svd_gives_the_matrix_back_and_its_factors_are_orthonormal(lines, exponent, columns):
    half = np.hstack([lines.direction, lines.moment, lines.direction * lines.moment]).reshape(-1, 3)
    assert_decomposes(np.ascontiguousarray(np.hstack([half, half[::-1] * 10.0**-exponent])[:, :columns]))


@pytest.mark.parametrize("rows", [6, 15, 60, 900])
@pytest.mark.parametrize("condition", [1e2, 1e6, 1e10])
def test_the_smallest_singular_value_is_as_exact_as_rounding_of_the_matrix_allows(rows, condition):
    matrix = of_condition(rows, condition)
    with mpmath.workdps(50):
        # Of the rounded matrix, exactly: the square root of the smallest eigenvalue of its Gram matrix.
        gram = mpmath.matrix(matrix.T.tolist()) * mpmath.matrix(matrix.tolist())
        exact = float(mpmath.sqrt(min(mpmath.eigsy(gram, eigvals_only=True))))
    assert _core.svd(matrix)[1][-1] == pytest.approx(exact, rel=4e-15 * condition)


@pytest.mark.parametrize(
    "matrix",
    [
        np.zeros((9, 6)),
        np.ones((9, 6)),
        np.outer(np.arange(9.0), np.arange(6.0)),
        np.diag([3.0, 0.0, 2.0, 0.0, 0.0, 1.0]),
        np.eye(6) * 1e-300,
        np.eye(6) * 1e300,
        np.full((7, 6), 5e-324),
        np.diag([1.0, 1e-160, 1e-200, 1.0, 1.0, 1.0]),
        np.arange(18.0).reshape(3, 6) ** 0.5,
        np.ones((0, 4)),
    ],
)
def test_svd_of_matrices_without_full_rank_of_extreme_size_and_with_few_rows(matrix):
    assert_decomposes(matrix)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_there_is_no_svd_of_what_is_not_finite_or_overflows(value):
    matrix = np.ones((12, 6))
    matrix[7, 2] = value
    assert _core.svd(matrix) is None
    assert _core.solve(matrix, np.ones(12), 1.0, 0.0) is None
    assert _core.svd(np.full((7, 6), 1e308)) is None


@given(lines=st.one_of(seen_lines(min_size=2), seen_lines(min_size=45, max_size=50)))
def test_the_conditioning_of_an_interaction_matrix_is_that_of_its_decomposition(lines):
    values, right = _core.interaction_conditioning(lines.direction, lines.moment, MIN_DEPTH)
    matrix = _core.interaction_matrix(lines.direction, lines.moment, MIN_DEPTH)
    expected, rounding = _core.svd(matrix)[1], 1e-14 * values[0]
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=rounding)
    np.testing.assert_allclose(right @ right.T, np.eye(6), atol=1e-14)
    np.testing.assert_allclose(
        right @ (matrix.T @ matrix) @ right.T, np.diag(values**2), rtol=0.0, atol=rounding * values[0]
    )


@pytest.mark.parametrize(("element", "good"), [(0.3, True), (0.0, False), (np.inf, False), (np.nan, False)])
def test_there_is_nothing_without_an_image_nor_of_what_is_not_finite(element, good):
    moment = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 1.0], [element, 0.0, 0.0]])
    assert (_core.interaction_conditioning(np.eye(3), moment, MIN_DEPTH) is not None) is good
    assert (_core.compute_twist(np.eye(3), moment, np.ones(9), np.ones(9), MIN_DEPTH, 0.1, 0.0) is not None) is good


@pytest.mark.parametrize("rows", [6, 12, 300])
@pytest.mark.parametrize("condition", [1e2, 1e6])
def test_solve_is_least_squares_to_rounding_of_the_matrix(rows, condition):
    matrix, right_side = of_condition(rows, condition), np.random.default_rng(rows).normal(size=rows)
    with mpmath.workdps(50):
        a, b = mpmath.matrix(matrix.tolist()), mpmath.matrix(right_side.tolist())
        exact = np.array((mpmath.lu_solve(a.T * a, a.T * b)).T.tolist()[0], dtype=float)
    found = _core.solve(matrix, right_side, -0.1, 0.0)[3]
    # A change of the matrix by rounding moves the solution by the residual times the condition number squared.
    np.testing.assert_allclose(found, -0.1 * exact, atol=1e-14 * condition**2 * np.linalg.norm(right_side))


@given(lines=seen_lines(min_size=3), factor=numbers(-10.0, 10.0), threshold=st.sampled_from([0.0, 1e-6, 0.1]))
def test_solve_is_made_of_the_parts_that_it_gives(lines, factor, threshold):
    matrix = _core.interaction_matrix(lines.direction, lines.moment, MIN_DEPTH)
    right_side = lines.moment.ravel() / np.abs(lines.moment).max()
    left, values, right = _core.svd(matrix)
    found_values, found_right, components, solution = _core.solve(matrix, right_side, factor, threshold)
    np.testing.assert_array_equal(found_values, values)
    np.testing.assert_array_equal(found_right, right)
    np.testing.assert_allclose(components, factor * (left.T @ right_side), atol=1e-12 * np.linalg.norm(right_side))
    along = np.divide(components, values, where=values > threshold * values[0], out=np.zeros(6))
    np.testing.assert_allclose(solution, along @ right, rtol=1e-12, atol=1e-12 * np.abs(along).max())


@pytest.mark.parametrize(
    ("matrix", "right_side", "expected"),
    [
        (np.zeros((9, 6)), np.ones(9), np.zeros(6)),
        (np.diag([3.0, 0.0, 2.0, 0.0, 0.0, 1.0]), np.ones(6), [1 / 3, 0, 1 / 2, 0, 0, 1]),
        (np.ones((9, 6)), np.ones(9), np.full(6, 1 / 6)),
        (np.eye(6) * 1e-300, np.ones(6), np.full(6, 1e300)),
        (np.vstack([np.eye(6), np.eye(6)]), np.full(12, np.nan), np.full(6, np.nan)),
    ],
    ids=["zero", "singular", "rank one", "tiny", "nan"],
)
def test_solve_leaves_out_what_is_lost_and_passes_on_what_is_no_number(matrix, right_side, expected):
    np.testing.assert_allclose(_core.solve(matrix, right_side, 1.0, 1e-12)[3], expected, rtol=1e-13)
    assert not np.isfinite(_core.solve(np.eye(6) * 1e-300, np.full(6, 1e300), 1.0, 0.0)[3]).all()


@pytest.mark.parametrize("n", [3, 4, 43, 200])
@pytest.mark.parametrize("threshold", [0.0, 0.1])
def test_interaction_matrix_and_twist_are_those_of_the_textbook_for_any_number_of_lines(n, threshold):
    generator = np.random.default_rng(n)
    lines = LineSet.from_points_directions(generator.normal(size=(n, 3)) + [0, 0, 5], generator.normal(size=(n, 3)))
    image, desired = generator.normal(size=(2, 3 * n))
    matrix = interaction_matrix(lines)
    found = _core.interaction_matrix(lines.direction, lines.moment, MIN_DEPTH)
    np.testing.assert_allclose(found, matrix, rtol=1e-12, atol=1e-14 * np.abs(matrix).max())
    twist, speed, values, norm = _core.compute_twist(
        lines.direction, lines.moment, image, desired, MIN_DEPTH, 0.1, threshold
    )
    expected = -0.1 * np.linalg.pinv(matrix, rcond=threshold) @ (image - desired)
    np.testing.assert_allclose(twist, expected, rtol=1e-9)
    np.testing.assert_allclose(values, np.linalg.svd(matrix, compute_uv=False), rtol=1e-9)
    assert speed == pytest.approx(np.linalg.norm(twist), rel=1e-14)
    assert norm == pytest.approx(np.linalg.norm(image - desired), rel=1e-14)


@given(a=vectors(9, -1e3, 1e3), b=vectors(9, -1e3, 1e3), size=st.sampled_from([1e-300, 1e-160, 1.0, 1e160, 1e300]))
def test_subtract_gives_difference_and_norm_of_any_size(a, b, size):
    difference, norm = _core.subtract(a * size, b * size)
    np.testing.assert_array_equal(difference, a * size - b * size)
    largest = np.abs(difference).max()
    expected = 0.0 if largest == 0.0 else largest * np.linalg.norm(difference / largest)
    # Below the smallest normal number digits are lost.
    assert norm == pytest.approx(expected, rel=1e-14, abs=1e-307)
    assert _core.subtract(np.full(3, 1e308), np.full(3, -1e308))[1] == np.inf
