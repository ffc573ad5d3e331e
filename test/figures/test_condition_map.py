# SPDX-License-Identifier: Apache-2.0
import matplotlib.image
import numpy as np

from paper.figures import save_figure
from paper.maps import map_planes
from paper.scenes import four_lines, three_lines
from plsing_ros.features import interaction_matrix, inverse_condition_number
from plsing_ros.figures.condition_map import MapPlane, condition_map, inverse_condition_numbers
from plsing_ros.geometry import Pose
from plsing_ros.singularities import singular_set

FOUR = four_lines()


def test_many_cameras_at_once_have_the_numbers_of_each():
    centers = np.random.default_rng(5).normal(scale=4.0, size=(20, 3))
    viewed = (0.3, -0.2, 0.1)
    each = [
        inverse_condition_number(interaction_matrix(FOUR.transformed(Pose.look_at(c, viewed).inverse(), "camera")))
        for c in centers
    ]
    np.testing.assert_allclose(inverse_condition_numbers(FOUR, centers, viewed), each, rtol=1e-8)


def test_cameras_without_an_image_count_as_singular():
    on_line = FOUR.point[1] + 2.0 * FOUR.direction[1]
    centers = np.array([on_line, [0.0, 0.0, 0.0], [0.0, 0.0, 3.0], [4.0, 2.0, 1.0]])
    # On a line; where it should look at; looking straight down; an ordinary one.
    values = inverse_condition_numbers(FOUR, centers, (0.0, 0.0, 0.0))
    assert values[:3].tolist() == [0.0, 0.0, 0.0] and values[3] > 1e-3


def test_planes_have_a_right_handed_frame_and_know_what_is_in_them():
    plane = MapPlane.across("a plane", [1.0, 2.0, 3.0], [1.0, 1.0, 0.0], 2.0)
    grid = plane.grid(5)
    assert grid.shape == (5, 5, 3)
    coordinates = plane.coordinates(grid.reshape(-1, 3)).reshape(5, 5, 3)
    np.testing.assert_allclose(coordinates[..., 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(coordinates[0, :, 0], [-2.0, -1.0, 0.0, 1.0, 2.0], atol=1e-12)
    np.testing.assert_allclose(coordinates[:, 0, 1], [-2.0, -1.0, 0.0, 1.0, 2.0], atol=1e-12)
    off = plane.coordinates(np.array([[2.0, 3.0, 3.0]]))[0]
    np.testing.assert_allclose(np.abs(off), [0.0, 0.0, np.sqrt(2.0)], atol=1e-12)


def test_the_map_is_dark_where_the_singular_set_is():
    across, along, through_p1, _ = map_planes()
    for plane in (across, through_p1):
        values = inverse_condition_numbers(FOUR, plane.grid(21).reshape(-1, 3), (0.0, 0.0, 0.0)).reshape(21, 21)
        assert values[10, 10] < 0.05 * np.median(values)
    first = singular_set(FOUR).transversals[0]
    np.testing.assert_allclose(along.coordinates(first.point[np.newaxis])[0, 2], 0.0, atol=1e-3)


def test_the_spots_without_a_mark_are_lines_without_an_image():
    plane = map_planes()[3]
    grid = plane.grid(201).reshape(-1, 3)
    values = inverse_condition_numbers(FOUR, grid, (0.0, 0.0, 0.0))
    singular = singular_set(FOUR)
    dark = grid[values < 1e-4]
    unmarked = [center for center in dark if singular.distances(center)[0].distance > 0.2]
    assert len({center[0] > 0.0 for center in unmarked}) == 2
    for center in unmarked:
        second = FOUR.transformed(Pose.look_at(center, (0.0, 0.0, 0.0)).inverse(), "camera")
        moment = second.moment[1]
        assert np.hypot(moment[0], moment[1]) < 0.12 * np.linalg.norm(moment)


def test_a_figure_is_drawn(tmp_path):
    singular = singular_set(FOUR)
    path = ("a path", "tab:red", np.array([[0.4, -4.3, 7.5], [0.7, -4.6, 7.8]]))
    figure = condition_map(singular, map_planes()[:1], singular_set(three_lines()).surfaces, [path], resolution=15)
    image = matplotlib.image.imread(save_figure(figure, tmp_path / "map.png"))[..., :3]
    assert image.std() > 0.1
