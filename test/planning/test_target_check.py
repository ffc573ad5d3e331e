# SPDX-License-Identifier: Apache-2.0
"""What is answered before moving, with numbers that are computed again here."""

import numpy as np
import pytest
from hypothesis import given, settings
from strategies import vectors

from plsing_ros.features import interaction_matrix, inverse_condition_number
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file
from plsing_ros.planning.detour import Decision, plan_path
from plsing_ros.planning.target_check import check_target
from plsing_ros.simulation import near_transversal
from plsing_ros.singularities import Kind, singular_set

LINES = read_scene(config_file("paper_p4l.yaml"))
SINGULAR = singular_set(LINES)
TARGET = Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION)


def condition(pose):
    return inverse_condition_number(interaction_matrix(LINES.transformed(pose.inverse(), "camera")))


@settings(max_examples=30)
@given(first=vectors(3, -0.5, 0.5), last=vectors(3, -0.5, 0.5))
def test_the_numbers_are_those_of_target_and_straight_way(first, last):
    start, target = (Pose(TARGET.rotation, TARGET.translation + shift) for shift in (first, last))
    answer = check_target(SINGULAR, start, target)
    plan = plan_path(SINGULAR, start, target)
    assert (answer.decision, answer.reason) == (plan.decision, plan.reason)
    assert answer.target_inverse_condition_number == pytest.approx(condition(target), rel=1e-6)
    assert answer.target_nearest.kind is not Kind.OBSERVED_LINE
    transversal = SINGULAR.transversals[0]
    apart = np.linalg.norm(np.cross(target.translation - transversal.point, transversal.direction))
    assert answer.target_nearest.distance <= apart + 1e-12
    straight = [
        Pose(TARGET.rotation, (1.0 - share) * start.translation + share * target.translation)
        for share in np.linspace(0.0, 1.0, 100)
    ]
    assert answer.straight_inverse_condition_number == pytest.approx(min(map(condition, straight)), rel=1e-6)
    nearest = min(SINGULAR.distances(pose.translation)[0].distance for pose in straight)
    assert answer.straight_nearest.distance == pytest.approx(nearest, abs=1e-9)
    if plan.path is not None:
        np.testing.assert_array_equal(answer.path[0].translation, start.translation)
        np.testing.assert_array_equal(answer.path[-1].translation, target.translation)


def test_start_two_is_told_to_go_round_the_transversal():
    start = Pose(TARGET.rotation, near_transversal.STARTS[1].position)
    answer = check_target(SINGULAR, start, TARGET)
    assert answer.decision is Decision.DETOUR
    assert answer.straight_nearest.name == "transversal 1"
    assert answer.straight_nearest.distance < 0.01
    assert answer.straight_inverse_condition_number < 1e-5 < answer.target_inverse_condition_number


def test_a_refused_target_has_no_way_but_all_numbers():
    on_it = SINGULAR.distances(near_transversal.POINT_ON_TRANSVERSAL)[0].closest_point
    answer = check_target(SINGULAR, TARGET, Pose(TARGET.rotation, on_it))
    assert answer.decision is Decision.REFUSE
    assert answer.path == ()
    assert answer.target_nearest.distance < 1e-9
    assert answer.target_inverse_condition_number < 1e-9


def test_a_scene_without_loci_has_no_nearest_one():
    """Five general lines have neither transversals nor isolated points."""
    generator = np.random.default_rng(5)
    lines = LineSet.from_points_directions(generator.normal(size=(5, 3)), generator.normal(size=(5, 3)))
    singular = singular_set(lines)
    assert set(singular.locus_kinds) == {Kind.OBSERVED_LINE}
    start, target = (Pose.look_at(center, (0.0, 0.0, 0.0)) for center in ((4.0, 0.3, 0.2), (4.2, 0.1, 0.5)))
    answer = check_target(singular, start, target)
    assert answer.target_nearest is None
    assert answer.straight_nearest.kind is Kind.OBSERVED_LINE
