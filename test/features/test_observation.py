# SPDX-License-Identifier: Apache-2.0
"""Observations made of rows that do not fit together."""

import numpy as np
import pytest

from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"visible": [True, False, True]}, "visible has 3 values for 2 ids"),
        ({"visible": [True]}, r"usable has shape \(1,\), expected \(2,\)"),
        ({"directions": [[1, 0, 0]]}, r"directions has shape \(1, 3\), expected \(2, 3\)"),
        ({"moments": [[0, 1, 0]]}, r"moments has shape \(1, 3\), expected \(2, 3\)"),
        ({"image_lines": [[0, 1, 0]]}, r"image_lines has shape \(1, 3\), expected \(2, 3\)"),
    ],
)
@pytest.mark.parametrize("seen", [[True, True], [True, False]])
def test_rows_of_other_lengths_are_refused(given, message, seen):
    rows = {"image_lines": [[0, 1, 0]] * 2, "directions": [[1, 0, 0]] * 2, "moments": [[0, 1, 0]] * 2, "visible": seen}
    arrays = {name: np.array(values) for name, values in (rows | given).items()}
    with pytest.raises(ObservationError, match=message):
        LineObservation.from_rows((1, 2), frame="camera", **arrays)


@pytest.mark.parametrize("covariance", [[1.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, -1.0]])
def test_a_covariance_that_is_none_is_refused_where_the_line_is_used(covariance):
    rows, covariances = np.array([[0.0, 1.0, 0.0]] * 2), np.array([[1e-6, 1e-7, 1e-6], covariance])
    with pytest.raises(ObservationError, match=r"covariance.*\bline 7\b"):
        LineObservation((3, 7), rows, covariances=covariances)
    seen = LineObservation((3, 7), rows, [True, False], covariances=covariances)
    np.testing.assert_array_equal(seen.usable_covariances, covariances[:1])


def test_ends_go_with_their_rows_and_are_refused_where_they_are_no_numbers():
    rows, ends = np.array([[0.0, 1.0, 0.0]] * 2), np.array([[0.0, 0.0, 1.0, 0.0], [0.5, 0.0, 0.7, 0.0]])
    seen = LineObservation.from_image_lines((3, 7), rows, ends=ends)
    np.testing.assert_array_equal(seen.select([1]).ends, ends[1:])
    for wrong in (ends[:, :3], np.full((2, 4), np.nan)):
        with pytest.raises(ObservationError, match="ends"):
            LineObservation((3, 7), rows, ends=wrong)


class CountedId(int):
    """An id that counts how often ids are compared."""

    compared = 0
    __hash__ = int.__hash__

    def __eq__(self, other):
        CountedId.compared += 1
        return int.__eq__(self, other)


def test_a_repeated_id_among_many_is_found_without_comparing_each_to_each(monkeypatch):
    """One big message must not occupy a node for minutes."""
    n = 1000
    monkeypatch.setattr(CountedId, "compared", 0)
    ids = tuple(map(CountedId, [*range(1, n + 1), n - 1, n]))
    with pytest.raises(ObservationError, match=rf"\bid {n - 1}\b"):
        LineObservation(ids, np.tile([0.0, 1.0, 0.0], (n + 2, 1)), np.ones(n + 2, dtype=bool), None)
    with pytest.raises(GeometryError, match=rf"\bid {n - 1}\b"):
        LineSet.from_points_directions(np.zeros((n + 2, 3)), np.ones((n + 2, 3)), ids=ids)
    assert CountedId.compared < 10 * n
