# SPDX-License-Identifier: Apache-2.0
"""What a monitor asks in every cycle: against the checked functions, exact arithmetic, and samples of the path."""

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import directions, line_sets, numbers, poses, seen_lines, twists, vectors

from plsing_ros import _core
from plsing_ros.features import degenerate_projections, interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose

MIN_DEPTH, FASTEST = 1e-9, 1e9


def step(lines, desired, twist=None, duration=0.0, gain=1.0, fastest=FASTEST):
    """Return lines after a step and the twist there, or None."""
    before = np.array([lines.direction, lines.moment])
    twist = np.zeros(6) if twist is None else twist
    return _core.step_law(before, desired, twist, duration, gain, MIN_DEPTH, fastest)


@given(seen=seen_lines(min_size=3), twist=twists())
def test_it_is_the_motion_and_the_law_of_the_checked_functions(seen, twist):
    moved = seen.transformed(Pose(np.eye(3), np.zeros(3)).integrate(twist, 0.3).inverse(), "camera")
    desired = project_lines(seen).reshape(-1, 3) + 0.1
    found = step(seen, desired, twist, 0.3, 0.4)
    assume(found is not None)
    np.testing.assert_allclose(found[0], [moved.direction, moved.moment], atol=1e-7)
    after = LineSet(*found[0], "camera")
    assume(not degenerate_projections(after).any())
    L = interaction_matrix(after)
    values = np.linalg.svd(L, compute_uv=False)
    assume(values[-1] > 1e-6 * values[0])
    expected = -0.4 * np.linalg.lstsq(L, project_lines(after) - desired.ravel(), rcond=None)[0]
    np.testing.assert_allclose(found[1], expected, atol=1e-6 * (1.0 + np.linalg.norm(expected)))


@given(lines=seen_lines(min_size=3))
def test_a_camera_at_rest_sees_the_same_lines_to_the_last_bit(lines):
    found = step(lines, np.zeros((len(lines), 3)))
    assume(found is not None)
    np.testing.assert_array_equal(found[0], [lines.direction, lines.moment])


@pytest.mark.parametrize("angle", [1e-6, 0.9e-4, 1.1e-4, 1e-3, 1.0])
def test_small_and_large_turns_are_as_exact(angle):
    lines = LineSet.from_points_directions([[0, 0, 3], [1, 0, 4], [0, 2, 5]], np.eye(3)[[1, 2, 0]], "camera")
    twist = np.array([1.0, -2.0, 3.0, 0.6 * angle, 0.0, 0.8 * angle])
    vx, vy, vz, x, y, z = twist.tolist()
    with mpmath.workdps(50):
        screw = mpmath.matrix([[0, -z, y, vx], [z, 0, -x, vy], [-y, x, 0, vz], [0, 0, 0, 0]])
        motion = np.array(mpmath.expm(screw).tolist(), dtype=float)
    expected = lines.transformed(Pose(motion[:3, :3], motion[:3, 3]).inverse(), "camera")
    # Image lines of no meaning: the motion does not ask for the law after it.
    moved, _ = step(lines, np.zeros((3, 3)), twist, 1.0, fastest=np.inf)
    np.testing.assert_allclose(moved, [expected.direction, expected.moment], atol=5e-15)


@given(exponent=numbers(0.0, 8.0))
def test_the_twist_is_as_exact_as_its_condition_number_allows(exponent):
    """Four lines of the paper, from a centre 1 to 1e-8 m beside a transversal."""
    lines = LineSet.from_points_directions(
        [[0, 0, 0], [0, 0, 2], [3, 5, 0], [0, 1, 7]], [[1, 0, 0], [4, -5, 0], [3, 7, 3], [-2, 1, 13]]
    )
    center = np.array([0.396236, -4.337064, 7.5]) + 10.0**-exponent
    seen = lines.transformed(Pose.look_at(center, [0.0, 0.0, 0.0]).inverse(), "camera")
    L, error = interaction_matrix(seen), np.linspace(-0.1, 0.2, 12)
    with mpmath.workdps(60):
        A = mpmath.matrix(L.tolist())
        exact = np.array([float(x) for x in mpmath.lu_solve(A.T * A, A.T * mpmath.matrix(error.tolist()))])
    found = step(seen, project_lines(seen).reshape(-1, 3) - error.reshape(-1, 3))[1]
    condition = np.linalg.cond(L)
    # The residual is not small, so that the square of the condition number takes part.
    residual = np.linalg.norm(L @ exact - error) / (np.linalg.norm(L, 2) * np.linalg.norm(exact))
    allowed = 1e-14 * condition * (1.0 + condition * residual) * np.linalg.norm(exact)
    np.testing.assert_allclose(found, -exact, atol=allowed)


def test_there_is_no_law_through_the_camera_nor_where_all_is_lost_nor_beyond_the_fastest():
    through = LineSet(np.eye(3), np.array([[0, 1.0, 0], [0, 0, 0], [1.0, 0, 0]]), "camera")
    assert step(through, np.zeros((3, 3))) is None
    same = LineSet(np.array([[1.0, 0, 0]] * 3), np.array([[0.0, 1.0, 0]] * 3), "camera")
    assert step(same, np.zeros((3, 3))) is None
    good = LineSet.from_points_directions([[0, 0, 3], [1, 0, 4], [0, 2, 5]], np.eye(3)[[1, 2, 0]], "camera")
    desired = project_lines(good).reshape(-1, 3) + 0.1
    size = np.linalg.norm(step(good, desired)[1])
    assert step(good, desired, fastest=1.01 * size) is not None
    assert step(good, desired, fastest=0.99 * size) is None


@pytest.mark.parametrize("size", [np.inf, -np.inf, np.nan, 1e200, 1e308])
@pytest.mark.parametrize("axis", range(6))
def test_there_is_no_law_after_a_step_that_overflows(size, axis):
    lines = LineSet.from_points_directions([[0, 0, 3], [1, 0, 4], [0, 2, 5]], np.eye(3)[[1, 2, 0]], "camera")
    twist = size * np.eye(6)[axis] if np.isfinite(size) else np.where(np.arange(6) == axis, size, 0.0)
    found = step(lines, project_lines(lines).reshape(-1, 3) + 0.1, twist, 1.0)
    assert found is None or all(np.isfinite(each).all() for each in found)
    if axis > 2 or not np.isfinite(size):
        assert found is None


def test_images_of_lines_through_the_camera_deviate_by_no_finite_number():
    moment = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 1.0]])
    assert not np.isfinite(_core.image_deviation(moment, np.zeros((2, 3))))


@given(lines=line_sets(), pose=poses(), others=st.data())
def test_lines_seen_are_the_transformed_ones(lines, pose, others):
    n = len(lines)
    given_lines = others.draw(line_sets(min_size=n, max_size=n))
    seen, error = _core.compare_lines(
        lines.direction, lines.moment, pose.rotation, pose.translation, given_lines.direction, given_lines.moment
    )
    expected = lines.transformed(pose.inverse(), "camera")
    np.testing.assert_allclose(seen, [expected.direction, expected.moment], atol=1e-13)
    np.testing.assert_array_equal(error, np.array([given_lines.direction, given_lines.moment]) - seen)


@given(lines=seen_lines(min_size=1), pose=poses())
def test_the_deviation_of_images(lines, pose):
    image = project_lines(lines).reshape(-1, 3)
    assert _core.image_deviation(lines.moment * 3.0, image) == pytest.approx(0.0, abs=1e-20)
    other = pose.rotation[:1] + image
    assert _core.image_deviation(lines.moment, other) == pytest.approx(len(lines), rel=1e-12)


HORIZON, AT_REST, ALONG = 10.0, 1e-9, 0.02
# Two lines, two points, one line that is left out.
# Of the camera, whose motion is given in its frame.
TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
ROLE = np.array([0.0, 0.0, 0.0, 0.0, -1.0])


def table(generator):
    point, direction = generator.normal(size=(5, 3)), generator.normal(size=(5, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    direction[2:4] = 0.0
    return point, direction


TABLES = [table(np.random.default_rng(seed)) for seed in range(2)]


def distances(tables, center):
    return _core.closest_points(*tables, center)


def twist_of(velocity):
    return np.concatenate([TURN.T @ velocity, [0.1, -0.2, 0.3]])


def approach(tables, center, velocity, role=ROLE, horizon=HORIZON):
    closest, distance = distances(tables, center)
    direction = tables[1] * (role == 0.0)[:, np.newaxis]
    row, *found = _core.closest_approach(
        closest, distance, direction, role, TURN, center, twist_of(velocity), horizon, AT_REST, ALONG
    )
    return row, np.array(found)


@pytest.mark.parametrize("tables", TABLES)
@given(center=vectors(3), aside=numbers(-5.0, 5.0))
def test_no_point_of_a_line_is_closer_than_the_closest(tables, center, aside):
    point, direction = tables
    closest, distance = distances(tables, center)
    np.testing.assert_allclose(np.linalg.norm(closest - center, axis=1), distance, atol=1e-12)
    np.testing.assert_allclose(np.cross(closest - point, direction), 0.0, atol=1e-12)
    np.testing.assert_allclose(closest[2:4], point[2:4], atol=0.0)
    others = closest + aside * direction
    assert (np.linalg.norm(others - center, axis=1) >= distance - 1e-12).all()


@pytest.mark.parametrize("tables", TABLES)
@given(center=vectors(3, -3.0, 3.0), path=directions(), speed=numbers(0.1, 2.0))
def test_the_closest_approach_is_the_least_of_the_path(tables, center, path, speed):
    velocity = speed * path / np.linalg.norm(path)
    row, found = approach(tables, center, velocity)
    times = np.linspace(0.0, HORIZON, 41)
    samples = np.array([distances(tables, center + t * velocity)[1] for t in times])[:, ROLE == 0.0]
    if row < 0:
        # Whatever is across the motion is behind it, or nearest after the horizon.
        assert np.isnan(found[2:]).all()
    assume(row >= 0)
    assert 0.0 < found[2] <= HORIZON
    at = distances(tables, center + found[2] * velocity)[1]
    assert at[row] == pytest.approx(found[3], abs=1e-7)
    # Of the others, none gets nearer but where it is nearest at the start, or still approached at the end.
    rows = [i for i in range(4) if 0.0 < times[samples[:, i].argmin()] < HORIZON]
    assert all(samples[:, i].min() >= found[3] - 1e-7 for i in rows)


@pytest.mark.parametrize("tables", TABLES)
@given(center=vectors(3, -3.0, 3.0), velocity=vectors(3, -1.0, 1.0))
def test_the_nearest_comes_nearer_as_fast_as_its_distance_changes(tables, center, velocity):
    _, found = approach(tables, center, velocity)
    distance = distances(tables, center)[1]
    nearest, speed = int(distance[:4].argmin()), np.linalg.norm(velocity)
    assume(not np.isnan(found[1]) and distance[nearest] >= 0.1)
    step = 1e-5 / speed
    ahead, behind = (distances(tables, center + side * step * velocity)[1][nearest] for side in (1.0, -1.0))
    assert (behind - ahead) / (2.0 * step * speed) == pytest.approx(found[1], abs=1e-6)


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_a_line_across_the_path_is_passed_where_pythagoras_says(turn):
    """The first is 3 m ahead and 4 m above, the other as far behind and 1 m farther above."""
    tables = np.array([[3.0, 7.0, 4.0], [-3.0, 1.0, 5.0]]), turn * np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    row, found = approach(tables, np.zeros(3), np.array([0.5, 0.0, 0.0]), np.zeros(2))
    assert row == 0
    np.testing.assert_allclose(found, [6.0, 0.6, 6.0, 4.0], rtol=1e-14)


def test_a_plane_is_met_where_the_path_meets_it():
    """Its closest point is the foot of the perpendicular, here at (0, 0, 2)."""
    role = np.array([1.0])
    foot, center = np.array([[0.0, 0.0, 2.0]]), np.zeros(3)
    twist = twist_of(np.array([0.3, 0.0, 0.4]))
    row, *found = _core.closest_approach(
        foot, np.array([2.0]), np.zeros((1, 3)), role, TURN, center, twist, 10.0, AT_REST, ALONG
    )
    assert row == 0
    np.testing.assert_allclose(found, [5.0, 0.8, 5.0, 0.0], atol=1e-7)


def test_at_rest_and_along_a_line_nothing_is_approached():
    point, direction = TABLES[0]
    center = point[0] + 0.01 * np.cross(direction[0], [0.0, 0.0, 1.0])
    for velocity in (np.zeros(3), np.full(3, 1e-10)):
        row, found = approach(TABLES[0], center, velocity)
        assert row == -1 and np.isnan(found).all()
    role = np.array([0.0, -1.0, -1.0, -1.0, -1.0])
    for velocity in (direction[0], -direction[0], direction[0] + 0.01 * np.cross(direction[0], [1.0, 0.0, 0.0])):
        row, found = approach(TABLES[0], center, velocity, role)
        assert row == -1 and np.isnan(found).all()
