# SPDX-License-Identifier: Apache-2.0
"""The ends of segments, found again from how they are seen."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from strategies import vectors

from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.monitoring.segment_ends import SegmentEnds

MIDDLES = np.array([[0.0, 0.0, 0.0], [0.4, -0.2, 0.1], [-0.3, 0.3, -0.2]])
DIRECTIONS = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.6, -0.8, 0.0]])
SCENE = LineSet.from_points_directions(MIDDLES, DIRECTIONS, ids=(4, 7, 9))
ENDS = MIDDLES[:, None] + np.array([-0.5, 0.3])[:, None] * DIRECTIONS[:, None]


def seen_from(pose, part=(0.0, 1.0), rows=(0, 1, 2)):
    """An observation of these lines that shows a part of each segment."""
    first, last = ENDS[:, 0], ENDS[:, 1]
    shown = np.stack([first + share * (last - first) for share in part], axis=1)
    corners = (shown - pose.translation) @ pose.rotation
    seen = LineObservation.of_lines(SCENE.transformed(pose.inverse(), "camera")).select(rows)
    ends = (corners[..., :2] / corners[..., 2:]).reshape(-1, 4)[list(rows)]
    return LineObservation(seen.ids, seen.image_lines, seen.usable, ends=ends)


@given(center=vectors(3, -0.3, 0.3))
def test_segments_are_where_they_are_seen_to_be(center):
    pose = Pose.look_at(center + np.array([0.5, 0.7, 4.0]), (0.0, 0.0, 0.0))
    known = SegmentEnds(SCENE)
    known.add(pose, seen_from(pose))
    np.testing.assert_allclose(np.sort(known.ends(), axis=1), np.sort(ENDS, axis=1), atol=1e-9)


@given(a=st.floats(0.0, 0.4), b=st.floats(0.6, 1.0))
def test_parts_that_are_seen_one_after_the_other_make_one_segment(a, b):
    known = SegmentEnds(SCENE)
    for center, part in (((0.5, 0.7, 4.0), (0.0, b)), ((-0.7, 0.2, 3.0), (a, 1.0))):
        pose = Pose.look_at(center, (0.0, 0.0, 0.0))
        known.add(pose, seen_from(pose, part, rows=(2, 0, 1)))
    np.testing.assert_allclose(np.sort(known.ends(), axis=1), np.sort(ENDS, axis=1), atol=1e-9)


def test_nothing_is_known_of_lines_that_were_not_seen_and_of_a_ray_along_a_line():
    known = SegmentEnds(SCENE)
    pose = Pose.look_at((0.5, 0.7, 4.0), (0.0, 0.0, 0.0))
    assert known.ends() is None
    known.add(pose, seen_from(pose, rows=(1,)))
    lengths = np.linalg.norm(np.diff(known.ends(), axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(lengths, [100.0, 0.8, 100.0])
    # A camera that looks along line 4 sees it as a point that tells no place on it.
    along = Pose.look_at((9.0, 0.001, 0.0), (0.0, 0.0, 0.0))
    alone = SegmentEnds(SCENE)
    alone.add(along, seen_from(along, rows=(0,)))
    assert alone.ends() is None
