# SPDX-License-Identifier: Apache-2.0
"""Five and more lines with classes of parallel ones: their answers by geometry, without a search."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from singular_scenes import box_edges, distance_to_line, line_set, min_ratio, singular_centers

from plsing_ros.singularities import IsolatedStatus, Kind, singular_set

X, Y, Z = np.eye(3).tolist()


def edges(*numbers):
    points, directions = box_edges()
    return [points[i] for i in numbers], [directions[i] for i in numbers]


def test_many_parallel_lines_and_another():
    points, directions = np.random.default_rng(1).normal(size=(2, 12, 3))
    lines = line_set((points, [*[directions[0]] * 11, directions[1]]))
    singular = singular_set(lines)
    assert singular.isolated_status is IsolatedStatus.NONE
    (plane,) = singular.surfaces
    # Only in the plane through the other line, of lines that meet it and the parallel ones at infinity.
    centers = singular_centers(lines)
    assert len(centers) > 10
    np.testing.assert_allclose(plane.value(centers) / np.linalg.norm(plane.gradient(centers), axis=1), 0.0, atol=1e-6)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_parallel_lines_on_a_circular_cylinder_and_another(count):
    """Turning about their direction is unobservable where the cylinder meets a plane across the other line."""
    angles = np.array([0.1, 1.2, 2.0, 3.9, 5.5][:count])
    points = [*np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1), [0.3, 0.2, 0.5]]
    lines = line_set((points, [Z] * count + [[1, 2, 1]]))
    singular = singular_set(lines)
    assert singular.isolated_status is IsolatedStatus.POSITIVE_DIMENSIONAL
    (ellipse,) = singular.curves
    assert ellipse.name == "ellipse"
    centers = singular_centers(lines)
    on_cylinder = centers[np.abs(np.hypot(centers[:, 0], centers[:, 1]) - 1.0) < 1e-6]
    assert len(on_cylinder) > 10
    for center in on_cylinder:
        assert np.linalg.norm(ellipse.closest_point(center) - center) < 1e-6
    for point in ellipse.polyline(np.zeros(3), 10.0, 7):
        assert min_ratio(lines, point) < 1e-12


def test_a_singular_plane_without_transversals():
    """Four edges of one face of a box, and two across it: turning about the face's normal is lost all over the face."""
    lines = line_set(edges(0, 1, 4, 5, 8, 9))
    singular = singular_set(lines)
    assert [surface.kind for surface in singular.surfaces] == [Kind.PLANE]
    (plane,) = singular.surfaces
    np.testing.assert_allclose(plane.coefficients / plane.coefficients[3], [0, 0, 0, 1], atol=1e-12)
    assert singular.isolated_status is IsolatedStatus.POSITIVE_DIMENSIONAL
    for x, y in np.random.default_rng(2).normal(size=(10, 2)):
        assert min_ratio(lines, [x, y, 0.0]) < 1e-12
        assert min_ratio(lines, [x, y, 0.3]) > 1e-6
    # The line that meets all others is one of them.
    assert singular.transversals == () and "line 1" in str(singular).lower()
    for center in singular_centers(lines):
        off_line = distance_to_line(center, lines.point[0], lines.direction[0])
        assert min(abs(center[2]), off_line) < 1e-5


@pytest.mark.parametrize("flat", [[X, X, X], [X, X, Y, Y]], ids=["three parallel", "two pairs"])
@given(
    heights=st.lists(st.floats(0.5, 3.0), min_size=2, max_size=2),
    tilts=st.lists(st.floats(0.3, 2.0), min_size=2, max_size=2),
    place=st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=2),
)
@settings(max_examples=20, deadline=None)
def test_the_point_of_a_plane_that_two_other_lines_leave(flat, heights, tilts, place):
    """Turning about the normal moves no image line where the perpendiculars to the other lines are in the plane."""
    center = np.array([*place, 0.0])
    points = [[2.0 * i + 1.3, -1.7 * i - 1.2, 0.0] for i in range(len(flat))]
    # Lines whose point nearest to the centre is in the plane of the others, tilted across the way to it.
    feet = [center + heights[0] * np.array([0.6, 0.8, 0.0]), center + heights[1] * np.array([-0.28, 0.96, 0.0])]
    directions = [[-0.8, 0.6, tilts[0]], [-0.96, -0.28, -tilts[1]]]
    lines = line_set(([*points, *feet], [*flat, *directions]))
    assert min_ratio(lines, center) < 1e-12
    singular = singular_set(lines)
    assert singular.isolated_status is IsolatedStatus.FINITE
    assert np.abs(singular.isolated_points - center).max(axis=1).min() < 1e-7
    assert singular.isolated_point_residuals.max() <= 1e-9
    # A third such line elsewhere leaves nothing.
    more = line_set(([*points, *feet, [0.4, 0.3, 2.0]], [*flat, *directions, [1.0, 1.0, 0.5]]))
    assert min_ratio(more, center) > 1e-9
    assert len(singular_set(more).isolated_points) == 0


@pytest.mark.parametrize("apart", [0.0, 1e-9, 2e-9, 3e-9])
def test_a_point_of_two_planes_that_are_nearly_one_is_found(apart):
    """Two pairs whose planes are neither equal nor certainly different: singular to rounding at a point near both."""
    center = np.array([0.3, -0.2, 0.0])
    feet = [[1.5, 0.7, 0.0], [-0.6, 1.9, 0.0]]
    points = [[0.0, 1.0, 0.0], [0.0, -1.3, 0.0], [1.0, 0.0, apart], [-1.2, 0.0, apart], *feet]
    to_feet = np.array(feet) - center
    across = np.cross(Z, to_feet / np.linalg.norm(to_feet, axis=1, keepdims=True))
    singular = singular_set(line_set((points, [X, X, Y, Y, *(across + [[0.0, 0.0, 0.9], [0.0, 0.0, -0.5]])])))
    assert singular.isolated_status is IsolatedStatus.FINITE
    (point,) = singular.isolated_points
    np.testing.assert_allclose(point, center, atol=1e-7)
    assert min_ratio(singular.lines, point) <= 1e-9


def test_two_classes_that_disagree_leave_nothing():
    """Three edges each of two directions: the motion would have to turn about both."""
    singular = singular_set(line_set(edges(0, 1, 2, 4, 5, 6)))
    assert singular.isolated_status is IsolatedStatus.NONE


@pytest.mark.parametrize(("count", "others"), [(4, 1), (5, 1), (4, 2)])
def test_concurrent_lines_and_others(count, others):
    """Edges of a spire and lines beside it: the plane of each other line and the tip, and points, are all there is."""
    generator = np.random.default_rng(count + others)
    points = [*np.zeros((count, 3)), *generator.normal(size=(others, 3))]
    lines = line_set((points, generator.normal(size=(count + others, 3))))
    singular = singular_set(lines)
    assert singular.isolated_status in (IsolatedStatus.FINITE, IsolatedStatus.NONE)
    assert len(singular.isolated_points) == (2 if (count, others) == (4, 1) else 0)
    centers = singular_centers(lines)
    assert len(centers) > 5
    for center in centers:
        assert singular.nearest_locus(center).distance < 1e-5 * (1.0 + np.linalg.norm(center))
