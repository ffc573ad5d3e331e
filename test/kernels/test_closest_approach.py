"""Distances and closest approaches against the least of many samples of the way."""

import numpy as np
import pytest
from hypothesis import assume, given
from strategies import directions, numbers, vectors

from plsing_ros.kernels import compiled, of_numpy

BOTH = pytest.mark.parametrize("the", [compiled, of_numpy], ids=["compiled", "numpy"])
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


def distances(the, tables, center):
    closest, distance = np.empty(tables[0].shape), np.empty(len(tables[0]))
    assert the.distances(*tables, center, closest, distance)
    return closest, distance


def twist_of(velocity):
    return np.concatenate([TURN.T @ velocity, [0.1, -0.2, 0.3]])


def approach(the, tables, center, velocity, role=ROLE, horizon=HORIZON):
    closest, distance = distances(the, tables, center)
    found = np.empty(4)
    direction = tables[1] * (role == 0.0)[:, np.newaxis]
    twist = twist_of(velocity)
    row = the.approach(closest, distance, direction, role, TURN, center, twist, found, horizon, AT_REST, ALONG)
    return row, found


@BOTH
@pytest.mark.parametrize("tables", TABLES)
@given(center=vectors(3), aside=numbers(-5.0, 5.0))
def test_no_point_of_a_line_is_closer_than_the_closest(the, tables, center, aside):
    point, direction = tables
    closest, distance = distances(the, tables, center)
    np.testing.assert_allclose(np.linalg.norm(closest - center, axis=1), distance, atol=1e-12)
    np.testing.assert_allclose(np.cross(closest - point, direction), 0.0, atol=1e-12)
    np.testing.assert_allclose(closest[2:4], point[2:4], atol=0.0)
    others = closest + aside * direction
    assert (np.linalg.norm(others - center, axis=1) >= distance - 1e-12).all()


@BOTH
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_centre_that_is_not_finite_is_noticed(the, value):
    center = np.array([0.0, value, 0.0])
    assert not the.distances(*TABLES[0], center, np.empty((5, 3)), np.empty(5))


@BOTH
@pytest.mark.parametrize("tables", TABLES)
@given(center=vectors(3, -3.0, 3.0), way=directions(), speed=numbers(0.1, 2.0))
def test_the_closest_approach_is_the_least_of_the_way(the, tables, center, way, speed):
    velocity = speed * way / np.linalg.norm(way)
    row, found = approach(the, tables, center, velocity)
    times = np.linspace(0.0, HORIZON, 41)
    samples = np.array([distances(the, tables, center + t * velocity)[1] for t in times])[:, ROLE == 0.0]
    if row < 0:
        # Whatever is across the motion is behind it, or nearest after the horizon.
        assert np.isnan(found[2:]).all()
    assume(row >= 0)
    assert 0.0 < found[2] <= HORIZON
    at = distances(the, tables, center + found[2] * velocity)[1]
    assert at[row] == pytest.approx(found[3], abs=1e-7)
    # Of the others, none gets nearer but where it is nearest at the start, or still approached at the end.
    rows = [i for i in range(4) if 0.0 < times[samples[:, i].argmin()] < HORIZON]
    assert all(samples[:, i].min() >= found[3] - 1e-7 for i in rows)


@BOTH
@pytest.mark.parametrize("tables", TABLES)
@given(center=vectors(3, -3.0, 3.0), velocity=vectors(3, -1.0, 1.0))
def test_the_nearest_comes_nearer_as_fast_as_its_distance_changes(the, tables, center, velocity):
    _, found = approach(the, tables, center, velocity)
    distance = distances(the, tables, center)[1]
    nearest, speed = int(distance[:4].argmin()), np.linalg.norm(velocity)
    assume(not np.isnan(found[1]) and distance[nearest] >= 0.1)
    step = 1e-5 / speed
    ahead, behind = (distances(the, tables, center + side * step * velocity)[1][nearest] for side in (1.0, -1.0))
    assert (behind - ahead) / (2.0 * step * speed) == pytest.approx(found[1], abs=1e-6)


@pytest.mark.parametrize("tables", TABLES)
@given(center=vectors(3, -3.0, 3.0), velocity=vectors(3, -1.0, 1.0), horizon=numbers(0.1, 20.0))
def test_both_say_the_same_of_a_surface_too(tables, center, velocity, horizon):
    role = np.array([0.0, 1.0, 0.0, 0.0, -1.0])
    row, found = approach(compiled, tables, center, velocity, role, horizon)
    other_row, other = approach(of_numpy, tables, center, velocity, role, horizon)
    assert row == other_row
    np.testing.assert_allclose(found, other, rtol=1e-9, atol=1e-6)


@BOTH
@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_a_line_across_the_way_is_passed_where_pythagoras_says(the, turn):
    """The first is 3 m ahead and 4 m above, the other as far behind and 1 m farther above."""
    tables = np.array([[3.0, 7.0, 4.0], [-3.0, 1.0, 5.0]]), turn * np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    row, found = approach(the, tables, np.zeros(3), np.array([0.5, 0.0, 0.0]), np.zeros(2))
    assert row == 0
    np.testing.assert_allclose(found, [6.0, 0.6, 6.0, 4.0], rtol=1e-14)


@BOTH
def test_a_plane_is_met_where_the_way_meets_it(the):
    """Its closest point is the foot of the perpendicular, here at (0, 0, 2)."""
    role = np.array([1.0])
    foot, center = np.array([[0.0, 0.0, 2.0]]), np.zeros(3)
    twist, found = twist_of(np.array([0.3, 0.0, 0.4])), np.empty(4)
    arguments = foot, np.array([2.0]), np.zeros((1, 3)), role, TURN, center, twist, found, 10.0, AT_REST, ALONG
    assert the.approach(*arguments) == 0
    np.testing.assert_allclose(found, [5.0, 0.8, 5.0, 0.0], atol=1e-7)


@BOTH
def test_at_rest_and_along_a_line_nothing_is_approached(the):
    point, direction = TABLES[0]
    center = point[0] + 0.01 * np.cross(direction[0], [0.0, 0.0, 1.0])
    for velocity in (np.zeros(3), np.full(3, 1e-10)):
        row, found = approach(the, TABLES[0], center, velocity)
        assert row == -1 and np.isnan(found).all()
    role = np.array([0.0, -1.0, -1.0, -1.0, -1.0])
    for velocity in (direction[0], -direction[0], direction[0] + 0.01 * np.cross(direction[0], [1.0, 0.0, 0.0])):
        row, found = approach(the, TABLES[0], center, velocity, role)
        assert row == -1 and np.isnan(found).all()
