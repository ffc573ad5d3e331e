"""The compiled loops and their twins of numpy, each against the definition, so also against each other."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import numbers, seen_lines, vectors

from plsing_ros import kernels
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.kernels import compiled, of_numpy

BOTH = pytest.mark.parametrize("the", [compiled, of_numpy], ids=["compiled", "numpy"])
LEAST_DEPTH = 1e-9


def decomposed(the, matrix):
    m, k = matrix.shape
    parts = np.empty((m, k)), np.empty(k), np.empty((k, k))
    assert the.svd(matrix, *parts)
    return parts


def test_the_compiled_ones_are_in_use():
    assert all(getattr(kernels, name) is getattr(compiled, name) for name in kernels.__all__)


def test_each_has_a_twin():
    public = {name for name in dir(compiled) if not name.startswith("_")}
    assert public == set(kernels.__all__) == set(of_numpy.__all__)


@given(lines=seen_lines(min_size=1))
def test_interaction_matrices_agree(lines):
    matrices = [np.empty((3 * len(lines), 6)) for _ in range(2)]
    for the, matrix in zip((compiled, of_numpy), matrices, strict=True):
        assert the.interaction_matrix(lines.direction, lines.moment, matrix, LEAST_DEPTH)
    np.testing.assert_allclose(*matrices, rtol=1e-13, atol=1e-14 * np.abs(matrices[0]).max())


@BOTH
@given(image=vectors(6, -3.0, 3.0), numbers=vectors(72, -1.0, 1.0), columns=st.integers(1, 6))
def test_the_mean_is_that_of_changes_of_angle_and_offset(the, image, numbers, columns):
    a, b, offset, desired_offset = *image.reshape(3, 2)[:2], image[4], image[5]
    s = np.column_stack([np.cos(a), np.sin(a), [offset, 1.0]])
    s_desired = np.column_stack([np.cos(b), np.sin(b), [desired_offset, -1.0]])
    # Rows that image lines have: d (cos a, sin a, r) = (-sin a da, cos a da, dr).
    da, dr, db, dq = (each[:, :columns] for each in numbers.reshape(4, 2, 9))
    L = np.stack([-s[:, 1:2] * da, s[:, :1] * da, dr], axis=1).reshape(6, columns)
    L_desired = np.stack([-s_desired[:, 1:2] * db, s_desired[:, :1] * db, dq], axis=1).reshape(6, columns)
    half, offsets = 0.5 * (da + db), 0.5 * (dr + dq)
    expected = np.stack([-s[:, 1:2] * half, s[:, :1] * half, offsets], axis=1).reshape(6, columns)
    mean = np.empty((6, columns))
    the.mean_interaction(s.ravel(), s_desired.ravel(), L, L_desired, mean, columns)
    np.testing.assert_allclose(mean, expected, atol=1e-15)


@BOTH
@given(lines=seen_lines(min_size=3), exponent=numbers(0.0, 10.0))
def test_svd_gives_the_matrix_back_and_its_factors_are_orthonormal(the, lines, exponent):
    matrix = np.hstack([lines.direction, lines.moment, lines.direction * lines.moment]).reshape(-1, 3)
    matrix = np.hstack([matrix, matrix[::-1] * 10.0**-exponent])
    left, values, right = decomposed(the, matrix)
    assert (np.diff(values) <= 0.0).all()
    np.testing.assert_allclose(left * values @ right, matrix, atol=1e-14 * values[0])
    np.testing.assert_allclose(left.T @ left, np.eye(6), atol=1e-14)
    np.testing.assert_allclose(right @ right.T, np.eye(6), atol=1e-14)


@BOTH
@pytest.mark.parametrize("rows", [6, 12, 15, 60, 300, 900])
@pytest.mark.parametrize("condition", [1e2, 1e6, 1e10])
def test_the_smallest_singular_value_is_as_exact_as_rounding_of_the_matrix_allows(the, rows, condition):
    generator = np.random.default_rng(rows)
    left = np.linalg.qr(generator.normal(size=(rows, 6)))[0]
    right = np.linalg.qr(generator.normal(size=(6, 6)))[0]
    matrix = left * np.geomspace(1.0, 1.0 / condition, 6) @ right
    with mpmath.workdps(50):
        # Of the rounded matrix, exactly: the square root of the smallest eigenvalue of its Gram matrix.
        gram = mpmath.matrix(matrix.T.tolist()) * mpmath.matrix(matrix.tolist())
        exact = float(mpmath.sqrt(min(mpmath.eigsy(gram, eigvals_only=True))))
    assert decomposed(the, matrix)[1][-1] == pytest.approx(exact, rel=4e-15 * condition)


@BOTH
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
    ],
    ids=lambda matrix: f"{matrix[-1, -1]:g}",
)
def test_svd_of_matrices_without_full_rank_and_of_extreme_size(the, matrix):
    left, values, right = decomposed(the, matrix)
    np.testing.assert_allclose(left * values @ right, matrix, atol=1e-14 * values[0])
    np.testing.assert_allclose(left.T @ left, np.eye(6), atol=1e-14)
    np.testing.assert_allclose(right @ right.T, np.eye(6), atol=1e-14)
    np.testing.assert_allclose(values, np.linalg.svd(matrix, compute_uv=False), atol=1e-14 * values[0])


@BOTH
@pytest.mark.parametrize("columns", [1, 3, 5])
def test_svd_of_some_columns(the, columns):
    matrix = np.random.default_rng(columns).normal(size=(12, columns))
    np.testing.assert_allclose(decomposed(the, matrix)[1], np.linalg.svd(matrix, compute_uv=False), rtol=1e-13)


@BOTH
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_svd_refuses_what_is_not_finite(the, value):
    matrix = np.ones((12, 6))
    matrix[7, 2] = value
    assert not the.svd(matrix, np.empty((12, 6)), np.empty(6), np.empty((6, 6)))


@BOTH
def test_svd_refuses_what_overflows(the):
    assert not the.svd(np.full((7, 6), 1e308), np.empty((7, 6)), np.empty(6), np.empty((6, 6)))


def solution(the, matrix, right_side, factor, threshold):
    """Singular values, right singular vectors, components and solution."""
    k = matrix.shape[1]
    parts = np.empty(k), np.empty((k, k)), np.empty(k), np.empty(k)
    assert the.solve(matrix, right_side, *parts, factor, threshold)
    return parts


@BOTH
@pytest.mark.parametrize("rows", [6, 12, 300])
@pytest.mark.parametrize("condition", [1e2, 1e6])
def test_solve_is_least_squares_to_rounding_of_the_matrix(the, rows, condition):
    generator = np.random.default_rng(rows)
    left = np.linalg.qr(generator.normal(size=(rows, 6)))[0]
    right = np.linalg.qr(generator.normal(size=(6, 6)))[0]
    matrix, right_side = left * np.geomspace(1.0, 1.0 / condition, 6) @ right, generator.normal(size=rows)
    with mpmath.workdps(50):
        a, b = mpmath.matrix(matrix.tolist()), mpmath.matrix(right_side.tolist())
        exact = np.array((mpmath.lu_solve(a.T * a, a.T * b)).T.tolist()[0], dtype=float)
    *_, found = solution(the, matrix, right_side, -0.1, 0.0)
    # A change of the matrix by rounding moves the solution by the residual times the condition number squared.
    np.testing.assert_allclose(found, -0.1 * exact, atol=1e-14 * condition**2 * np.linalg.norm(right_side))


@BOTH
@given(lines=st.one_of(seen_lines(), seen_lines(min_size=45, max_size=50)))
def test_the_decomposition_of_an_interaction_matrix_is_that_of_the_two_steps(the, lines):
    m = 3 * len(lines)
    matrix, parts = np.empty((m, 6)), (np.empty((m, 6)), np.empty(6), np.empty((6, 6)))
    good = the.interaction_svd(lines.direction, lines.moment, *parts, LEAST_DEPTH)
    assert good is (len(lines) > 1)
    if good:
        assert the.interaction_matrix(lines.direction, lines.moment, matrix, LEAST_DEPTH)
        for part, expected in zip(parts, decomposed(the, matrix), strict=True):
            np.testing.assert_array_equal(part, expected)


@BOTH
@pytest.mark.parametrize(("element", "good"), [(0.3, True), (0.0, False), (np.inf, False), (np.nan, False)])
def test_there_is_no_decomposition_without_an_image_nor_of_what_is_not_finite(the, element, good):
    moments = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 1.0], [element, 0.0, 0.0]])
    parts = np.empty((9, 6)), np.empty(6), np.empty((6, 6))
    with np.errstate(invalid="ignore"):
        assert the.interaction_svd(np.eye(3), moments, *parts, LEAST_DEPTH) is good


@BOTH
@given(lines=seen_lines(min_size=3), factor=numbers(-10.0, 10.0), threshold=st.sampled_from([0.0, 1e-6, 0.1]))
def test_solve_is_made_of_the_parts_that_it_gives(the, lines, factor, threshold):
    matrix = np.empty((3 * len(lines), 6))
    assert the.interaction_matrix(lines.direction, lines.moment, matrix, LEAST_DEPTH)
    right_side = lines.moment.ravel() / np.abs(lines.moment).max()
    left, values, right = decomposed(the, matrix)
    parts = solution(the, matrix, right_side, factor, threshold)
    np.testing.assert_array_equal(parts[0], values)
    np.testing.assert_array_equal(parts[1], right)
    np.testing.assert_allclose(parts[2], factor * (left.T @ right_side), atol=1e-13 * np.linalg.norm(right_side) * 10.0)
    kept = values > threshold * values[0]
    along = np.divide(parts[2], values, where=kept, out=np.zeros(6))
    np.testing.assert_allclose(parts[3], along @ right, rtol=1e-12, atol=1e-12 * np.abs(along).max())


@BOTH
@pytest.mark.parametrize("columns", [1, 3, 5])
def test_solve_with_some_columns(the, columns):
    generator = np.random.default_rng(columns)
    matrix, right_side = generator.normal(size=(12, columns)), generator.normal(size=12)
    expected = np.linalg.lstsq(matrix, right_side, rcond=None)[0]
    np.testing.assert_allclose(solution(the, matrix, right_side, 1.0, 0.0)[3], expected, rtol=1e-12)


@BOTH
@pytest.mark.parametrize(
    ("matrix", "right_side", "expected"),
    [
        (np.zeros((9, 6)), np.ones(9), np.zeros(6)),
        (np.diag([3.0, 0.0, 2.0, 0.0, 0.0, 1.0]), np.ones(6), [1 / 3, 0, 1 / 2, 0, 0, 1]),
        (np.ones((9, 6)), np.ones(9), np.full(6, 1 / 6)),
        (np.eye(6) * 1e-300, np.ones(6), np.full(6, 1e300)),
        (np.eye(6) * 1e-300, np.full(6, 1e300), np.full(6, np.inf)),
    ],
    ids=["zero", "singular", "rank one", "tiny", "overflow"],
)
def test_solve_leaves_out_what_is_lost_and_says_what_overflows(the, matrix, right_side, expected):
    *_, found = solution(the, matrix, right_side, 1.0, 1e-12)
    if np.isfinite(expected).all():
        np.testing.assert_allclose(found, expected, rtol=1e-13)
    else:
        assert not np.isfinite(found).all()


@BOTH
def test_solve_refuses_what_is_not_finite_in_the_matrix_and_passes_it_on_from_the_right_side(the):
    matrix, parts = np.vstack([np.eye(6), np.eye(6)]), (np.empty(6), np.empty((6, 6)), np.empty(6), np.empty(6))
    assert the.solve(matrix, np.full(12, np.nan), *parts, 1.0, 0.0) and np.isnan(parts[3]).all()
    matrix[7, 2] = np.inf
    assert not the.solve(matrix, np.ones(12), *parts, 1.0, 0.0)


def law(the, lines, image, desired, gain=0.1, threshold=0.0):
    """|s - s*| or None, singular values and twist."""
    values, twist = np.empty(6), np.empty(6)
    norm = the.plain_law(lines.direction, lines.moment, image, desired, values, twist, LEAST_DEPTH, gain, threshold)
    return norm, values, twist


@BOTH
@given(lines=seen_lines(min_size=2), change=vectors(6, -1.0, 1.0), threshold=st.sampled_from([0.0, 1e-6, 0.1]))
def test_the_plain_law_takes_the_three_steps_one_after_the_other(the, lines, change, threshold):
    desired = np.resize(change, 3 * len(lines))
    image = (lines.moment / np.hypot(*lines.moment[:, :2].T)[:, np.newaxis]).ravel()
    matrix, error = np.empty((3 * len(lines), 6)), np.empty(3 * len(lines))
    assert the.interaction_matrix(lines.direction, lines.moment, matrix, LEAST_DEPTH)
    expected_norm = the.subtract(image, desired, error)
    expected_values, _, _, expected_twist = solution(the, matrix, error, -0.1, threshold)
    norm, values, twist = law(the, lines, image, desired, 0.1, threshold)
    assert norm == expected_norm
    np.testing.assert_array_equal(values, expected_values)
    np.testing.assert_array_equal(twist, expected_twist)


@BOTH
@pytest.mark.parametrize("n", [3, 43, 200])
def test_the_plain_law_is_that_of_the_textbook_for_any_number_of_lines(the, n):
    generator = np.random.default_rng(n)
    lines = LineSet.from_points_directions(generator.normal(size=(n, 3)) + [0, 0, 5], generator.normal(size=(n, 3)))
    image, desired = generator.normal(size=(2, 3 * n))
    matrix = np.empty((3 * n, 6))
    assert of_numpy.interaction_matrix(lines.direction, lines.moment, matrix, LEAST_DEPTH)
    norm, values, twist = law(the, lines, image, desired)
    np.testing.assert_allclose(twist, -0.1 * np.linalg.pinv(matrix) @ (image - desired), rtol=1e-9)
    np.testing.assert_allclose(values, np.linalg.svd(matrix, compute_uv=False), rtol=1e-9)
    assert norm == pytest.approx(np.linalg.norm(image - desired), rel=1e-14)


@BOTH
def test_the_plain_law_leaves_to_others_what_is_to_be_refused(the):
    through_the_camera = LineSet.from_points_directions(np.eye(3) * [1, 1, 0], [[0, 1, 0], [1, 0, 1], [0, 0, 1]])
    assert law(the, through_the_camera, np.ones(9), np.ones(9))[0] is None
    lines = LineSet.from_points_directions([[1.0, 2.0, 3.0]] * 2, [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    assert law(the, lines, np.ones(6), np.ones(6))[0] == 0.0
    assert law(the, lines.select([0]), np.ones(3), np.ones(3))[0] is None
    assert law(the, lines, np.full(6, 1e308), np.full(6, -1e308))[0] == np.inf


@BOTH
@given(a=vectors(9, -1e3, 1e3), b=vectors(9, -1e3, 1e3), size=st.sampled_from([1e-300, 1e-160, 1.0, 1e160, 1e300]))
def test_subtract_gives_difference_and_norm_of_any_size(the, a, b, size):
    difference = np.empty(9)
    norm = the.subtract(a * size, b * size, difference)
    np.testing.assert_array_equal(difference, a * size - b * size)
    largest = np.abs(difference).max()
    expected = 0.0 if largest == 0.0 else largest * np.linalg.norm(difference / largest)
    assert norm == pytest.approx(expected, rel=1e-14, abs=1e-320)


@BOTH
def test_subtract_says_what_overflows(the):
    difference = np.empty(3)
    assert the.subtract(np.full(3, 1e308), np.full(3, -1e308), difference) == np.inf
    assert np.isinf(difference).all()


@BOTH
@given(lines=seen_lines(min_size=1), error=numbers(2e-6, 1e6))
def test_are_lines_refuses_what_is_no_line(the, lines, error):
    u, l = lines.direction, lines.moment  # noqa: E741, the literature's name
    assert the.are_lines(u, l, 1e-6)
    assert not the.are_lines(u * (1.0 + error), l, 1e-6)
    skewed = l.copy()
    skewed[-1] += error * (1.0 + np.abs(l[-1]).max()) * 4.0 * u[-1]
    assert not the.are_lines(u, skewed, 1e-6)
    for value in (np.nan, np.inf):
        for array in (u, l):
            bad = array.copy()
            bad[-1, 1] = value
            assert not the.are_lines(bad if array is u else u, bad if array is l else l, 1e-6)


@BOTH
def test_images(the):
    good = np.array([[0.6, -0.8, 5.0], [0.0, 1.0, 0.0]])
    assert the.are_image_lines(good, 1e-3)
    assert the.are_image_lines(good * 1.0009, 1e-3)
    assert not the.are_image_lines(good * 1.0011, 1e-3)
    for value in (np.nan, np.inf):
        for column in range(3):
            bad = good.copy()
            bad[1, column] = value
            assert not the.are_image_lines(bad, 1e-3)


@BOTH
@pytest.mark.parametrize(
    ("moment", "has_image"),
    [
        ([2e-9, 0, 0], True),
        ([5e-10, 0, 0], False),
        ([0, 2e-6, 1e4], False),
        ([0, 2e-5, 1e4], True),
        ([1, 2, np.nan], False),
        ([1, np.nan, 2], False),
        ([1, 2, -np.inf], False),
        ([np.inf, 1, 2], False),
        ([-np.inf, np.nan, 2], False),
        ([1.5e308, 1.5e308, 0], False),
        ([1e308, 1e308, 1e308], True),
    ],
)
def test_a_line_has_an_image_if_it_is_clear_of_camera_centre_and_focal_plane(the, moment, has_image):
    moments = np.array([[1.0, 2.0, 3.0], moment])
    assert the.have_images(moments, LEAST_DEPTH) is has_image
    with np.errstate(over="ignore", invalid="ignore"):
        assert the.interaction_matrix(np.ones((2, 3)), moments, np.empty((6, 6)), LEAST_DEPTH) is has_image


@BOTH
def test_rotations(the):
    rotation = Pose.looking_at([1, 2, 3], [0.3, 0.1, 0.2]).rotation
    assert the.is_rotation(rotation, 1e-6)
    assert not the.is_rotation(-rotation, 1e-6)
    assert not the.is_rotation(rotation * 1.001, 1e-6)
    assert not the.is_rotation(np.full((3, 3), np.nan), 1e-6)
    assert not the.is_rotation(np.diag([np.inf, 0.0, 0.0]), 1e-6)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("svd", (np.ones((12, 6)), np.empty((12, 6)), np.empty(6), np.empty((5, 6)))),
        ("svd", (np.ones((12, 6)), np.empty((11, 6)), np.empty(6), np.empty((6, 6)))),
        ("svd", (np.ones((12, 7)), np.empty((12, 7)), np.empty(7), np.empty((7, 7)))),
        ("svd", (np.ones((6, 12)).T, np.empty((12, 6)), np.empty(6), np.empty((6, 6)))),
        ("solve", (np.ones((12, 6)), np.ones(11), np.empty(6), np.empty((6, 6)), np.empty(6), np.empty(6), 1.0, 0.0)),
        ("solve", (np.ones((12, 6)), np.ones(12), np.empty(7), np.empty((7, 7)), np.empty(7), np.empty(7), 1.0, 0.0)),
        ("mean_interaction", (np.ones(6), np.ones(6), np.ones((6, 5)), np.ones((6, 6)), np.empty((6, 6)), 6)),
        ("mean_interaction", (np.ones(6), np.ones(6), np.ones((6, 7)), np.ones((6, 7)), np.empty((6, 7)), 7)),
        ("plain_law", (*[np.ones((4, 3))] * 3, np.ones((3, 3)), np.empty(6), np.empty(6), 1e-9, 0.1, 0.0)),
        ("subtract", (np.ones(4), np.ones(3), np.empty(4))),
        ("are_lines", (np.ones((4, 3)), np.ones((3, 3)), 1e-6)),
        ("are_lines", (np.ones((4, 3), dtype=np.float32), np.ones((4, 3)), 1e-6)),
        ("interaction_matrix", (np.ones((2, 3)), np.ones((2, 3)), np.ones((5, 6)), 1e-9)),
        ("interaction_svd", (*[np.ones((2, 3))] * 2, np.ones((6, 6)), np.ones(5), np.ones((6, 6)), 1e-9)),
        ("is_rotation", (np.ones(8), 1e-6)),
    ],
)
def test_arrays_that_do_not_fit_are_refused_before_they_are_touched(name, arguments):
    with pytest.raises(ValueError, match=r"of a size that does not fit|C-contiguous|1 to 6"):
        getattr(compiled, name)(*arguments)


def test_a_read_only_result_is_refused():
    matrix = np.empty((6, 6))
    matrix.setflags(write=False)
    with pytest.raises(ValueError, match="read-only"):
        compiled.interaction_matrix(np.ones((2, 3)), np.ones((2, 3)), matrix, LEAST_DEPTH)


@pytest.mark.parametrize("arguments", [(), (np.eye(3),), (np.eye(3), "tolerance"), (3, 1e-6), (np.eye(3), 1e-6, 1)])
def test_wrong_arguments_are_type_errors(arguments):
    with pytest.raises(TypeError):
        compiled.is_rotation(*arguments)
