# SPDX-License-Identifier: Apache-2.0
"""Proofs: what is proved of which scenes, and that nothing wrong is."""

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from messages import mentions
from singular_scenes import PAPER_FOUR, line_set, min_ratio, orthogonal_lines, paper_lines
from test_paper_p5l import D6, S8, SPECIAL_D7
from test_special_scenes import EVERYWHERE, SPECIAL

from plsing_ros.singularities import IsolatedStatus, TransversalFamily, singular_set
from plsing_ros.singularities.proofs.certify import certify
from plsing_ros.singularities.proofs.exact import exact_family, exact_rank, exact_surfaces, exact_transversals
from plsing_ros.singularities.proofs.interval import certify_isolated_point, certify_transversal
from plsing_ros.singularities.proofs.rational_lines import rational_lines

PAPER = singular_set(line_set(PAPER_FOUR))
PAPER_PROOFS = certify(PAPER)


def named(proofs, name):
    return next(proof for proof in proofs.certificates if proof.name == name)


def test_the_papers_points_and_transversals_are_proved_and_complete():
    names = [proof.name for proof in PAPER_PROOFS.certificates]
    assert names[:2] == ["transversal 1", "transversal 2"]
    assert names[2:8] == [f"isolated point {i}" for i in range(1, 7)]
    assert names[10:] == ["what meets all lines", "all isolated points"]
    assert len(names) == 12
    assert all(proof.proved and proof.radius < 1e-9 for proof in PAPER_PROOFS.certificates)
    assert "hyperbolic" in named(PAPER_PROOFS, "what meets all lines").statement
    assert mentions(named(PAPER_PROOFS, "all isolated points").statement, "ten isolated points", 6, "real")
    assert mentions(PAPER_PROOFS.statement, "rational lines")


def test_lines_that_are_not_rational_get_enclosures_only():
    points, directions = PAPER_FOUR
    lines = line_set(
        (np.array(points) + np.sqrt(2.0) * np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0]]), directions)
    )
    assert rational_lines(lines) is None
    singular = singular_set(lines)
    proofs = certify(singular)
    assert all(proof.proved for proof in proofs.certificates)
    assert "all isolated points" not in [proof.name for proof in proofs.certificates]
    assert mentions(proofs.statement, "doubles")


def parallel(a, b):
    return all(a[i] * b[j] == a[j] * b[i] for i, j in ((0, 1), (1, 2), (0, 2)))


@given(
    numerators=st.tuples(*[st.integers(-999, 999)] * 3),
    denominators=st.tuples(*[st.integers(1, 9)] * 3),
    direction=st.tuples(*[st.integers(-999, 999)] * 3).filter(any),
)
@settings(max_examples=60, deadline=None)
def test_rational_lines_are_recovered_from_their_doubles(numerators, denominators, direction):
    point = [Fraction(*pair) for pair in zip(numerators, denominators, strict=True)]
    found = rational_lines(line_set(([point], [direction])))
    # A common denominator can be too large; then there is no answer, but never a wrong one.
    assume(found is not None)
    assert parallel(found.directions[0], direction)
    assert parallel([a - b for a, b in zip(found.points[0], point, strict=True)], direction)


def test_a_wrong_point_or_transversal_is_not_proved():
    lines = line_set(PAPER_FOUR)
    wrong = certify_isolated_point(lines, PAPER.frame, PAPER.isolated_points[0] + 1e-3, "wrong")
    assert not wrong.proved
    assert wrong.radius == np.inf
    transversal = PAPER.transversals[0]
    wrong = certify_transversal(lines, PAPER.frame, transversal.point + 1e-3, transversal.direction, "wrong")
    assert not wrong.proved


def test_three_lines_are_certified_by_their_polynomials():
    scene = [rows[:3] for rows in PAPER_FOUR]
    singular = singular_set(line_set(scene))
    proofs = certify(singular)
    assert [proof.name for proof in proofs.certificates] == ["what meets all lines", "quadric", "cubic surface"]
    assert all(proof.proved and proof.radius < 1e-12 for proof in proofs.certificates)
    # The exact polynomials themselves, against the rank of xi in exact arithmetic.
    quadric, cubic = exact_surfaces(*scene)
    assert max(sum(e) for e in quadric) == 2
    assert max(sum(e) for e in cubic) == 3
    for center in ([1, 2, 3], [-2, 0, 5], [0, 0, 1], [5, 0, 0], [2, 1, 1]):
        values = [
            sum(c * center[0] ** e[0] * center[1] ** e[1] * center[2] ** e[2] for e, c in polynomial.items())
            for polynomial in (quadric, cubic)
        ]
        assert (exact_rank(*scene, center) < 6) == (0 in values)


@pytest.mark.parametrize("name", SPECIAL)
def test_what_meets_special_lines_is_proved_exactly(name):
    points, directions, family, *_ = SPECIAL[name]
    assert exact_family(*rational(points, directions)) is family


def rational(points, directions):
    found = rational_lines(line_set((points, directions)))
    return found.points, found.directions


@pytest.mark.parametrize("name", EVERYWHERE)
def test_singular_everywhere_is_proved_exactly(name):
    singular = singular_set(line_set(EVERYWHERE[name][:2]))
    proofs = certify(singular)
    (proof,) = proofs.certificates
    assert proof.name == "singular everywhere"
    assert proof.proved


def test_concurrent_only_to_rounding_is_not_proved_exactly():
    # 1e-10 apart: concurrent to the tolerance, not exactly.
    points = [[1, 1, 1], [1, 1, 1], [1, 1, 1 + 1e-10], [1, 1, 1]]
    singular = singular_set(line_set((points, [[1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 1, 1]])))
    proofs = certify(singular)
    assert singular.singular_everywhere
    assert all(not proof.proved for proof in proofs.certificates)


def test_general_five_lines_are_proved_to_have_no_singularity():
    singular = singular_set(line_set(paper_lines(S8, (*D6, 11))))
    proofs = certify(singular)
    assert singular.isolated_status is IsolatedStatus.NONE
    assert [(proof.name, proof.proved) for proof in proofs.certificates] == [
        ("what meets all lines", True),
        ("all isolated points", True),
    ]
    assert all(len(proof.lines) == 5 for proof in proofs.certificates)


def test_the_papers_special_five_lines_share_exactly_one_line():
    points, directions = paper_lines([sp.Integer(s) for s in S8], (*map(sp.Integer, D6), SPECIAL_D7))
    exact = exact_transversals(points, directions)
    assert exact.null_dimension == 1
    assert exact.discriminant == 0
    # The doubles are other lines, which share none exactly: no claim about all five.
    singular = singular_set(line_set(paper_lines(S8, (*D6, float(SPECIAL_D7)))))
    proofs = certify(singular)
    (proof,) = proofs.certificates
    assert proof.proved
    assert len(proof.lines) == 4


@pytest.mark.parametrize("d", [(2, 3, 5, 1, 0, -4, 7), (2, 3, 5, 1, 7, -4, 2)])
def test_special_orthogonal_and_parallel_five_lines_share_exactly_one_line(d):
    singular = singular_set(line_set(orthogonal_lines(d)))
    proofs = certify(singular)
    proof = named(proofs, "what meets all lines")
    assert proof.proved
    assert len(proof.lines) == 5
    assert proof.radius < 1e-12
    assert mentions(proof.statement.lower(), "one line")


def lines_at_a_common_screw(count):
    """Rational lines whose images a screw (v, w) of a camera at the origin does not move.

    f is along P w, with the length that f . v + |f|^2 u . w = 0 asks for.
    """
    v, w = sp.Matrix([1, 2, -1]), sp.Matrix([2, -1, 3])
    directions = [[1, 1, 0], [2, 0, 1], [1, -1, 3], [0, 2, 1], [1, 3, 1], [3, 1, -2], [1, 0, 2]][:count]
    points = []
    for direction in directions:
        u = sp.Matrix(direction)
        across = w * u.dot(u) - u * u.dot(w)
        f = -across * (across.dot(v) * u.dot(u) / (across.dot(across) * u.dot(w)))
        points.append(list(f.cross(u) / u.dot(u)))
    return points, directions


@pytest.mark.parametrize("count", [5, 7])
def test_an_isolated_point_of_many_lines_is_proved_exactly(count):
    scene = lines_at_a_common_screw(count)
    assert exact_rank(*scene, [0, 0, 0]) == 5
    lines = line_set(scene)
    singular = singular_set(lines)
    proofs = certify(singular)
    np.testing.assert_allclose(singular.isolated_points, [[0, 0, 0]], atol=1e-9)
    proof = [each for each in proofs.certificates if len(each.lines) == count and each.name == "isolated point 1"]
    assert [each.proved for each in proof] == [True]
    assert named(proofs, "all isolated points").proved
    assert min_ratio(lines, singular.isolated_points[0]) < 1e-12


@given(scene=st.sampled_from(sorted(SPECIAL)), n=st.integers(3, 4), rows=st.permutations(range(4)))
@settings(max_examples=25, deadline=None)
def test_exact_and_rounded_family_agree(scene, n, rows):
    points, directions, *_ = SPECIAL[scene]
    chosen = [points[i] for i in rows[:n]], [directions[i] for i in rows[:n]]
    singular = singular_set(line_set(chosen))
    exact = exact_family(*rational(*chosen))
    assert singular.family is exact or (singular.singular_everywhere and exact is TransversalFamily.EVERYWHERE)
