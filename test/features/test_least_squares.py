# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from plsing_ros.errors import GeometryError
from plsing_ros.features import feature_error, solve_least_squares


@pytest.mark.parametrize(
    "shape", [(12, 6), (9, 6), (5, 6), (3, 6), (12, 1), (12, 3), (12, 5), (9, 2), (6, 5), (1, 2), (0, 4)]
)
def test_the_shortest_of_the_least_squares_solutions(shape):
    matrix, right_side = np.random.default_rng(0).normal(size=shape), np.linspace(-1.0, 2.0, shape[0])
    expected = np.linalg.lstsq(matrix, -0.5 * right_side, rcond=None)[0]
    found = solve_least_squares(matrix, right_side, -0.5)
    np.testing.assert_allclose(found.solution, expected, atol=1e-13)
    assert (found.singular_values > 0.0).sum() == min(shape)


@pytest.mark.parametrize("rows", [3, 6, 12])
@pytest.mark.parametrize("more", [-3, -1, 1])
def test_a_right_side_of_another_length_is_refused(rows, more):
    with pytest.raises(GeometryError, match=rf"\b{rows + more}\b.*interaction matrix.*\b{rows}\b"):
        solve_least_squares(np.ones((rows, 6)), np.ones(rows + more))


@pytest.mark.parametrize("lengths", [(9, 12), (12, 9)])
def test_features_of_different_lengths_have_no_difference(lengths):
    with pytest.raises(GeometryError, match=r"\bs\b.*\b{}\b.*s\*.*\b{}\b".format(*lengths)):
        feature_error(np.zeros(lengths[0]), np.zeros(lengths[1]))
