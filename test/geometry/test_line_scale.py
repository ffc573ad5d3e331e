# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from strategies import line_sets, numbers, poses, vectors

from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet, Pose, align_lines
from plsing_ros.geometry.line_scale import LineScale

LARGEST = 0.5


def scaled(lines, factor, pose):
    """What a camera sees of lines whose depths are all taken for too large by a factor."""
    true = lines.transformed(pose.inverse(), "camera")
    return LineSet(true.direction, factor * true.moment, "camera", true.ids)


def shape_size(lines):
    """How far lines are from sharing a point [m], by least squares on the rows of q x u = l."""
    rows = np.vstack([np.cross(np.eye(3), u).T for u in lines.direction])
    rest = lines.moment.ravel() - rows @ np.linalg.lstsq(rows, lines.moment.ravel(), rcond=None)[0]
    return np.linalg.norm(rest)


def spread(lines):
    return np.linalg.svd(lines.direction, compute_uv=False)[1]


@settings(max_examples=40)
@given(lines=line_sets(min_size=3, max_size=6), pose=poses(), factor=numbers(0.6, 1.4))
def test_the_factor_on_exact_lines_is_found(lines, pose, factor):
    assume(spread(lines) > 0.2 and shape_size(lines) > 0.1)
    scale = LineScale(lines)
    scale.add(scaled(lines, factor, pose), pose.rotation)
    # What is nearer to 1 than rounding is not told from it.
    np.testing.assert_allclose(scale.factor(LARGEST), factor, atol=1e-4)


@settings(max_examples=40)
@given(lines=line_sets(min_size=3, max_size=6), pose=poses())
def test_lines_of_the_right_scale_have_the_factor_one_to_the_last_bit(lines, pose):
    assume(spread(lines) > 0.2)
    scale = LineScale(lines)
    scale.add(scaled(lines, 1.0, pose), pose.rotation)
    assert scale.factor(LARGEST) == 1.0


@settings(max_examples=30)
@given(lines=line_sets(min_size=4, max_size=5), there=st.lists(poses(), min_size=2, max_size=3))
def test_poses_and_missing_lines_do_not_matter(lines, there):
    assume(spread(lines) > 0.2 and shape_size(lines) > 0.1)
    scale = LineScale(lines)
    for number, pose in enumerate(there):
        seen = scaled(lines, 1.1, pose)
        rows = np.roll(range(len(lines)), number)[:3] if number else range(len(lines))
        seen = seen.select(rows)
        assume(spread(seen) > 0.2)
        scale.add(seen, pose.rotation)
    np.testing.assert_allclose(scale.factor(LARGEST), 1.1, atol=1e-4)


@given(
    directions=st.lists(vectors().filter(lambda v: np.linalg.norm(v) > 0.1), min_size=3, max_size=6),
    point=vectors(),
    pose=poses(),
    factor=numbers(0.6, 1.4),
)
def test_lines_that_meet_in_a_point_have_none(directions, point, pose, factor):
    lines = LineSet.from_points_directions([point] * len(directions), directions)
    assume(spread(lines) > 0.2)
    scale = LineScale(lines)
    for _ in range(3):
        scale.add(scaled(lines, factor, pose), pose.rotation)
    assert scale.factor(LARGEST) == 1.0


def noisy(lines, deviation, generator):
    direction, moment = (
        each + generator.normal(scale=deviation, size=each.shape) for each in (lines.direction, lines.moment)
    )
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    moment -= (moment * direction).sum(axis=1, keepdims=True) * direction
    return LineSet(direction, moment, lines.frame, lines.ids)


DRAWN = np.random.default_rng(3)
LINES = LineSet.from_points_directions(DRAWN.normal(size=(5, 3)), DRAWN.normal(size=(5, 3)))


@given(point=vectors(), size=st.integers(-300, 300), shift=st.integers(0, 4))
def test_whatever_is_seen_the_factor_is_within_its_bounds(point, size, shift):
    direction = np.roll(LINES.direction, shift, axis=0)
    wild = LineSet(direction, 10.0**size * np.cross(point, direction), "camera")
    scale = LineScale(LINES)
    for seen in (wild, LINES, wild):
        scale.add(seen, np.eye(3))
        assert 1.0 - LARGEST <= scale.factor(LARGEST) <= 1.0 + LARGEST


@pytest.mark.parametrize("factor", [1.01, 0.95])
def test_noise_averages_out(factor):
    generator = np.random.default_rng(1)
    together, pose = LineScale(LINES), Pose.look_at((3.0, 1.0, 0.5), (0.0, 0.0, 0.0))
    single = []
    for _ in range(400):
        seen = noisy(scaled(LINES, factor, pose), 5e-3, generator)
        alone = LineScale(LINES)
        for scale in (alone, together):
            scale.add(seen, align_lines(LINES, seen).T_world_camera.rotation)
        single.append(alone.factor(LARGEST) - factor)
    assert abs(together.factor(LARGEST) - factor) < 0.2 * np.std(single)


@pytest.mark.parametrize("number", range(8))
def test_a_wrong_map_is_not_taken_for_a_wrong_scale(number):
    generator = np.random.default_rng([7, number])
    known = LineSet.from_points_directions(LINES.point + generator.normal(scale=5e-3, size=(5, 3)), LINES.direction)
    scale = LineScale(known)
    scale.add(LINES, np.eye(3))
    assert scale.factor(LARGEST) == 1.0


def test_it_is_never_corrected_by_more_than_is_allowed():
    scale = LineScale(LINES)
    scale.add(LineSet(LINES.direction, 1.3 * LINES.moment, "camera"), np.eye(3))
    assert scale.factor(0.2) == 1.2
    assert scale.factor(0.0) == 1.0


def test_nothing_seen_says_nothing_and_an_unknown_line_is_refused():
    scale = LineScale(LINES.select([0, 1, 2]))
    assert scale.factor(LARGEST) == 1.0
    with pytest.raises(GeometryError, match=r"\bid 4\b.*scene"):
        scale.add(LINES.select([1, 2, 3]), np.eye(3))
