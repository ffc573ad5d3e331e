# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from strategies import line_sets, poses, twists

from plsing_ros.errors import GeometryError
from plsing_ros.features import degenerate_projections, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.simulation.simulated_camera import SimulatedCamera

HERE = Pose(np.eye(3), np.zeros(3))


@given(lines=line_sets(min_size=3), start=poses(), twist=twists())
def test_without_noise_it_sees_the_projections_from_where_it_moved(lines, start, twist):
    camera = SimulatedCamera(lines, start, "camera")
    camera.move(twist, 0.1)
    camera.move(twist, 0.1)
    in_camera = lines.transformed(start.integrate(twist, 0.2).inverse(), "camera")
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


@given(lines=line_sets(min_size=3), start=poses())
def test_the_noise_can_be_on_the_3d_lines_or_the_image_alone(lines, start):
    exact = SimulatedCamera(lines, start, "camera").observe()
    both, in_space, in_image = (
        SimulatedCamera(lines, start, "camera", noise=0.01, seed=4, noise_on=kind).observe()
        for kind in ("both", "lines", "image")
    )
    if not (exact.usable.all() and both.usable.all()):
        return
    np.testing.assert_array_equal(in_space.image_lines, exact.image_lines)
    np.testing.assert_array_equal(in_space.lines_camera.moment, both.lines_camera.moment)
    np.testing.assert_array_equal(in_image.image_lines, both.image_lines)
    np.testing.assert_array_equal(in_image.lines_camera.moment, exact.lines_camera.moment)
    assert not np.array_equal(both.image_lines, exact.image_lines)
    assert not np.array_equal(both.lines_camera.direction, exact.lines_camera.direction)


def test_the_image_says_how_noisy_it_is():
    lines = LineSet.from_points_directions(
        [[0.3, 0.2, 2], [-1, 0.4, 3], [0.1, -1, 1.5]], [[1, 2, 1], [0, 1, 3], [4, 1, 0]]
    )
    camera = SimulatedCamera(lines, HERE, "camera", noise=1e-4, seed=1)
    exact = project_lines(lines).reshape(-1, 3)
    frames = [camera.observe() for _ in range(4000)]
    image = np.array([each.image_lines for each in frames])
    turn = exact[:, 0] * image[..., 1] - exact[:, 1] * image[..., 0]
    error = np.stack([np.arcsin(turn), image[..., 2] - exact[:, 2]], axis=2)
    found = np.einsum("kni,knj->nij", error, error) / len(frames)
    stated = frames[0].covariances[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    whitened = np.linalg.solve(np.linalg.cholesky(stated), found)
    whitened = np.linalg.solve(np.linalg.cholesky(stated), whitened.transpose(0, 2, 1))
    # Of 4000 frames, their entries have a standard deviation of 0.022.
    np.testing.assert_allclose(whitened, np.broadcast_to(np.eye(2), (3, 2, 2)), atol=0.11)
    assert SimulatedCamera(lines, HERE, "camera").observe().covariances is None


@pytest.mark.parametrize("kind", ["lines", "image"])
def test_a_line_through_the_camera_is_not_usable_with_noise_on_either(kind):
    lines = LineSet.from_points_directions([[0, 0, 1], [0, 0, 0]], [[1, 0, 0], [0, 0, 1]])
    seen = SimulatedCamera(lines, HERE, "camera", noise=1e-3, seed=1, noise_on=kind).observe()
    assert seen.usable.tolist() == [True, False]
    assert seen.usable_ids == seen.lines_camera.ids == (1,)
