# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from strategies import seen_lines

from plsing_ros.errors import GeometryError
from plsing_ros.features import conditioning, interaction_matrix, inverse_condition_number
from plsing_ros.geometry import LineSet


@given(lines=seen_lines(min_size=3))
def test_is_the_inverse_of_numpys_condition_number(lines):
    interaction = interaction_matrix(lines)
    inverse = inverse_condition_number(interaction)
    assert 0.0 <= inverse <= 1.0
    assert inverse == pytest.approx(1.0 / np.linalg.cond(interaction), rel=1e-6, abs=1e-14)


@given(lines=seen_lines(min_size=3))
def test_the_scaled_one_does_not_depend_on_the_unit_of_length(lines):
    in_metres = conditioning(interaction_matrix(lines), 2.0)
    millimetres = LineSet.from_points_directions(1000 * lines.point, lines.direction)
    in_millimetres = conditioning(interaction_matrix(millimetres), 2000.0)
    assert in_millimetres.scaled_inverse_condition_number == pytest.approx(
        in_metres.scaled_inverse_condition_number, rel=1e-6, abs=1e-13
    )


@given(lines=seen_lines(min_size=3))
def test_the_weakest_motion_changes_the_image_by_the_smallest_singular_value(lines):
    interaction = interaction_matrix(lines)
    numbers = conditioning(interaction)
    assert np.linalg.norm(numbers.least_observable_direction) == pytest.approx(1.0)
    change = np.linalg.norm(interaction @ numbers.least_observable_direction)
    assert change == pytest.approx(numbers.smallest_singular_value, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("rows", [0, 2, 3, 6])
def test_fewer_than_three_lines_have_inverse_condition_number_zero(rows):
    lines = LineSet.from_points_directions([[0, 0, 2], [1, 1, 4.0]], [[1, 0, 0], [0, 1, 0.5]])
    numbers = conditioning(interaction_matrix(lines)[:rows])
    assert numbers.inverse_condition_number == pytest.approx(0.0, abs=1e-15)
    assert numbers.singular_values.shape == (6,)


def test_a_zero_matrix_is_not_a_division_by_zero():
    assert inverse_condition_number(np.zeros((9, 6))) == 0.0


@pytest.mark.parametrize("length", [0.0, -1.0, float("nan"), float("inf")])
def test_a_characteristic_length_that_is_not_positive_is_refused(length):
    with pytest.raises(GeometryError, match="characteristic_length"):
        conditioning(np.eye(6), length)


def test_a_matrix_of_another_shape_is_refused():
    with pytest.raises(GeometryError, match=r"matrix.*\(5, 5\).*\(n, 6\)"):
        conditioning(np.eye(5))
