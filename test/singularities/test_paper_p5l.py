# SPDX-License-Identifier: Apache-2.0
"""Five lines: what the paper prints."""

from itertools import combinations

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from singular_scenes import (
    PAPER_FOUR,
    box_edges,
    distance_to_line,
    line_set,
    min_ratio,
    nonzero,
    orthogonal_lines,
    paper_lines,
)

from plsing_ros.singularities import Case, IsolatedStatus, MotionKind, singular_set
from plsing_ros.singularities.proofs.exact import exact_transversals

S8 = (4, -5, 7, 3, -2, 13, -11, 6)
D6 = (2, 3, 5, 1, 7, -4)
SPECIAL_D7 = sp.Rational(128893236, 7630285) - 24 * sp.sqrt(8508173023861) / 7630285
L_M = np.array([0.0830, 0.4989, -0.8627])
D = sp.symbols("d1:8")


def plucker_condition(points, directions):
    """d . m of the null vector of the 5 x 6 Plücker matrix, from its maximal minors: zero for a singular complex."""
    rows = []
    for point, u in zip(points, directions, strict=True):
        u = sp.Matrix(u)
        rows.append([*u, *sp.Matrix(point).cross(u)])
    matrix = sp.Matrix(rows)
    null = []
    for left_out in range(6):
        minor = matrix[:, [c for c in range(6) if c != left_out]]
        null.append((-1) ** left_out * minor.det(method="berkowitz"))
    return null, sum(null[i] * null[i + 3] for i in range(3))


def test_no_singularity_for_the_general_example():
    singular = singular_set(line_set(paper_lines(S8, (*D6, 11))))
    assert singular.case is Case.P5L_REGULAR
    assert singular.transversals == ()
    assert singular.isolated_status is IsolatedStatus.NONE
    assert singular.isolated_points.shape == (0, 3)
    assert len(singular.isolated_points_complex) == 0
    assert singular.nearest_transversal.miss.max() > 0.1


def test_exactly_one_transversal_for_the_special_example():
    # The closed form is 7.71769; the paper prints 7.7178 next to it.
    assert float(SPECIAL_D7) == pytest.approx(7.7178, abs=1.5e-4)
    singular = singular_set(line_set(paper_lines(S8, (*D6, float(SPECIAL_D7)))))
    assert singular.case is Case.P5L_SINGULAR
    (transversal,) = singular.transversals
    direction = transversal.direction * np.sign(transversal.direction @ L_M)
    np.testing.assert_allclose(direction, L_M, atol=6e-5)
    np.testing.assert_allclose(np.cross(direction, transversal.point), [0.0, -0.9641, -0.5575], atol=6e-5)
    assert transversal.residual < 1e-13
    assert singular.isolated_status is IsolatedStatus.NONE
    place = transversal.point + 2.0 * transversal.direction
    (motion,) = singular.unobservable_motions(place)
    assert motion.kind is MotionKind.TRANSLATION
    np.testing.assert_allclose(np.abs(motion.linear @ transversal.direction), 1.0, atol=1e-12)


def test_the_special_parameter_is_exactly_special():
    points, directions = paper_lines(S8, (*D6, sp.Symbol("t")))
    _, condition = plucker_condition(points, directions)
    assert sp.simplify(condition.subs("t", SPECIAL_D7)) == 0
    assert sp.simplify(condition.subs("t", 11)) != 0


@pytest.mark.slow
def test_the_plucker_condition_has_degree_thirteen():
    s = sp.symbols("s1:9")
    rows = []
    for point, u in zip(*paper_lines(s, D), strict=True):
        u = sp.Matrix(u)
        rows.append([*u, *sp.Matrix(point).cross(u)])
    # Line 1 is the x axis, which makes the first component of the null vector zero; the others are 4 x 4 minors.
    matrix = sp.Matrix(rows)[1:, 1:]
    null = []
    for left_out in range(5):
        minor = matrix[:, [c for c in range(5) if c != left_out]].det(method="berkowitz")
        null.append(sp.Poly((-1) ** left_out * minor, *s, *D))
    condition = null[0] * null[3] + null[1] * null[4]
    assert condition.total_degree() == 13
    at_special = dict(zip((*s, *D), (*S8, *D6, SPECIAL_D7), strict=True))
    assert sp.simplify(condition.as_expr().subs(at_special)) == 0


def test_orthogonal_and_parallel_condition_has_the_papers_three_factors():
    d1, d2, d3, d4, d5, d6, d7 = D
    null, condition = plucker_condition(*orthogonal_lines(D))
    h = d5 * (d1 - d7) * (d1 * d2 * d4 - d1 * d4 * d6 - d2 * d4 * d7 + d3 * d5 * d6)
    quotient, remainder = sp.div(sp.expand(condition), sp.expand(h), *D)
    assert remainder == 0
    # What is left over is shared by the components or constant, so that it is no condition.
    shared = sp.gcd_list([value for value in map(sp.expand, null) if value != 0])
    assert sp.rem(sp.expand(shared**2), quotient, *D) == 0


def is_same_line(point, direction, other_point, other_direction):
    u, v = np.array(direction, dtype=float), np.array(other_direction, dtype=float)
    between = np.array(point, dtype=float) - np.array(other_point, dtype=float)
    return not np.cross(u, v).any() and not np.cross(between, v).any()


@given(d=st.tuples(*[nonzero()] * 7), which=st.integers(1, 3))
@settings(max_examples=25, deadline=None)
def test_orthogonal_and_parallel_lines_m1_m2_m3(d, which):
    d = [sp.Integer(value) for value in d]
    d1, d2, d3, d4, d5, d6, d7 = d
    if which == 1:
        d[4] = sp.Integer(0)
        point, direction = (d2, 0, 0), (0, 1, 0)
    elif which == 2:
        d[6] = d1
        point, direction = (0, d3, d1), (1, 0, 0)
    else:
        # The third factor, solved for d2.
        assume(d1 != d7)
        d[1] = (d1 * d4 * d6 - d3 * d5 * d6) / (d4 * (d1 - d7))
        assume(d[1] != 0)
        point = (d1 * d6 / (d1 - d7), 0, 0)
        direction = (-d6 / (d1 - d7), d4 / d5, 1)
    exact = exact_transversals(*orthogonal_lines(d))
    assume(exact.null_dimension == 1)
    assert exact.discriminant == 0
    points, directions = orthogonal_lines([float(value) for value in d])
    # An observed line that meets all others is listed as that line alone.
    assume(not any(is_same_line(point, direction, p, u) for p, u in zip(points, directions, strict=True)))
    singular = singular_set(line_set((points, directions)))
    assert singular.case is Case.P5L_ORTHOGONAL_PARALLEL
    (transversal,) = singular.transversals
    for place in (0.0, 1.0):
        on_it = np.array(point, dtype=float) + place * np.array(direction, dtype=float)
        assert distance_to_line(on_it, transversal.point, transversal.direction) < 1e-8 * (1.0 + np.abs(on_it).max())


def candidate_point(d):
    d1, d2, d3, d4, d5, d6, d7 = d
    x = (d1 * d2 * d4 + d1 * d4 * d6 - d2 * d4 * d7 - d3 * d5 * d6) / (2 * (d1 - d7) * d4)
    common = d1 * d2 * d4 - d1 * d4 * d6 - d2 * d4 * d7 - d3 * d5 * d6
    return x, -common / (2 * d5 * d6), -common / (2 * d4 * d6)


@pytest.mark.slow
def test_the_candidate_point_is_the_zero_of_all_ten_cubics():
    center = sp.Matrix(candidate_point(D))
    feet = []
    for point, u in zip(*orthogonal_lines(D), strict=True):
        u, offset = sp.Matrix(u), sp.Matrix(point) - center
        feet.append(offset - u * u.dot(offset))
    for triple in combinations(feet, 3):
        assert sp.cancel(sp.Matrix.hstack(*triple).det()) == 0


@given(d=st.tuples(*[nonzero()] * 7))
@settings(max_examples=12, deadline=None)
def test_the_candidate_point_is_not_singular_in_general(d):
    d1, d2, d3, d4, d5, d6, d7 = d
    assume(d1 not in (d5, d7) and d3 != d4 and d2 != d6 and d5 != d7)
    assume(d1 * d2 * d4 - d1 * d4 * d6 - d2 * d4 * d7 + d3 * d5 * d6 != 0)
    center = np.array([float(sp.Rational(value)) for value in candidate_point([sp.Integer(v) for v in d])])
    lines = line_set(orthogonal_lines(d))
    assume(min(distance_to_line(center, p, u) for p, u in zip(*orthogonal_lines(d), strict=True)) > 1e-3)
    points = singular_set(lines).isolated_points
    is_singular = min_ratio(lines, center) < 1e-12
    near = [point for point in points if np.linalg.norm(point - center) < 1e-6]
    assert bool(near) == is_singular


def test_five_lines_through_the_singular_screw_of_four():
    """A fifth line whose image the lost screw of four lines does not move keeps their point singular."""
    four = singular_set(line_set(PAPER_FOUR))
    center = four.isolated_points[1]
    (motion,) = four.unobservable_motions(center)
    w, v = motion.angular, motion.linear
    # The image of a line does not move if m . w = 0 and f . v + |f|^2 u . w = 0. The first holds for w in the plane of
    # u and f; so tilt u towards w by any angle, take the normal f in their plane, and let the second give |f|.
    across = np.cross(w, v)
    u = np.cos(0.4) * across / np.linalg.norm(across) + np.sin(0.4) * w
    normal = w - (w @ u) * u
    normal /= np.linalg.norm(normal)
    distance = -(normal @ v) / (u @ w)
    foot = center + distance * np.cross(normal, u)
    points, directions = PAPER_FOUR
    five = line_set(([*points, foot], [*directions, u]))
    assert min_ratio(five, center) < 1e-12
    singular = singular_set(five)
    assert singular.isolated_status is IsolatedStatus.FINITE
    np.testing.assert_allclose(singular.isolated_points, [center], atol=1e-9)
    assert singular.isolated_point_residuals.max() < 1e-12


@pytest.mark.parametrize("n", [9, 12])
def test_a_box_has_no_singularity_but_its_edges(n):
    points, directions = box_edges()
    singular = singular_set(line_set((points[:n], directions[:n])))
    assert singular.case is Case.PNL_REGULAR
    assert singular.transversals == ()
    assert singular.isolated_status is IsolatedStatus.NONE


def test_many_coplanar_lines_and_many_parallel_ones():
    points, directions = np.random.default_rng(1).normal(size=(2, 6, 3))
    flat = ([*(points * [1, 1, 0])], [*(directions * [1, 1, 0])])
    singular = singular_set(line_set(flat))
    assert singular.case is Case.PLANAR
    assert singular.isolated_status is IsolatedStatus.NONE
    # Every four of five parallel lines and another are singular on a curve at least; the curves share nothing.
    parallel = singular_set(line_set((points, [*[directions[0]] * 5, directions[1]])))
    assert parallel.isolated_status is IsolatedStatus.NONE
