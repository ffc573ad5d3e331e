# SPDX-License-Identifier: Apache-2.0
"""Rows of a message that are checked at once, against the class that checks them value by value."""

import dataclasses

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.features.good_rows import observation_of_good_rows
from plsing_ros.geometry import LineSet

COORDINATES = st.floats(-3.0, 3.0)
# What one number of one array may be instead.
SPOILT = st.sampled_from([np.nan, np.inf, -1.0, 0.0, 1.0, 1e-3, 1e300])


@st.composite
def rows(draw):
    """Arguments of from_rows: good ones, a line or two out of sight, and perhaps one number spoilt."""
    n = draw(st.integers(1, 6))
    points = np.array(draw(st.lists(st.tuples(COORDINATES, COORDINATES, st.floats(0.5, 5.0)), min_size=n, max_size=n)))
    angles = np.array(draw(st.lists(st.tuples(st.floats(0.0, 6.0), st.floats(-1.0, 1.0)), min_size=n, max_size=n)))
    turn, rise = angles.T
    directions = np.column_stack([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
    moments = np.cross(points, directions)
    length = np.hypot(moments[:, 0], moments[:, 1])
    image = moments / np.where(length > 0.0, length, 1.0)[:, np.newaxis]
    visible = np.array(draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    for each in (image, directions, moments):
        each[~visible] = 0.0
    covariances = np.tile([1e-6, 1e-7, 1e-6], (n, 1)) if draw(st.booleans()) else None
    ends = np.tile([0.1, 0.2, 0.3, 0.4], (n, 1)) if draw(st.booleans()) else None
    arrays = [each for each in (image, directions, moments, covariances, ends) if each is not None]
    if draw(st.booleans()):
        spoilt = draw(st.sampled_from(arrays)).ravel()
        spoilt[draw(st.integers(0, len(spoilt) - 1))] = draw(SPOILT)
    ids = tuple(draw(st.lists(st.integers(0, 9), min_size=n, max_size=n, unique=draw(st.booleans()))))
    return ids, image, directions, moments, visible, "camera", covariances, LinesVerdict.OK, "", "filter", ends


@settings(max_examples=150)
@given(rows())
def test_rows_that_are_checked_at_once_are_those_that_are_checked_one_by_one(given_rows):
    found = observation_of_good_rows(*given_rows)
    try:
        expected = LineObservation.from_rows(*given_rows)
    except ObservationError:
        assert found is None
        return
    if found is None:
        # Something is left out, or nothing can be used.
        visible = given_rows[4]
        assert not visible.any() or expected.usable.tolist() != visible.tolist()
        return
    for field in dataclasses.fields(LineObservation):
        same(getattr(found, field.name), getattr(expected, field.name))


def same(found, expected):
    if isinstance(expected, LineSet):
        for field in dataclasses.fields(LineSet):
            same(getattr(found, field.name), getattr(expected, field.name))
    elif isinstance(expected, np.ndarray):
        assert found.dtype == expected.dtype and not found.flags.writeable
        np.testing.assert_array_equal(found, expected)
    else:
        assert type(found) is type(expected) and found == expected
