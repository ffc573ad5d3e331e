# SPDX-License-Identifier: Apache-2.0
"""Which lines are left out because they are far less certain than the others."""

import numpy as np
import pytest

from plsing_ros.features import LineObservation
from plsing_ros.features.certain_lines import CertainLines
from plsing_ros.geometry import LineSet

ALL = range(6)
NUMBERS = np.random.default_rng(5).uniform(-1.0, 1.0, size=(2, 9, 3))
LINES = LineSet.from_points_directions(NUMBERS[0] + [0.0, 0.0, 4.0], NUMBERS[1], "camera")


def covariances(*deviations):
    """Of lines with these errors in angle and offset, beside which the others' are 1."""
    size = np.resize([*deviations, *np.ones(9 - len(deviations))], 9)
    return 1e-6 * np.square(size)[:, None] * [0.5, 0.0, 0.5]


def test_it_leaves_out_what_is_far_less_certain_until_it_is_about_as_certain_again():
    chosen = CertainLines()
    found = []
    for deviation in (4.0, 6.0, 4.0, 3.1, 2.9, 4.0, 6.0):
        chosen.rows(LINES, covariances(1.0, deviation), ALL)
        found.append(chosen.left_out)
    assert found == [(), (2,), (2,), (2,), (), (), (2,)]
    assert chosen.text == "line 2 left out: far less certain than the others"


def test_the_worst_go_first_and_enough_lines_stay():
    chosen = CertainLines()
    assert chosen.rows(LINES, covariances(6.0, 9.0), ALL) == [2, 3, 4, 5, 6, 7, 8]
    assert chosen.text == "lines 1, 2 left out: far less certain than the others"
    seven, six = LINES.select(range(7)), LINES.select(range(6))
    assert chosen.rows(seven, covariances(6.0, 9.0)[:7], ALL) == [0, 2, 3, 4, 5, 6]
    assert chosen.rows(six, covariances(6.0, 9.0)[:6], ALL) is None and chosen.left_out == ()


@pytest.mark.parametrize(("columns", "left_out"), [(range(6), ()), ((1, 2, 3, 4, 5), (9,))])
def test_a_line_stays_that_shows_a_motion_that_the_others_do_not(columns, left_out):
    # The others are parallel to x: without it the camera's motion along them is not seen.
    direction = np.array([[1.0, 0.0, 0.0]] * 8 + [[0.1, 1.0, 0.2]])
    lines = LineSet.from_points_directions(NUMBERS[0] + [0.0, 0.0, 4.0], direction, "camera")
    chosen = CertainLines()
    chosen.rows(lines, covariances()[::-1] * ([[1.0]] * 8 + [[100.0]]), columns)
    assert chosen.left_out == left_out


def test_nothing_is_left_out_where_errors_are_not_known():
    chosen = CertainLines()
    chosen.rows(LINES, covariances(9.0), ALL)
    assert chosen.left_out == (1,)
    assert chosen.rows(LINES, None, ALL) is None and chosen.left_out == () and chosen.text == ""


def test_an_observation_loses_them_with_their_3d_lines():
    seen = LineObservation.of_lines(LINES)
    known = LineObservation(seen.ids, seen.image_lines, seen.usable, LINES, covariances=covariances(1.0, 9.0))
    chosen = CertainLines().of_observation(known, ALL)
    assert chosen.usable_ids == chosen.lines_camera.ids == (1, 3, 4, 5, 6, 7, 8, 9)
    assert CertainLines().of_observation(seen, ALL) is seen
    image_alone = LineObservation(seen.ids, seen.image_lines, covariances=covariances(9.0))
    assert CertainLines().of_observation(image_alone, ALL) is image_alone
