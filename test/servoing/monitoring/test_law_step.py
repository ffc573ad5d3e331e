import numpy as np
import pytest
from hypothesis import assume, given
from strategies import line_sets, poses, twists

from plsing_ros.features import degenerate_projections, interaction_matrix, project_lines
from plsing_ros.servoing.monitoring.law_step import law, lines_after


@given(lines=line_sets(min_size=3), pose=poses(), twist=twists())
def test_the_short_cuts_are_the_checked_functions(lines, pose, twist):
    seen = lines.transformed(pose.inverse(), "camera")
    moved = lines.transformed(pose.moved(twist, 0.3).inverse(), "camera")
    direction, moment = lines_after(np.array([seen.direction, seen.moment]), 0.3 * twist)
    np.testing.assert_allclose(direction, moved.direction, atol=1e-9)
    np.testing.assert_allclose(moment, moved.moment, atol=1e-7)
    assume(not degenerate_projections(seen).any())
    L = interaction_matrix(seen)
    values = np.linalg.svd(L, compute_uv=False)
    assume(values[-1] > 1e-6 * values[0])
    error = 0.1 + 0.01 * np.arange(3.0 * len(lines))
    expected = -np.linalg.lstsq(L, error, rcond=None)[0]
    desired = (project_lines(seen) - error).reshape(-1, 3)
    twist = law(np.array([seen.direction, seen.moment]), desired)
    np.testing.assert_allclose(twist, expected, atol=1e-6 * (1.0 + np.linalg.norm(expected)))


def test_a_line_through_the_camera_has_no_law():
    lines = np.array([np.eye(3), np.eye(3)[[1, 2, 0]]])
    with pytest.raises(np.linalg.LinAlgError):
        law(lines, np.zeros((3, 3)))
