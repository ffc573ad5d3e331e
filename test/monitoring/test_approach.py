# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import assume, given
from near_transversal_scene import SCENE
from strategies import vectors

from plsing_ros.geometry import Pose
from plsing_ros.monitoring.approach import ApproachTable, Trend
from plsing_ros.singularities import Kind, singular_set

SINGULAR = singular_set(SCENE)
TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def ahead(found, center, velocity, horizon=10.0):
    """Of a camera at a centre with a velocity, both in the frame of the scene."""
    twist = np.concatenate([TURN.T @ velocity, [0.1, -0.2, 0.3]])
    return ApproachTable(found).ahead(found.distance_arrays(center), Pose(TURN, center), twist, horizon)


@given(center=vectors(3), velocity=vectors(3, -1.0, 1.0))
def test_the_closest_approach_is_the_least_over_samples_of_the_way(center, velocity):
    assume(np.linalg.norm(velocity) > 0.1)
    trend, approach = ahead(SINGULAR, center, velocity)
    assert isinstance(trend, Trend)
    if approach is None:
        return
    row = SINGULAR.locus_names.index(approach.name)

    def distance(time):
        return SINGULAR.distance_arrays(center + time * velocity).distance[row]

    assert distance(approach.time) == pytest.approx(approach.distance, abs=1e-6)
    assert all(distance(time) >= approach.distance - 1e-6 for time in np.linspace(0.0, 10.0, 30))


def test_trends_by_example():
    point = SINGULAR.isolated_points[0]
    way = np.array([0.6, 0.0, 0.8])
    for offset, expected in ((-0.05, Trend.APPROACHING), (0.05, Trend.LEAVING), (0.0005, Trend.PASSING)):
        center = point + offset * way + 0.001 * np.array([0.8, 0.0, -0.6])
        trend, approach = ahead(SINGULAR, center, 0.01 * way)
        assert trend is expected
        if expected is Trend.APPROACHING:
            assert (approach.kind, approach.name) == (Kind.ISOLATED_POINT, "isolated point 1")
            assert approach.distance == pytest.approx(0.001) and approach.time == pytest.approx(5.0)
    assert ahead(SINGULAR, point, np.zeros(3)) == (Trend.STEADY, None)


def test_along_a_transversal_is_steady():
    line = SINGULAR.transversals[0]
    center = line.point + 1e-3 * np.cross(line.direction, [1.0, 0.0, 0.0])
    assert ahead(SINGULAR, center, line.direction)[0] is Trend.STEADY


def test_a_surface_is_met_where_its_tangent_plane_is():
    singular = singular_set(SCENE.select([0, 1, 2]))
    center = np.array([0.3, 0.4, 1.2])
    arrays = singular.distance_arrays(center)
    row = singular.locus_names.index("quadric")
    toward = (arrays.closest_point[row] - center) / arrays.distance[row]
    _, approach = ahead(singular, center, 0.1 * toward, 100.0)
    assert approach.distance == pytest.approx(0.0, abs=1e-9) and approach.time <= 10.0 * arrays.distance[row] + 1e-9
