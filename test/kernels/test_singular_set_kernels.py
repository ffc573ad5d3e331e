"""The compiled stages of the singular set and their twins of numpy, each against the definition."""

from itertools import combinations

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from scipy.linalg import null_space
from strategies import numbers, seen_lines, vectors

from plsing_ros.kernels import compiled, of_numpy
from plsing_ros.singularities.bilinear_system import bilinear_tensor
from plsing_ros.singularities.ternary_forms import basis_values, half_sphere_points, multiplication_maps

BOTH = pytest.mark.parametrize("the", [compiled, of_numpy], ids=["compiled", "numpy"])
ON_LINE = 1e-12
SAMPLES = half_sphere_points(15)
INTERPOLATE = np.linalg.inv(basis_values(4, SAMPLES))
MULTIPLY = multiplication_maps(4)


def scene(seed, n=4):
    """Unit directions and the points closest to the origin, each (1, n, 3)."""
    direction, point = np.random.default_rng(seed).normal(size=(2, 1, n, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    return direction, point - (point * direction).sum(axis=2, keepdims=True) * direction


def ratios(the, direction, point, centers):
    centers = np.ascontiguousarray(centers, dtype=complex)
    found = np.empty(len(centers)), np.empty(len(centers))
    the.singularity_ratios(direction, point, centers, *found, ON_LINE)
    return found


def xi(direction, point, center):
    """[f, |f|^2 u] and [0, u x f] of each line, lengths in the root mean square distance, rows of unit length."""
    f = np.cross(direction, point - center)
    f /= np.sqrt((np.abs(f) ** 2).sum(axis=1).mean())
    rows = np.hstack([f, (f * f).sum(axis=1, keepdims=True) * direction])
    rows = np.vstack([rows, np.hstack([np.zeros_like(f), np.cross(direction, f)])])
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


@BOTH
@given(lines=seen_lines(min_size=3), real=vectors(), imaginary=vectors())
def test_ratios_are_those_of_the_definition(the, lines, real, imaginary):
    direction, point = lines.direction[np.newaxis], lines.point[np.newaxis]
    centers = np.array([real, real + 1j * np.asarray(imaginary)])
    ratio, distance = ratios(the, direction, point, centers)
    for i in range(2):
        away = np.linalg.norm(np.cross(direction[0], point[0] - centers[i]), axis=1)
        nearest = away.min() / np.sqrt((away**2).mean())
        assume(nearest > 1e-6)
        values = np.linalg.svd(xi(direction[0], point[0], centers[i]), compute_uv=False)
        assert ratio[i] == pytest.approx(values[5] / values[0], abs=1e-13)
        assert distance[i] == pytest.approx(nearest, rel=1e-9)


@BOTH
@pytest.mark.parametrize("offset", [0.0, 1e-12, 1e-9, 1e-6j, 1e-3 + 1e-4j])
def test_small_ratios_are_as_exact_as_rounding_of_the_matrix_allows(the, offset):
    direction, point = scene(1)
    # On a line that meets all four.
    way, origin = np.array([0.3, -0.5, 0.8]), np.array([0.2, 0.1, -0.4])
    point[0] = origin + way * np.array([[-2.0], [-1.0], [0.5], [1.5]])
    center = origin + 0.1 * way + offset * np.array([0.4, 0.3, -0.2])
    with mpmath.workdps(50):
        matrix = mpmath.matrix(xi(direction[0], point[0], center).tolist())
        values = mpmath.eighe(matrix.transpose_conj() * matrix, eigvals_only=True)
        exact = float(mpmath.sqrt(abs(min(values)) / max(values)))
    assert ratios(the, direction, point, center[np.newaxis])[0][0] == pytest.approx(exact, abs=2e-15)


@BOTH
def test_each_centre_may_have_its_own_lines(the):
    direction, point = (np.concatenate([scene(seed)[i] for seed in range(3)]) for i in range(2))
    centers = np.arange(9.0).reshape(3, 3)
    together = ratios(the, direction, point, centers)
    for i in range(3):
        alone = ratios(the, direction[i : i + 1], point[i : i + 1], centers[i : i + 1])
        np.testing.assert_allclose([together[0][i], together[1][i]], np.ravel(alone), rtol=1e-13)


@BOTH
def test_ratio_of_many_lines_and_where_nothing_is_fixed(the):
    direction, point = scene(2, n=70)
    center = np.array([[0.3, 0.2, 1j]])
    values = np.linalg.svd(xi(direction[0], point[0], center[0]), compute_uv=False)
    assert ratios(the, direction, point, center)[0][0] == pytest.approx(values[5] / values[0], rel=1e-12)
    # Parallel lines, and three lines through one point with the centre at it: all rows of xi are zero.
    assert ratios(the, np.broadcast_to([0.0, 0.0, 1.0], (1, 4, 3)).copy(), point[:, :4].copy(), center)[0][0] < 1e-15
    ratio, distance = ratios(the, np.eye(3)[np.newaxis], np.zeros((1, 3, 3)), np.zeros((1, 3)))
    assert (ratio[0], distance[0]) == (0.0, 0.0)


@BOTH
def test_rows_of_a_line_through_the_centre_are_zero(the):
    direction, point = scene(3, n=5)
    center = point[:, 0] + 2.0 * direction[:, 0]
    ratio, distance = ratios(the, direction, point, center)
    assert distance[0] <= ON_LINE
    rows = xi(np.delete(direction[0], 0, 0), np.delete(point[0], 0, 0), center[0])
    # The unit of length is that of all five lines.
    rows[:4, :3] /= np.sqrt(5.0 / 4.0)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    values = np.linalg.svd(rows, compute_uv=False)
    assert ratio[0] == pytest.approx(values[5] / values[0], rel=1e-9)


@BOTH
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e200])
def test_centres_that_are_not_finite_are_not_singular(the, value):
    centers = np.array([[0.0, 1.0, 2.0], [0.0, value, 2.0]])
    ratio, distance = ratios(the, *scene(4), centers)
    assert ratio[1] == 1.0
    assert distance[1] == np.inf
    assert ratio[0] < 1.0


@BOTH
@pytest.mark.parametrize("scale", [1e-140, 1e-100, 1e77, 1e100, 1e150])
def test_ratios_do_not_depend_on_the_unit_of_length(the, scale):
    direction, point = scene(5)
    centers = np.array([[0.3, 0.2, -0.5], [0.1, 0.4j, 0.2]])
    np.testing.assert_allclose(
        ratios(the, direction, point * scale, centers * scale), ratios(the, direction, point, centers), rtol=1e-12
    )


@BOTH
@pytest.mark.parametrize("size", [1e154, 1e200])
def test_centres_where_the_square_of_a_length_overflows_are_not_singular(the, size):
    direction, point = np.concatenate([np.eye(3), [[0.6, 0.8, 0.0]]])[np.newaxis], scene(5)[1]
    # Along the first line, whose own distance stays finite.
    ratio, distance = ratios(the, direction, point, np.array([[10.0 * size, 0.0, 0.0]]))
    assert (ratio[0], distance[0]) == (1.0, np.inf)


def framed(the, direction, foot):
    center, length, relative = np.empty((len(foot), 3)), np.empty(len(foot)), np.empty(foot.shape)
    good = the.scene_coordinates(direction, foot, center, length, relative, 1e-9, 1e-12)
    return good, center, length, relative


@BOTH
@pytest.mark.parametrize("n", [2, 4, 9])
@pytest.mark.parametrize("away", [0.0, 1e3])
def test_scene_frames(the, n, away):
    direction, foot = (np.concatenate([scene(seed, n)[i] for seed in range(5)]) for i in range(2))
    foot = foot + away
    good, center, length, relative = framed(the, direction, foot)
    assert good
    np.testing.assert_allclose((relative * direction).sum(axis=2), 0.0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(relative, axis=2).mean(axis=1), 1.0, rtol=1e-14)
    # The sum of the offsets is the gradient of the sum of squared distances.
    np.testing.assert_allclose(relative.sum(axis=1), 0.0, atol=1e-12)
    back = center[:, np.newaxis] + relative * length[:, np.newaxis, np.newaxis]
    np.testing.assert_allclose(np.cross(back - foot, direction), 0.0, atol=1e-12 * (1.0 + away))


@BOTH
def test_scene_frames_of_parallel_and_concurrent_lines(the):
    direction, foot = scene(6)
    parallel = np.broadcast_to(direction[:, :1], direction.shape).copy()
    _, center, _, relative = framed(the, parallel, foot)
    assert float((center[0] - foot[0].mean(axis=0)) @ direction[0, 0]) == pytest.approx(0.0, abs=1e-14)
    np.testing.assert_allclose(relative.sum(axis=1), 0.0, atol=1e-13)
    common = np.array([3.0, -2.0, 5.0])
    _, center, length, _ = framed(the, direction, common + direction * np.arange(4.0)[:, np.newaxis])
    np.testing.assert_allclose(center[0], common, rtol=1e-13)
    assert length[0] == 0.0


@BOTH
def test_scene_frames_that_overflow_are_refused(the):
    for value in (np.inf, np.nan, 1e308):
        direction, foot = scene(7)
        foot[0, 1, 2] = value
        assert not framed(the, direction, foot)[0]
        direction[0, 1, 2] = value
        assert not framed(the, direction, scene(7)[1])[0]


@BOTH
def test_the_margin_of_what_is_not_finite_is_no_number(the):
    direction, point = scene(7)
    point[0, 1, 2] = np.nan
    assert np.isnan(functionals_of(the, direction, point)[1][0])


def functionals_of(the, direction, point):
    functionals, margin = np.empty((len(direction), 10, 15)), np.empty(len(direction))
    the.quartic_functionals(direction, point, SAMPLES, INTERPOLATE, functionals, margin)
    return functionals, margin


def quartic_values(u, m, w):
    """The five minors at w from their definition: forces across their lines, in balance and without virial."""
    constraints = np.zeros((8, 12))
    for i in range(4):
        constraints[i, 3 * i : 3 * i + 3] = u[i]
        constraints[4:7, 3 * i : 3 * i + 3] = np.eye(3)
        constraints[7, 3 * i : 3 * i + 3] = m[i]
    rows = []
    for force in null_space(constraints).T.reshape(4, 4, 3):
        balance = sum((u[i] @ w) * (force[i] @ np.cross(u[i], m[i])) for i in range(4))
        rows.append([*(np.linalg.det([force[i], u[i], w]) for i in range(4)), balance])
    return [np.linalg.det(np.array(rows)[:, list(chosen)]) for chosen in combinations(range(5), 4)]


@BOTH
def test_functionals_vanish_on_the_five_quartics_and_on_nothing_else(the):
    direction, point = (np.concatenate([scene(seed)[i] for seed in range(4)]) for i in range(2))
    functionals, margin = functionals_of(the, direction, point)
    other = np.random.default_rng(0).normal(size=(15, 3))
    for s in range(4):
        np.testing.assert_allclose(functionals[s] @ functionals[s].T, np.eye(10), atol=1e-14)
        values = np.array([quartic_values(direction[s], point[s], w) for w in other])
        quartics = np.linalg.solve(basis_values(4, other), values)
        assert np.linalg.matrix_rank(quartics) == 5
        np.testing.assert_allclose(functionals[s] @ quartics, 0.0, atol=1e-11 * np.abs(quartics).max())
        assert 1e-9 < margin[s] <= 1.0


@BOTH
def test_the_margin_tells_a_special_scene(the):
    direction, point = scene(8)
    # Two parallel pairs.
    direction[0, 2:] = direction[0, :2]
    point -= (point * direction).sum(axis=2, keepdims=True) * direction
    assert functionals_of(the, direction, point)[1][0] < 1e-12


def axis_centers(the, direction, point, axes):
    """What the kernel makes of eigenvectors that are exactly those of axis directions (at most ten, real)."""
    rows = basis_values(4, axes)
    functionals = np.linalg.qr(np.vstack([rows, np.random.default_rng(3).normal(size=(10, 15))])[:10].T)[0].T
    vectors = np.ascontiguousarray(rows @ functionals.T, dtype=complex)
    imaginary = np.array([[0.0] * len(axes) + [-1.0] * (10 - len(axes))])
    w, h, center = (np.empty((len(axes), size), dtype=complex) for size in (3, 4, 3))
    functionals = np.ascontiguousarray(functionals[np.newaxis])
    the.axis_centers(imaginary, functionals, MULTIPLY, direction, point, vectors, w, h, center, 1e-9)
    return w, h, center


@BOTH
@pytest.mark.parametrize("seed", range(5))
def test_centres_of_axis_directions(the, seed):
    direction, point = scene(seed)
    w, center = np.random.default_rng(seed).normal(size=(2, 3))
    across = w - (direction[0] @ w)[:, np.newaxis] * direction[0]
    # Lines that the condition P_i w . (M_i - C) = 0 holds for.
    point = center + np.cross(across, point)
    point -= (point * direction).sum(axis=2, keepdims=True) * direction
    found_w, h, found = axis_centers(the, direction, point, w[np.newaxis])
    np.testing.assert_allclose(np.cross(found_w[0], w), 0.0, atol=1e-12)
    np.testing.assert_allclose(found[0], center, rtol=1e-10)
    np.testing.assert_allclose(h[0, 1:] / h[0, 0], center, rtol=1e-10)
    assert np.linalg.norm(h[0]) == pytest.approx(1.0, rel=1e-14)


@BOTH
def test_a_centre_at_infinity(the):
    direction, point = scene(9)
    direction[0, :, 0] = 0.0
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    _, h, center = axis_centers(the, direction, point, np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(np.abs(h[0]), [0.0, 1.0, 0.0, 0.0], atol=1e-14)
    assert np.isnan(center).all()


@BOTH
def test_conjugates_are_filled_in(the):
    imaginary = np.array([[0.0, 2.0, -2.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0], [1.0, -1.0] * 5])
    count = int((imaginary >= 0.0).sum())
    generator = np.random.default_rng(0)
    center = generator.normal(size=(count, 3)) + 1j * generator.normal(size=(count, 3))
    real = np.append(imaginary[0][imaginary[0] >= 0.0] == 0.0, [False] * 5)
    center[real] = center[real].real
    h = np.hstack([np.ones((count, 1)), center])
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    residual = generator.random(count)
    ten, residuals = np.empty((2, 10, 3), dtype=complex), np.empty((2, 10))
    flags, overlap = np.empty((2, 10)), np.empty(2)
    filled = ten, residuals, flags, overlap
    the.with_conjugates(imaginary, h, center, residual, *filled, 1e-10)
    first = [0, 1, 1, 2, 3, 3, 4, 5, 6, 7]
    source = np.array([first, np.repeat(np.arange(8, 13), 2)])
    np.testing.assert_array_equal(
        ten, np.where(imaginary[..., np.newaxis] < 0.0, center[source].conj(), center[source])
    )
    np.testing.assert_array_equal(residuals, residual[source])
    np.testing.assert_array_equal(flags > 0.0, real[source])
    assert (overlap < 0.999).all()
    # One that is there twice, though it looks different as a homogeneous vector; and one at infinity.
    h[5] = 1j * h[4]
    h[9], center[9] = h[8].conj(), np.nan
    the.with_conjugates(imaginary, h, center, residual, *filled, 1e-10)
    np.testing.assert_allclose(overlap, 1.0, rtol=1e-14)
    assert np.isnan(ten[1, 2:4]).all()
    assert not flags[1].any()


@BOTH
@given(offset=vectors(10, -1.0, 1.0), turn=numbers(0.0, 6.0))
def test_newton_finds_a_zero_back(the, offset, turn):
    parts = np.random.default_rng(1).normal(size=(2, 4 * 8 * 6 + 4 + 6))
    tensor, h, k = np.split(parts[0] + 1j * parts[1], [192, 196])
    h, k = h / np.linalg.norm(h), k / np.linalg.norm(k)
    tensor = tensor.reshape(1, 4, 8, 6)
    value = np.einsum("a,aij,j->i", h, tensor[0], k)
    tensor = tensor - np.einsum("a,i,j->aij", h.conj(), value, k.conj())
    start = 1e-2 * np.exp(1j * turn) * offset
    x, y = (h + start[:4])[np.newaxis], (k + start[4:])[np.newaxis]
    assert the.bilinear_newton(tensor, x, y, 12, 0.0, 1e-8, 3.0)
    # Zeros have any phase.
    assert abs(x[0] @ h.conj()) == pytest.approx(1.0, rel=1e-12)
    assert abs(y[0] @ k.conj()) == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(np.einsum("a,aij,j->i", x[0], tensor[0], y[0]), 0.0, atol=1e-12)


@BOTH
def test_newton_stays_where_the_jacobian_is_singular(the):
    tensor = np.zeros((1, 4, 8, 6), dtype=complex)
    h, k = np.eye(4, dtype=complex)[:1], np.eye(6, dtype=complex)[:1]
    # The compiled one says so instead.
    assert the.bilinear_newton(tensor, h, k, 12, 0.0, 1e-8, 3.0) is (the is of_numpy)
    np.testing.assert_array_equal([h[0, 0], k[0, 0]], 1.0)


def test_newton_of_more_lines():
    direction, point = scene(11, n=6)
    way = np.array([0.3, -0.5, 0.8])
    point[0] = way * np.arange(1.0, 7.0)[:, np.newaxis]
    tensor = bilinear_tensor(direction, point - (point * direction).sum(axis=2, keepdims=True) * direction)
    # The centre half a length along the line that meets all six loses the translation along it.
    h, k = np.array([[1.0, *(0.5 * way)]]), np.array([[*way, 0.0, 0.0, 0.0]])
    h, k = h / np.linalg.norm(h), k / np.linalg.norm(k)
    np.testing.assert_allclose(np.einsum("a,aij,j->i", h[0], tensor[0], k[0]), 0.0, atol=1e-14)
    x, y = h + 1e-3 + 0j, k - 1e-3 + 0j
    assert of_numpy.bilinear_newton(tensor.astype(complex), x, y, 12, 0.0, 1e-8, 3.0)
    np.testing.assert_allclose(np.einsum("a,aij,j->i", x[0], tensor[0], y[0]), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("singularity_ratios", (*scene(0), np.zeros((2, 3)), np.empty(2), np.empty(2), 0.0)),
        ("singularity_ratios", (*scene(0, 2), np.zeros((2, 3), complex), np.empty(2), np.empty(2), 0.0)),
        ("singularity_ratios", (*np.ones((2, 2, 4, 3)), np.zeros((3, 3), complex), *np.ones((2, 3)), 0.0)),
        ("axis_centers", (np.zeros((1, 10)), np.ones((1, 10, 15)), MULTIPLY, *scene(0), np.ones((9, 10), complex),
                          np.ones((9, 3), complex), np.ones((9, 4), complex), np.ones((9, 3), complex), 0.0)),
        ("with_conjugates", (-np.ones((1, 10)), np.ones((0, 4), complex), np.ones((0, 3), complex), np.ones(0),
                             np.ones((1, 10, 3), complex), np.ones((1, 10)), np.ones((1, 10)), np.ones(1), 0.0)),
        ("with_conjugates", (np.ones((1, 10)), np.ones((9, 4), complex), np.ones((9, 3), complex), np.ones(9),
                             np.ones((1, 10, 3), complex), np.ones((1, 10)), np.ones((1, 10)), np.ones(1), 0.0)),
        ("bilinear_newton", (np.ones((2, 4, 10, 6), complex), np.ones((2, 4), complex), np.ones((2, 6), complex),
                             1, 0.0, 0.0, 1.0)),
        ("scene_coordinates", (np.ones((2, 4, 3)), np.ones((2, 3, 3)), np.ones((2, 3)), np.ones(2),
                               np.ones((2, 4, 3)), 0.0, 0.0)),
        ("scene_coordinates", (np.ones(9), np.ones(9), np.ones((9, 3)), np.ones(9), np.ones(9), 0.0, 0.0)),
        ("quartic_functionals", (*scene(0), SAMPLES[:14].copy(), INTERPOLATE, np.ones((1, 10, 15)), np.ones(1))),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_refused(name, arguments):
    with pytest.raises(ValueError, match=r"of a size that does not fit|lines for|eigenv"):
        getattr(compiled, name)(*arguments)
