# SPDX-License-Identifier: Apache-2.0
import warnings

import numpy as np
import pytest
from hypothesis import assume, given, settings
from scipy.spatial.transform import Rotation
from strategies import line_sets, poses

from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.geometry import LineSet, align_lines
from plsing_ros.geometry.line_alignment import lines_to_reverse, pose_by_lines


def spread(lines):
    return np.linalg.svd(lines.direction, compute_uv=False)[1]


@given(lines=line_sets(min_size=3), pose=poses())
def test_the_pose_comes_back(lines, pose):
    assume(spread(lines) > 0.2)
    found = align_lines(lines, lines.transformed(pose.inverse(), "camera"))
    np.testing.assert_allclose(found.T_world_camera.rotation, pose.rotation, atol=1e-6)
    np.testing.assert_allclose(found.T_world_camera.translation, pose.translation, atol=1e-5)
    assert found.angle < 1e-6 and found.offset < 1e-5


@given(lines=line_sets(min_size=4, max_size=6), pose=poses())
def test_order_and_missing_lines_do_not_matter(lines, pose):
    seen = lines.transformed(pose.inverse(), "camera").select(range(len(lines) - 1, 0, -1))
    assume(spread(seen) > 0.2)
    np.testing.assert_allclose(align_lines(lines, seen).T_world_camera.translation, pose.translation, atol=1e-5)


def misfit_without(lines, seen, row):
    """Return how badly directions fit at best if a row is reversed."""
    direction = seen.direction.copy()
    direction[row] *= -1.0
    with warnings.catch_warnings():
        # That lines along the axes leave the rotation open is no news here.
        warnings.simplefilter("ignore", UserWarning)
        return Rotation.align_vectors(lines.direction, direction)[1]


@settings(max_examples=50)
@given(lines=line_sets(min_size=4, max_size=4), pose=poses())
def test_a_reversed_line_is_named(lines, pose):
    assume(np.linalg.svd(lines.direction, compute_uv=False)[2] > 0.6)
    seen = lines.transformed(pose.inverse(), "camera")
    sign = np.array([[1.0], [1.0], [-1.0], [1.0]])
    turned = LineSet(seen.direction * sign, seen.moment * sign, "camera", seen.ids)
    np.testing.assert_allclose(pose_by_lines(lines, seen).rotation, pose.rotation, atol=1e-6)
    assert align_lines(lines, turned).angle > 0.1
    # Lines along the axes fit as well when another one is reversed: the first that does is named.
    misfit = np.array([misfit_without(lines, turned, row) for row in range(4)])
    assume(not ((misfit > 1e-7) & (misfit < 1e-3)).any())
    assert misfit[2] <= 1e-7
    first = int(np.flatnonzero(misfit <= 1e-7)[0]) + 1
    assert lines_to_reverse(lines, turned, 1e-6) == (first,)
    if align_lines(lines, turned).angle > 0.6:
        with pytest.raises(ObservationError, match=r"line \d is reversed"):
            pose_by_lines(lines, turned)


def test_what_does_not_fix_a_pose_is_refused():
    parallel = LineSet.from_points_directions([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1]] * 3)
    with pytest.raises(GeometryError, match=r"3 seen line\(s\) are all parallel"):
        align_lines(parallel, parallel)
    with pytest.raises(GeometryError, match="line id 3 is not in the scene, whose ids are"):
        align_lines(parallel.select([0, 1]), parallel)
