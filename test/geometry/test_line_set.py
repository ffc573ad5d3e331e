# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from strategies import directions, line_sets, numbers, poses, vectors

from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet


def build(points=((0, 0, 0), (1, 2, 3)), directions=((1, 0, 0), (0, 1, 1)), **options):
    return LineSet.from_points_directions(points, directions, **options)


@given(point=vectors(), direction=directions(), along=numbers(-100, 100))
def test_any_point_and_length_of_direction_give_the_same_line(point, direction, along):
    first = LineSet.from_points_directions([point], [direction])
    second = LineSet.from_points_directions([point + along * direction], [3.7 * direction])
    np.testing.assert_allclose(second.direction, first.direction, atol=1e-12)
    np.testing.assert_allclose(second.moment, first.moment, atol=1e-9 * (1 + abs(along)))


@given(lines=line_sets(), T_b_a=poses())
def test_transformed_lines_go_through_the_transformed_points(lines, T_b_a):
    moved = lines.transformed(T_b_a, "b")
    for offset in (0.0, 2.5):
        point_a = lines.point + offset * lines.direction
        point_b = point_a @ T_b_a.rotation.T + T_b_a.translation
        np.testing.assert_allclose(np.cross(point_b, moved.direction), moved.moment, atol=1e-9)
    assert moved.frame == "b" and moved.ids == lines.ids


@given(lines=line_sets())
def test_the_stored_point_is_on_the_line_and_closest_to_the_origin(lines):
    np.testing.assert_allclose(np.cross(lines.point, lines.direction), lines.moment, atol=1e-12)
    np.testing.assert_allclose(np.einsum("ij,ij->i", lines.point, lines.direction), 0.0, atol=1e-12)


def test_reversing_keeps_the_line_and_turns_both_vectors():
    lines = build()
    np.testing.assert_array_equal(lines.reversed().direction, -lines.direction)
    np.testing.assert_allclose(lines.reversed().point, lines.point)


@given(lines=line_sets(min_size=2), T_b_a=poses())
def test_tolerances_and_pivots_go_with_their_lines(lines, T_b_a):
    points, std = lines.point + 3.0 * lines.direction, 1e-3 * np.arange(1.0, len(lines) + 1.0)
    known = LineSet.from_points_directions(points, lines.direction, position_std=std, direction_std=0.01)
    moved = known.transformed(T_b_a, "b").select([1, 0]).reversed()
    np.testing.assert_array_equal(moved.position_std, std[[1, 0]])
    np.testing.assert_array_equal(moved.direction_std, [0.01, 0.01])
    np.testing.assert_allclose(moved.pivot, points[[1, 0]] @ T_b_a.rotation.T + T_b_a.translation)
    assert not moved.exact and lines.exact


def test_values_are_copied_and_locked():
    source = np.array([[1.0, 0.0, 0.0]])
    lines = LineSet(source, np.zeros((1, 3)), "world")
    source[0, 0] = 5.0
    assert lines.direction[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        lines.direction[0, 0] = 2.0


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_very_short_and_long_directions_are_fine(scale):
    lines = build(directions=np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 1.0]]) * scale)
    np.testing.assert_allclose(lines.direction[0], [0.6, 0.8, 0.0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"directions": [[1, 0, 0], [0, 0, 0]]}, "line 2: its direction is zero"),
        ({"directions": [[1, 0, 0], [0, 0, 0]], "ids": [5, 8]}, "line 8: its direction is zero"),
        ({"points": [[0, 0, 0], [1, float("nan"), 0]]}, r"points\[1, 1\] is nan"),
        ({"directions": [[1, 0, 0], [float("inf"), 0, 0]]}, r"directions\[1, 0\] is inf"),
        ({"points": [], "directions": []}, r"shape \(0,\)"),
        ({"points": np.zeros((0, 3)), "directions": np.zeros((0, 3))}, "no lines"),
        ({"points": [[0, 0], [1, 2]]}, r"points has shape \(2, 2\), expected \(n, 3\)"),
        ({"points": [[0, 0, 0]]}, r"directions has shape \(2, 3\), expected \(1, 3\)"),
        ({"points": [["a", "b", "c"], [0, 0, 0]]}, "not an array of numbers"),
        ({"ids": [1]}, "1 ids for 2 lines"),
        ({"ids": [7, 7]}, "id 7 is given to more than one line"),
        ({"position_std": [0.1, -0.1]}, r"line 2: position_std is -0\.1; it must be at least 0"),
        ({"position_std": [0.1]}, r"position_std has shape \(1,\), expected \(2\)"),
        ({"direction_std": float("nan")}, r"direction_std\[0\] is nan"),
    ],
)
def test_what_is_not_lines_is_refused_by_name(arguments, message):
    with pytest.raises(GeometryError, match=message):
        build(**arguments)


def test_plucker_coordinates_that_are_no_line_are_refused():
    with pytest.raises(GeometryError, match=r"line 1\b.*direction.*length 2\b.*\b1\b"):
        LineSet(np.array([[2.0, 0, 0]]), np.zeros((1, 3)), "world")
    with pytest.raises(GeometryError, match=r"line 4\b.*moment.*orthogonal"):
        LineSet(np.array([[1.0, 0, 0]]), np.array([[1.0, 1.0, 0]]), "world", (4,))
