# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pose_scenes import distance, image_of, misfit, random_view, views

from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.pose import solve_three_lines
from plsing_ros.pose.candidates import SceneTriplets, chosen_triplets

LOOKING = Pose.look_at((4.0, -3.0, 2.0), (0.1, 0.2, -0.1))


@settings(max_examples=60)
@given(view=views(3, 3))
def test_finds_the_pose_and_only_poses(view):
    lines, pose = view
    image = image_of(lines, pose).image_lines
    found = solve_three_lines(image, lines)
    assert 1 <= len(found) <= 8
    assert min(distance(each, pose) for each in found) < 1e-6
    assert max(misfit(lines, image, each) for each in found) < 1e-8


@pytest.mark.parametrize("seed", range(25))
def test_agrees_with_poselib(seed):
    poselib = pytest.importorskip("poselib", reason="PoseLib has wheels for x86-64 only")
    lines, pose = random_view(np.random.default_rng(seed), 3)
    image = image_of(lines, pose).image_lines
    ours = solve_three_lines(image, lines)
    theirs = [Pose(each.R.T, -each.R.T @ each.t) for each in poselib.p3ll(image, lines.point, lines.direction)]
    for first, second in ((ours, theirs), (theirs, ours)):
        for each in first:
            assert min(distance(other, each) for other in second) < 1e-5


def test_solutions_need_not_see_the_lines_in_their_direction():
    lines, pose = random_view(np.random.default_rng(3), 3)
    image = image_of(lines, pose).image_lines
    assert len(solve_three_lines(-image, lines)) == len(solve_three_lines(image, lines))


def test_two_parallel_lines_of_three_are_enough():
    lines = LineSet.from_points_directions([[0, 0, 0], [1, 2, 0], [0, 1, 1]], [[1, 0, 0], [1, 0, 0], [0.2, 1, 0.5]])
    found = solve_three_lines(image_of(lines, LOOKING).image_lines, lines)
    assert min(distance(each, LOOKING) for each in found) < 1e-8


def test_three_lines_of_one_plane_are_enough():
    lines = LineSet.from_points_directions([[0, 0, 0], [2, 0, 0], [0, 1, 0]], [[1, 0.2, 0], [0.1, 1, 0], [1, -1, 0]])
    found = solve_three_lines(image_of(lines, LOOKING).image_lines, lines)
    assert min(distance(each, LOOKING) for each in found) < 1e-8


@pytest.mark.parametrize(
    ("points", "directions", "what"),
    [
        ([[0, 0, 0], [1, 2, 0], [0, 1, 1]], [[0, 0, 1]] * 3, "continuum of rotations"),
        ([[1, 1, 1]] * 3, [[1, 0, 0], [0, 1, 0], [0, 0.6, 0.8]], "meet in one point"),
    ],
    ids=["parallel", "concurrent"],
)
def test_degenerate_lines_are_reported(points, directions, what):
    lines = LineSet.from_points_directions(points, directions)
    with pytest.raises(GeometryError, match=what):
        solve_three_lines(image_of(lines, LOOKING).image_lines, lines)


def test_a_camera_in_the_plane_of_all_lines_is_reported():
    lines = LineSet.from_points_directions([[0, 0, 0], [2, 0, 0], [0, 1, 0]], [[1, 0.2, 0], [0.1, 1, 0], [1, -1, 0]])
    with pytest.raises(GeometryError):
        solve_three_lines([[0, 1, 0]] * 3, lines)


@pytest.mark.parametrize(
    ("image", "error"),
    [
        ([[0, 1, 0], [1, 0, np.nan], [0, 0, 1]], ObservationError),
        ([[0, 1, 0], [0, 0, 0], [0, 0, 1]], ObservationError),
        ([[0, 1, 0], [0, 0, 1]], ObservationError),
    ],
)
def test_images_that_are_none_are_refused(image, error):
    lines, _ = random_view(np.random.default_rng(0), 3)
    with pytest.raises(error):
        solve_three_lines(image, lines)


def test_another_number_of_lines_is_refused():
    lines, pose = random_view(np.random.default_rng(0), 4)
    with pytest.raises(GeometryError, match="4 lines"):
        solve_three_lines(image_of(lines, pose).image_lines[:3], lines)


@settings(max_examples=40)
@given(n=st.integers(3, 12), most=st.integers(4, 40), data=st.data())
def test_chosen_triplets_are_different_and_involve_all_lines_alike(n, most, data):
    seed = data.draw(st.integers(0, 5))
    directions = np.random.default_rng(seed).normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rows = chosen_triplets(directions, most)
    total = n * (n - 1) * (n - 2) // 6
    assert len({tuple(sorted(row)) for row in rows.tolist()}) == len(rows) == min(most, total)
    if 3 * most >= 2 * n:
        assert len(np.unique(rows)) == n


@pytest.mark.parametrize("backend", ["numpy", "poselib"])
@pytest.mark.parametrize("all_lines", [True, False])
def test_every_triplet_of_an_exact_image_gives_the_pose(backend, all_lines):
    if backend == "poselib":
        pytest.importorskip("poselib", reason="PoseLib has wheels for x86-64 only")
    lines, pose = random_view(np.random.default_rng(8), 5)
    rotation, translation = SceneTriplets(lines, 10, backend).candidates(
        image_of(lines, pose).image_lines, all_lines=all_lines
    )
    right = [distance(Pose(R.T, -R.T @ t), pose) < 1e-6 for R, t in zip(rotation, translation, strict=True)]
    assert sum(right) >= 10
