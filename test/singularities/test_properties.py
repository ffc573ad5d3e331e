# SPDX-License-Identifier: Apache-2.0
"""The singular set does not depend on how the scene is written down."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from singular_scenes import same_points
from strategies import line_sets, numbers, poses

from plsing_ros.geometry import LineSet
from plsing_ros.singularities import IsolatedStatus, singular_set
from plsing_ros.singularities.isolated_points import solve_ten_points
from plsing_ros.singularities.scene_frame import SceneFrame


def well_posed(lines):
    """Four lines far enough from special ones that rounding cannot change what is found; and the set."""
    assume(np.abs(np.cross(lines.direction[:, None], lines.direction)).max(axis=2)[np.triu_indices(4, 1)].min() > 1e-2)
    frame = SceneFrame.of(lines)
    assume(not frame.concurrent)
    ten = solve_ten_points(frame.direction[np.newaxis], frame.point[np.newaxis])
    assume(ten.complete[0] and ten.rank_margin[0] > 1e-4)
    # Points so far away, or so near to each other, that they move by more than the tolerance below with rounding; or so
    # near to an observed line that rounding says whether they are on it.
    center = ten.center[0]
    from_line = np.linalg.norm(np.cross(center[:, None] - frame.point, frame.direction), axis=2)
    assume((from_line > 1e-4 * (1.0 + np.linalg.norm(center, axis=1)[:, None])).all())
    apart = np.abs(center[:, None] - center).max(axis=2) + np.eye(10)
    assume(np.abs(center).max() < 1e3 and apart.min() > 1e-3)
    return singular_set(lines)


def assert_same_set(found, expected, to_expected):
    """found, with points mapped by to_expected, is the expected set."""
    assert found.case is expected.case
    assert found.family is expected.family
    assert found.isolated_status is expected.isolated_status is IsolatedStatus.FINITE
    scale = expected.frame.length
    assert same_points(to_expected(found.isolated_points) / scale, expected.isolated_points / scale, 1e-5)
    assert len(found.isolated_points_complex) == len(expected.isolated_points_complex)
    assert len(found.transversals) == len(expected.transversals)
    for transversal in expected.transversals:
        places = transversal.point + np.array([[0.0], [1.0]]) * scale * transversal.direction
        misses = []
        for other in found.transversals:
            point = to_expected(other.point[np.newaxis])[0]
            along = to_expected((other.point + other.direction)[np.newaxis])[0] - point
            along /= np.linalg.norm(along)
            misses.append(np.abs(np.cross(places - point, along)).max() / scale)
        assert min(misses) < 1e-5 * (1.0 + np.abs(transversal.point).max() / scale)


@given(lines=line_sets(min_size=4, max_size=4), pose=poses())
@settings(max_examples=30, deadline=None)
def test_moves_with_the_scene(lines, pose):
    expected = well_posed(lines)
    moved = singular_set(lines.transformed(pose, "other"))
    assert_same_set(moved, expected, lambda p: (p - pose.translation) @ pose.rotation)


@given(lines=line_sets(min_size=4, max_size=4), factor=st.sampled_from([1e-3, 0.1, 7.0, 1e3]))
@settings(max_examples=30, deadline=None)
def test_scales_with_the_scene(lines, factor):
    expected = well_posed(lines)
    scaled = singular_set(LineSet(lines.direction, lines.moment * factor, lines.frame, lines.ids))
    assert_same_set(scaled, expected, lambda p: p / factor)


@given(
    lines=line_sets(min_size=4, max_size=4),
    order=st.permutations(range(4)),
    signs=st.tuples(*[st.sampled_from([-1.0, 1.0])] * 4),
    along=st.tuples(*[numbers(-3.0, 3.0)] * 4),
)
@settings(max_examples=30, deadline=None)
def test_does_not_depend_on_order_orientation_or_points(lines, order, signs, along):
    expected = well_posed(lines)
    points = lines.point + np.array(along)[:, np.newaxis] * lines.direction
    directions = np.array(signs)[:, np.newaxis] * lines.direction * 2.5
    other = LineSet.from_points_directions(points[list(order)], directions[list(order)])
    singular = singular_set(other)
    assert_same_set(singular, expected, lambda p: p)
    # Names too: the first point is the first point.
    np.testing.assert_allclose(singular.isolated_points, expected.isolated_points, rtol=1e-4, atol=1e-4)


@given(lines=line_sets(min_size=1, max_size=7))
@settings(max_examples=60, deadline=None)
def test_any_scene_gets_an_answer_that_checks(lines):
    """Drawn values are often zero or equal: parallel, concurrent, repeated lines and worse are all among them."""
    singular = singular_set(lines)
    assert len(singular.locus_names) == len(set(singular.locus_names)) == len(singular.locus_kinds)
    assert singular.isolated_points.shape == (len(singular.isolated_point_residuals), 3)
    assert (singular.isolated_point_residuals <= 1e-9).all()
    assert (singular.isolated_complex_residuals <= 1e-9).all()
    assert np.isfinite(singular.distance_arrays([0.1, 0.2, 0.3]).distance).all()
    assert str(singular.case) in singular.description
    if len(lines) < 3:
        assert singular.singular_everywhere
