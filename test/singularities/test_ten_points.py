# SPDX-License-Identifier: Apache-2.0
"""Why there are ten isolated points: counted exactly, and found on thousands of random scenes."""

from itertools import combinations

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from singular_scenes import PAPER_FOUR, integer_scenes, line_set, min_ratio, same_points

from plsing_ros.errors import GeometryError
from plsing_ros.singularities import IsolatedStatus, singular_set, solve_four_line_scenes
from plsing_ros.singularities.isolated_points import are_distinct
from plsing_ros.singularities.proofs.exact import exact_point_count

PRIME = 32003
x, y = sp.symbols("x y")
# A chart of the plane of axis directions in which none of the twenty is at infinity or above another.
CHART = sp.Matrix([[2, 3, 7], [5, -3, 1], [-4, 2, 9]])
AXIS = CHART * sp.Matrix([x, y, 1])

INTEGER_SCENES = [
    PAPER_FOUR,
    ([[1, 0, 2], [0, 3, -1], [2, 2, 5], [-3, 1, 1]], [[1, 2, 2], [2, -1, 3], [0, 1, 4], [3, 1, -2]]),
    ([[0, 1, 1], [5, 0, -2], [1, -4, 0], [2, 3, 7]], [[2, 1, -1], [1, 1, 3], [4, -1, 1], [-1, 2, 5]]),
]


def quartic_and_quintic(points, directions):
    """Q, R and the four cubic minors D_j of docs/theory.md in the chart, times products of u . u."""
    w = AXIS
    rows, turned = [], []
    for point, u in zip(points, directions, strict=True):
        point, u = sp.Matrix(point), sp.Matrix(u)
        across = u.dot(u) * w - u * u.dot(w)
        rows.append([*across, across.dot(point)])
        turn = -u.dot(w) * w.cross(u)
        turned.append([*turn, turn.dot(point)])
    matrix = sp.Matrix(rows)
    quartic = sp.expand(matrix.det(method="berkowitz"))
    quintic = 0
    for i in range(4):
        replaced = matrix.copy()
        replaced[i, :] = sp.Matrix([turned[i]])
        quintic += replaced.det(method="berkowitz")
    cubics = [sp.expand(matrix[[i for i in range(4) if i != j], :3].det(method="berkowitz")) for j in range(4)]
    return quartic, sp.expand(quintic), cubics


def eliminant(first, second):
    """The resultant in x over a prime field, monic: its roots are the y of the common zeros."""
    reduced = []
    for polynomial in (first, second):
        whole = sp.Poly(polynomial, x, y, domain="QQ").clear_denoms(convert=True)[1]
        reduced.append(sp.Poly(whole.as_expr(), x, y, modulus=PRIME))
    return sp.Poly(reduced[0].resultant(reduced[1]).as_expr(), y, modulus=PRIME).monic()


@pytest.mark.slow
@pytest.mark.parametrize("scene", INTEGER_SCENES)
def test_twenty_is_four_and_six_and_ten(scene):
    points, directions = scene
    quartic, quintic, cubics = quartic_and_quintic(points, directions)
    twenty = eliminant(quartic, quintic)
    assert twenty.degree() == 20
    assert sp.gcd(twenty, twenty.diff()).degree() == 0, "twenty different zeros"

    four = sp.Poly(1, y, modulus=PRIME)
    for u in directions:
        at = CHART.adjugate() * sp.Matrix(u)
        four *= sp.Poly(at[2] * y - at[1], y, modulus=PRIME)
    assert sp.rem(twenty, four.monic()).is_zero, "the four w = u_i"

    six = sp.Poly(0, y, modulus=PRIME)
    for first, second in combinations(cubics, 2):
        six = sp.gcd(six, eliminant(first, second))
    assert six.degree() == 6
    rest, remainder = sp.div(sp.quo(twenty, four.monic()), six.monic())
    assert remainder.is_zero, "the six w with rank [P_i w] = 2"
    assert rest.degree() == 10

    # The ten are where the force matrix loses rank: C(5, 2), the degree of a 5 x 4 matrix of linear forms.
    minors = force_minors(points, directions)
    common = sp.Poly(0, y, modulus=PRIME)
    for first, second in list(combinations(minors, 2))[:4]:
        common = sp.gcd(common, eliminant(first, second))
    assert common.monic() == rest.monic()


def force_minors(points, directions):
    """The five 4 x 4 minors of the force matrix, built here from its definition."""
    w = AXIS
    u = [sp.Matrix(v) for v in directions]
    constraints = sp.zeros(8, 12)
    for i in range(4):
        constraints[i, 3 * i : 3 * i + 3] = u[i].T
        constraints[4:7, 3 * i : 3 * i + 3] = sp.eye(3)
        constraints[7, 3 * i : 3 * i + 3] = sp.Matrix(points[i]).T
    rows = []
    for force in constraints.nullspace():
        f = [force[3 * i : 3 * i + 3, :] for i in range(4)]
        balance = sum(u[i].dot(w) * f[i].dot(u[i].cross(sp.Matrix(points[i]))) / u[i].dot(u[i]) for i in range(4))
        rows.append([*(sp.Matrix.hstack(f[i], u[i], w).det() for i in range(4)), balance])
    matrix = sp.Matrix(rows)
    assert matrix.shape == (4, 5)
    return [sp.expand(matrix[:, list(c)].det(method="berkowitz")) for c in combinations(range(5), 4)]


@given(scene=integer_scenes())
@settings(max_examples=8, deadline=None)
def test_the_number_of_real_points_is_that_of_exact_arithmetic(scene):
    exact = exact_point_count(*scene)
    assume(exact is not None)
    singular = singular_set(line_set(scene))
    assume(singular.isolated_status is IsolatedStatus.FINITE and len(singular.isolated_points_complex) == 10)
    assert len(singular.isolated_points) == exact.real


def test_exact_arithmetic_counts_the_paper():
    exact = exact_point_count(*PAPER_FOUR)
    assert (exact.distinct, exact.real) == (10, 6)


def scenes(seed, count):
    return np.random.default_rng(seed).normal(size=(2, count, 4, 3))


def nearly_equal_points(count):
    points, directions = scenes(5, count)
    points[:, 1] = points[:, 0] + 1e-6 * np.random.default_rng(6).normal(size=(count, 3))
    return points, directions


@pytest.mark.parametrize(
    ("name", "points", "directions"),
    [
        ("general", *scenes(1, 10_000)),
        ("a thousandth of the size", *(lambda p, u: (1e-3 * p, u))(*scenes(2, 2000))),
        ("a thousand times the size", *(lambda p, u: (1e3 * p, u))(*scenes(3, 2000))),
        ("a thousand metres away", *(lambda p, u: (p + np.array([1e3, -1e3, 1e3]), u))(*scenes(4, 2000))),
        ("two lines a millionth apart", *nearly_equal_points(2000)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_ten_points_of_random_scenes(name, points, directions):
    batch = solve_four_line_scenes(points, directions)
    failed = np.flatnonzero(~batch.generic)
    assert len(failed) <= len(points) // 1000, f"{name}: {failed[:10]}"
    good = batch.generic
    assert batch.residual[good].max() <= 1e-9
    # Conjugates come in pairs, and real points have no imaginary part at all.
    assert (batch.real[good].sum(axis=1) % 2 == 0).all()
    for scene in np.flatnonzero(good)[:25]:
        lines = line_set((points[scene], directions[scene]))
        for center in batch.points[scene][batch.real[scene]].real:
            assert min_ratio(lines, center) <= 1e-9


def test_two_points_that_merge():
    """Two real points run into each other along a path of scenes; just before that both are found, just after none."""
    (points, other), (directions, _) = scenes(7, 2)
    path = lambda t: (points + t * (other - points), directions)  # noqa: E731

    def real(t):
        return len(singular_set(line_set(path(t))).isolated_points)

    times = np.linspace(0.0, 1.0, 60)
    counts = [real(t) for t in times]
    change = next(i for i in range(59) if counts[i] != counts[i + 1])
    low, high = times[change], times[change + 1]
    for _ in range(34):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if real(middle) == counts[change] else (low, middle)
    for t in (low, high):
        singular = singular_set(line_set(path(t)))
        assert (
            len(singular.isolated_points_complex) == 10
            or singular.isolated_status is not IsolatedStatus.FINITE
            or ("coincide" in singular.description)
        )
        assert singular.isolated_complex_residuals.max() <= 1e-9
    separations = []
    for step in (1e-2, 1e-4, 1e-6):
        t = low - step if counts[change] > counts[change + 1] else high + step
        singular = singular_set(line_set(path(t)))
        assert len(singular.isolated_points_complex) == 10
        p = singular.isolated_points
        separations.append(min(np.linalg.norm(a - b) for a, b in combinations(p, 2)))
    # Two simple zeros part like the square root of the distance from a double one.
    assert separations[1] < 0.5 * separations[0]
    assert separations[2] < 0.2 * separations[1]


def test_batch_agrees_with_one_by_one_and_does_not_depend_on_the_chunk():
    points, directions = scenes(8, 30)
    batch = solve_four_line_scenes(points, directions)
    small = solve_four_line_scenes(points, directions, chunk=7)
    np.testing.assert_array_equal(batch.real, small.real)
    for scene in range(30):
        singular = singular_set(line_set((points[scene], directions[scene])))
        assert same_points(batch.points[scene], singular.isolated_points_complex, 1e-7)
        assert same_points(small.points[scene], singular.isolated_points_complex, 1e-7)
        assert (batch.discriminant[scene] > 0.0) == (len(singular.transversals) == 2)


@pytest.mark.parametrize(("apart", "distinct"), [(1e-6, True), (1e-8, False)])
def test_two_points_nearer_than_a_ten_millionth_are_one(apart, distinct):
    """Whatever the phase of their homogeneous coordinates."""
    h = np.random.default_rng(0).normal(size=(2, 10, 4)) + 1j * np.random.default_rng(1).normal(size=(2, 10, 4))
    across = h[0, 4] - np.vdot(h[0, 2], h[0, 4]) / np.vdot(h[0, 2], h[0, 2]) * h[0, 2]
    size = np.linalg.norm(h[0, 2]) / np.linalg.norm(across)
    h[0, 9] = 1j * (h[0, 2] + apart * size * across)
    h /= np.linalg.norm(h, axis=2, keepdims=True)
    assert are_distinct(h).tolist() == [distinct, True]


def test_batch_names_the_line_without_direction():
    points, directions = scenes(9, 3)
    directions[1, 2] = 0.0
    with pytest.raises(GeometryError, match="scene 1, line 3"):
        solve_four_line_scenes(points, directions)
    points[0, 0, 0] = np.nan
    with pytest.raises(GeometryError, match="points"):
        solve_four_line_scenes(points, directions)


def test_batch_reports_special_scenes():
    points, directions = scenes(10, 4)
    directions[2, 1] = directions[2, 0]
    directions[3, :] = directions[3, 0]
    assert solve_four_line_scenes(points, directions).generic.tolist() == [True, True, False, False]
