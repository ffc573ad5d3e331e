# SPDX-License-Identifier: Apache-2.0
"""A target that nobody told: found from the twists alone, and right about twists far from those it was found from."""

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from strategies import line_sets, numbers, poses, twists

from plsing_ros.features import decompose, degenerate_projections, interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.monitoring.target_estimation import TargetEstimator

SCENE = LineSet.from_points_directions(
    [[0, 0, 0], [0, 0, 2], [3, 5, 0], [0, 1, 7], [2, 1, 1]], [[1, 0, 0], [4, -5, 0], [3, 7, 3], [-2, 1, 13], [1, 2, -1]]
)
START = Pose.look_at([0.7, -4.6, 7.8], [0.0, 0.0, 0.0])
TARGET = START.integrate([0.1, 0.05, 0.1, 0.02, 0.01, -0.01], 1.0)


def run(lines, start, target, gain, frames, noise=0.0):
    """Yield the image, the factors of L and the twist of each frame of the plain law."""
    generator, pose = np.random.default_rng(0), start
    target_image = project_lines(lines.transformed(target.inverse(), "camera"))
    for _ in range(frames):
        seen = lines.transformed(pose.inverse(), "camera")
        L, s = interaction_matrix(seen), project_lines(seen)
        twist = -gain * np.linalg.pinv(L) @ (s - target_image)
        yield s.reshape(-1, 3), decompose(L), twist + noise * np.linalg.norm(twist) * generator.normal(size=6)
        pose = pose.integrate(twist, 0.04)


def found_after(search, frames):
    """Return how many twists it took."""
    for i, (image, factors, twist) in enumerate(frames):
        search.add(image, factors, twist)
        if search.target_image is not None:
            return i + 1
    return None


def assert_foretold(search, reference, later, accuracy):
    """The gain is read off one twist: a target of another size with another gain commands the same."""
    image, factors, twist = reference
    unit = factors.solve((search.target_image - image).ravel())
    gain = unit @ twist / (unit @ unit)
    for image, factors, twist in later:
        expected = gain * factors.solve((search.target_image - image).ravel())
        np.testing.assert_allclose(expected, twist, atol=accuracy * np.linalg.norm(reference[2]))


@pytest.mark.parametrize("n", [3, 4, 5])
@pytest.mark.parametrize("gain", [0.05, 0.1, 1.0])
def test_later_twists_are_those_of_the_goal_found(n, gain):
    lines = SCENE.select(range(n))
    frames = list(run(lines, START, TARGET, gain, 120))
    search = TargetEstimator()
    assert found_after(search, frames) <= 8
    assert_foretold(search, frames[10], frames[20::20], 1e-6)


@settings(max_examples=25, phases=[Phase.generate])
@given(lines=line_sets(min_size=4, max_size=8), start=poses(), way=twists(), gain=numbers(0.05, 1.0))
def test_any_scene_and_goal(lines, start, way, gain):
    target = start.integrate(way, 0.5)
    for pose in (start, target):
        assume(not degenerate_projections(lines.transformed(pose.inverse(), "camera")).any())
    frames = []
    for frame in run(lines, start, target, gain, 25):
        # Before the camera moves on: near a singularity it is thrown out of sight.
        assume(frame[1].inverse_condition_number > 1e-4)
        frames.append(frame)
    assume(np.linalg.norm(frames[0][2]) > 1e-3)
    search = TargetEstimator()
    assert found_after(search, frames) is not None
    assert_foretold(search, frames[15], frames[20:], 1e-2)


def test_twists_of_no_law_have_no_goal():
    frames = [(image, factors, -twist) for image, factors, twist in run(SCENE, START, TARGET, 0.1, 60)]
    assert found_after(TargetEstimator(), frames) is None
    generator = np.random.default_rng(1)
    random = [(image, factors, generator.normal(size=6)) for image, factors, _ in frames]
    assert found_after(TargetEstimator(), random) is None


def test_another_goal_is_found_after_the_first_is_forgotten():
    search = TargetEstimator()
    assert found_after(search, run(SCENE, START, TARGET, 0.1, 20)) is not None
    search.clear()
    assert search.target_image is None
    assert found_after(search, run(SCENE, TARGET, START, 0.1, 20)) is not None
