import numpy as np
import pytest
from hypothesis import given
from strategies import line_sets, poses, twists

from plsing_ros.errors import GeometryError
from plsing_ros.features import degenerate_projections, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.servoing.simulated_camera import SimulatedCamera

HERE = Pose(np.eye(3), np.zeros(3))


@given(lines=line_sets(min_size=3), start=poses(), twist=twists())
def test_without_noise_it_sees_the_projections_from_where_it_moved(lines, start, twist):
    camera = SimulatedCamera(lines, start, "camera")
    camera.move(twist, 0.1)
    camera.move(twist, 0.1)
    in_camera = lines.transformed(start.moved(twist, 0.2).inverse(), "camera")
    if degenerate_projections(in_camera).any():
        return
    np.testing.assert_allclose(camera.observe().image_lines.ravel(), project_lines(in_camera), atol=1e-6)


@given(lines=line_sets(), start=poses())
def test_noisy_lines_are_still_lines(lines, start):
    seen = SimulatedCamera(lines, start, "camera", noise=0.3, seed=1).observe().lines_camera
    if seen is not None:
        np.testing.assert_allclose(np.einsum("ij,ij->i", seen.direction, seen.moment), 0.0, atol=1e-9)


def test_a_twist_that_cannot_be_followed_leaves_the_camera_where_it_was():
    camera = SimulatedCamera(LineSet.from_points_directions([[0, 0, 1]], [[1, 0, 0]]), HERE, "camera")
    with pytest.raises(GeometryError):
        camera.move(np.full(6, np.nan), 0.1)
    assert camera.T_world_camera is HERE
