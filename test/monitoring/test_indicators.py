# SPDX-License-Identifier: Apache-2.0
"""Numbers that levels are judged by, where the whole monitor shows them only in rare scenes."""

import math

import pytest
from messages import mentions

from paper.scenes import four_lines
from plsing_ros.monitoring.approach import Approach
from plsing_ros.monitoring.indicators import Indicators
from plsing_ros.parameters import MonitorParameters
from plsing_ros.singularities import Kind, singular_set

LINES = four_lines()
SINGULAR = singular_set(LINES)


def indicators(**values):
    scene = {"lines_points": LINES.point.ravel(), "lines_directions": LINES.direction.ravel()}
    return Indicators(SINGULAR, MonitorParameters(**scene, **values))


@pytest.mark.parametrize(
    ("kind", "distance", "expected"),
    [
        (Kind.TRANSVERSAL, 0.3, math.inf),
        (Kind.TRANSVERSAL, 0.1, 0.7),
        (Kind.ISOLATED_POINT, 0.1, math.inf),
        (Kind.ISOLATED_POINT, 0.01, 0.7),
    ],
)
def test_a_closest_approach_counts_when_it_is_nearer_than_critical(kind, distance, expected):
    monitored = indicators(
        warn_transversal_distance=1.0,
        critical_transversal_distance=0.2,
        warn_point_distance=1.0,
        critical_point_distance=0.02,
    )
    growth, time = monitored.expected(None, None, Approach(kind, "it", distance, 0.7))
    assert (growth.value, time.value) == (math.inf, expected)
    assert mentions(time.text(), "approach", "it", "0.70 s") is (expected < math.inf)
    # A rate that is critical earlier comes first.
    assert monitored.expected(None, 0.5, Approach(kind, "it", distance, 0.7))[1].value == 0.5


@pytest.mark.parametrize(
    ("mode", "target", "limit"),
    [
        ("auto", None, 1e-4),
        ("auto", 0.1, 5e-4),
        ("absolute", 0.1, 1e-4),
        ("relative", None, None),
        ("both", 0.1, 5e-4),
        ("both", 0.01, 1e-4),
    ],
)
def test_a_rate_leads_to_the_higher_of_the_critical_thresholds_that_rule(mode, target, limit):
    monitored = indicators(condition_thresholds=mode, critical_condition=1e-4, critical_relative_condition=0.005)
    expected = None if limit is None else pytest.approx((1e-2 - limit) / 1e-3)
    assert monitored.time_to_critical(1e-2, (-1e-3, 0.0), target) == expected
    # Neither a rate that rises nor one that is not clear of its noise.
    assert monitored.time_to_critical(1e-2, (1e-3, 0.0), target) is None
    assert monitored.time_to_critical(1e-2, (-1e-3, 4e-4), target) is None
