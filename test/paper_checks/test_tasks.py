# SPDX-License-Identifier: Apache-2.0
"""The experiments' data against what the paper prints."""

import numpy as np
import pytest

from paper import scenes as paper_scenes
from paper import tasks as paper_tasks
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation.target_paths import View
from plsing_ros.singularities import Kind, singular_set

FOUR = singular_set(paper_scenes.four_lines())
TASKS = paper_tasks.paper_tasks()
ALL = [task for tasks in TASKS.values() for task in tasks]


def nearest(center, kind):
    return min(each.distance for each in FOUR.distances(center) if each.kind is kind)


def test_the_scene_is_that_of_the_parameter_file():
    lines, scene = read_scene(config_file("paper_p4l.yaml")), paper_scenes.four_lines()
    np.testing.assert_allclose(lines.direction, scene.direction, atol=1e-15)
    np.testing.assert_allclose(lines.moment, scene.moment, atol=1e-12)


def test_the_special_parameter_is_the_printed_one():
    assert pytest.approx(7.7178, abs=1.5e-4) == paper_scenes.SPECIAL_D7


@pytest.mark.parametrize("printed", [paper_scenes.PRINTED_L_M, paper_scenes.PRINTED_L_N])
def test_the_printed_transversals_are_lines_that_meet_all_four(printed):
    direction, moment = np.array(printed[:3]), -np.array(printed[3:])
    scene = paper_scenes.four_lines()
    products = scene.moment @ direction + scene.direction @ moment
    # To the printed digits, for lines that are at most 7 m away.
    assert np.abs(products).max() < 5e-4
    assert abs(direction @ moment) < 1e-4


@pytest.mark.parametrize("number", range(1, 7))
def test_the_clovers_are_centred_at_isolated_points(number):
    middle = np.array(paper_tasks.QUADRIFOLIUM_MIDDLES[number])
    assert nearest(middle, Kind.ISOLATED_POINT) <= 1e-3 * max(1.0, np.abs(middle).max() / 15.0)


def test_the_first_clover_is_a_metre_away_from_its_singularity():
    assert nearest(paper_tasks.QUADRIFOLIUM_MIDDLES[0], Kind.ISOLATED_POINT) == pytest.approx(1.0, abs=1e-3)


def test_only_the_first_trajectory_crosses_a_transversal():
    through, beside = (task.path for task in TASKS[paper_tasks.TRAJECTORIES])
    assert nearest(through.position(25.0), Kind.TRANSVERSAL) < 1e-4
    assert min(nearest(beside.position(t), Kind.TRANSVERSAL) for t in np.linspace(0.0, 50.0, 501)) > 0.5


@pytest.mark.parametrize("time", [0.0, 10.0, 25.0, 37.5, 50.0])
def test_the_trajectories_are_the_equations(time):
    s = 0.04 * time - 1.0
    expected = ([-(s**3) - 1.7551, s + 0.3992, 0.7 * s + 10.0], [-(s**3) - 3.2551, s + 0.3992, 0.7 * s + 10.30])
    for task, position in zip(TASKS[paper_tasks.TRAJECTORIES], expected, strict=True):
        np.testing.assert_allclose(task.path.position(time), position, atol=1e-12)


def test_a_clover_passes_its_centre_four_times_and_its_leaves_are_as_long_as_printed():
    path = TASKS[paper_tasks.QUADRIFOLIA][1].path
    assert path.duration == 20.0
    for crossing in (2.5, 7.5, 12.5, 17.5):
        np.testing.assert_allclose(path.position(crossing), path.middle, atol=1e-12)
    np.testing.assert_allclose(path.position(0.0) - path.middle, [0.0, 0.3, 0.0], atol=1e-12)
    # s = pi / 8: cos(s) cos(2 s) = cos(22.5 deg) / sqrt(2).
    np.testing.assert_allclose(path.position(1.25) - path.middle, [0.0, 0.19598, 0.08118], atol=1e-5)


def test_gains_and_noise_are_the_printed_ones():
    of_groups = {group: {(task.gain, task.noise) for task in tasks} for group, tasks in TASKS.items()}
    assert of_groups == {
        paper_tasks.STARTS_FOUR: {(0.1, 0.0)},
        paper_tasks.TRAJECTORIES: {(1.0, 2e-3)},
        paper_tasks.QUADRIFOLIA: {(5.0, 1e-3)},
        paper_tasks.STARTS_FIVE: {(0.1, 2e-3)},
    }
    assert [len(tasks) for tasks in TASKS.values()] == [4, 2, 7, 4]


@pytest.mark.parametrize("task", ALL, ids=lambda task: task.name)
def test_every_run_starts_with_all_lines_in_the_image(task):
    for observation in (task.target_observation(0.0, "camera"), task.target_observation(task.path.duration, "camera")):
        assert observation.usable.all()
    # The runs that follow a path start on it.
    if task.moving:
        np.testing.assert_array_equal(task.start, task.path.position(0.0))


def test_a_view_turns_with_the_camera_or_not():
    centers = np.array([[4.0, 1.0, 2.0], [-3.0, 5.0, 1.0]])
    turning, constant = View(), View(seen_from=(4.0, 1.0, 2.0))
    for center in centers:
        pose = turning.pose(center)
        np.testing.assert_allclose(pose.rotation[:, 2], -center / np.linalg.norm(center), atol=1e-12)
        np.testing.assert_array_equal(constant.pose(center).rotation, constant.pose(centers[0]).rotation)
    rolled, tilted = View(roll=0.3), View(tilt=0.2)
    plain = turning.pose(centers[0]).rotation
    np.testing.assert_allclose((plain.T @ rolled.pose(centers[0]).rotation)[2], [0.0, 0.0, 1.0], atol=1e-12)
    assert (plain.T @ tilted.pose(centers[0]).rotation)[2, 2] == pytest.approx(np.cos(0.2))
