# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from strategies import line_sets, numbers, vectors

from plsing_ros.figures.segments import segments_in_ball


@given(lines=line_sets(), center=vectors(), radius=numbers(0.1, 50.0))
def test_ends_are_on_the_ball_and_on_the_lines_that_hit_it(lines, center, radius):
    segments = segments_in_ball(lines.point, lines.direction, center, radius)
    distance = np.linalg.norm(np.cross(lines.point - center, lines.direction), axis=1)
    hit = distance < radius
    if np.abs(distance - radius).min() < 1e-9:
        return
    assert segments.shape == (hit.sum(), 2, 3)
    np.testing.assert_allclose(np.linalg.norm(segments - center, axis=2), radius, rtol=1e-9)
    for end in (0, 1):
        moment = np.cross(segments[:, end], lines.direction[hit])
        np.testing.assert_allclose(moment, lines.moment[hit], atol=1e-9 * (1 + radius))
