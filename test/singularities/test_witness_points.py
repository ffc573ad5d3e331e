# SPDX-License-Identifier: Apache-2.0
"""Curves of singular centres in scenes without parallel lines: all that a search finds is on a listed locus."""

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from messages import mentions
from singular_scenes import PAPER_FOUR, line_set, min_ratio, singular_centers

from plsing_ros.analysis.loci_text import place_in_words
from plsing_ros.singularities import Kind, singular_set

numbers = st.floats(-2.0, 2.0).map(lambda value: round(value, 3))
vectors = st.tuples(numbers, numbers, numbers).map(np.array)


def of_segments(ends):
    ends = np.array(ends, dtype=float)
    return line_set((ends.mean(axis=1), ends[:, 1] - ends[:, 0]))


def assert_complete(lines, starts=60):
    """All loci are singular, and all centres that a search finds are on one of them."""
    singular = singular_set(lines)
    for locus in singular.loci:
        for center in locus.samples[:6]:
            assert min_ratio(lines, center) < 1e-8, locus.name
    centers = singular_centers(lines, starts)
    for center in centers:
        size = singular.frame.length + np.linalg.norm(center - singular.frame.center)
        near = min((locus.distance(center) for locus in singular.loci), default=np.inf)
        # A search ends less near to a point that counts several times.
        assert near < 2e-3 * size
    return singular, centers


@settings(max_examples=6, deadline=None)
@given(way=st.lists(vectors, min_size=3, max_size=3), point=vectors, other=vectors)
@example(
    way=[np.array([0.0, 1.0, -0.75]), np.array([1.453, 0.0, -1.217]), np.array([0.941, 1.274, 0.993])],
    point=np.array([0.0, -0.5, -1.25]),
    other=np.array([-1.125, -0.16, 2.0]),
)
def test_three_concurrent_lines_and_another(way, point, other):
    directions = np.array([*way, other])
    length = np.linalg.norm(directions, axis=1)
    assume(length.min() > 0.3)
    unit = directions / length[:, np.newaxis]
    assume(abs(np.linalg.det(unit[:3])) > 0.1)
    assume(min(np.linalg.norm(np.cross(unit[i], unit[j])) for i, j in combinations(range(4), 2)) > 0.2)
    assume(np.linalg.norm(np.cross(point, unit[3])) > 0.2)
    singular, _ = assert_complete(line_set(([[0.0] * 3] * 3 + [point], directions)))
    curves = [curve for curve in singular.curves if curve.kind is Kind.CURVE]
    assert curves
    for curve in curves:
        points = curve.polyline(singular.frame.center, 5.0 * singular.frame.length)
        points = points[np.isfinite(points).all(axis=1)]
        assert max((min_ratio(singular.lines, each) for each in points[::20]), default=0.0) < 1e-8
        # The closest of the curve, by comparison with all that is drawn.
        place = singular.frame.center + singular.frame.length * np.array([0.4, -0.7, 0.3])
        drawn = min((np.linalg.norm(points - place, axis=1)).tolist(), default=np.inf)
        assert np.linalg.norm(curve.closest_point(place) - place) <= drawn + 1e-9


CORNERS = np.array(list(product((0.0, 1.0), repeat=3)))
JOINS = list(combinations(CORNERS, 2))
TOPS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
SIDES = list(combinations(TOPS, 2))
SCENES = {
    "cube, a line of turns about a diagonal of a face": ([JOINS[i] for i in (3, 6, 8, 25)], Kind.STRAIGHT_LINE),
    "cube, another": ([JOINS[i] for i in (4, 20, 23, 24)], Kind.STRAIGHT_LINE),
    "cube, two diagonals of a face and others": ([JOINS[i] for i in (0, 18, 24, 25)], Kind.STRAIGHT_LINE),
    "tetrahedron, a face and an edge": ([SIDES[i] for i in (0, 1, 3, 5)], Kind.CURVE),
    "tetrahedron, a corner and an edge": ([SIDES[i] for i in (0, 1, 2, 5)], Kind.CURVE),
    "five lines of which each four have a curve": (
        [
            ([0, 0.72, 0.236], [0, 1.67, 0.548]),
            ([0, 0.72, 0.236], [0, 1.67, -0.076]),
            ([0.457, 0.72, 0.236], [0.973, 1.534, -0.031]),
            ([0, 1.441, 0.236], [0, 1.441, 1.236]),
            ([0.457, 1.441, 0], [1.457, 1.441, 0]),
        ],
        None,
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_scenes_of_solids(name):
    ends, kind = SCENES[name]
    singular, centers = assert_complete(of_segments(ends), 120)
    assert len(centers) > 0 or kind is None
    assert kind is None or kind in {curve.kind for curve in singular.curves}
    assert kind is not Kind.CURVE or "curve: through" in str(singular)
    for locus in singular.loci:
        assert kind is not Kind.CURVE or locus.kind is not kind or mentions(place_in_words(locus), "curve")


def test_general_lines_have_no_curve():
    assert singular_set(line_set(PAPER_FOUR)).curves == ()
