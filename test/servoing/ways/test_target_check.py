"""What is answered before moving, with numbers that are computed again here."""

import numpy as np
import pytest
from hypothesis import given, settings
from strategies import vectors

from plsing_ros.experiments import near_transversal
from plsing_ros.experiments.config_files import config_file
from plsing_ros.features import interaction_matrix, inverse_condition_number
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.servoing.ways.detour import Decision, plan_way
from plsing_ros.servoing.ways.target_check import check_target
from plsing_ros.singularities import Kind, singular_set

LINES = read_scene(config_file("paper_p4l.yaml"))
FOUND = singular_set(LINES)
GOAL = Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION)


def condition(pose):
    return inverse_condition_number(interaction_matrix(LINES.transformed(pose.inverse(), "camera")))


@settings(max_examples=30)
@given(first=vectors(3, -0.5, 0.5), last=vectors(3, -0.5, 0.5))
def test_the_numbers_are_those_of_target_and_straight_way(first, last):
    start, goal = (Pose(GOAL.rotation, GOAL.translation + shift) for shift in (first, last))
    answer = check_target(FOUND, start, goal)
    plan = plan_way(FOUND, start, goal)
    assert (answer.decision, answer.reason) == (plan.decision, plan.reason)
    assert answer.target_inverse_condition_number == pytest.approx(condition(goal), rel=1e-6)
    assert answer.target_nearest.kind is not Kind.OBSERVED_LINE
    transversal = FOUND.transversals[0]
    apart = np.linalg.norm(np.cross(goal.translation - transversal.point, transversal.direction))
    assert answer.target_nearest.distance <= apart + 1e-12
    straight = [
        Pose(GOAL.rotation, (1.0 - share) * start.translation + share * goal.translation)
        for share in np.linspace(0.0, 1.0, 100)
    ]
    assert answer.straight_inverse_condition_number == pytest.approx(min(map(condition, straight)), rel=1e-6)
    nearest = min(FOUND.distances(pose.translation)[0].distance for pose in straight)
    assert answer.straight_nearest.distance == pytest.approx(nearest, abs=1e-9)
    if plan.path is not None:
        np.testing.assert_array_equal(answer.way[0].translation, start.translation)
        np.testing.assert_array_equal(answer.way[-1].translation, goal.translation)


def test_start_two_is_told_to_go_round_the_transversal():
    start = Pose(GOAL.rotation, near_transversal.STARTS[1].position)
    answer = check_target(FOUND, start, GOAL)
    assert answer.decision is Decision.DETOUR
    assert answer.straight_nearest.name == "transversal 1"
    assert answer.straight_nearest.distance < 0.01
    assert answer.straight_inverse_condition_number < 1e-5 < answer.target_inverse_condition_number


def test_a_refused_target_has_no_way_but_all_numbers():
    on_it = FOUND.distances(near_transversal.POINT_ON_TRANSVERSAL)[0].closest_point
    answer = check_target(FOUND, GOAL, Pose(GOAL.rotation, on_it))
    assert answer.decision is Decision.REFUSE
    assert answer.way == ()
    assert answer.target_nearest.distance < 1e-9
    assert answer.target_inverse_condition_number < 1e-9


def test_a_scene_without_loci_has_no_nearest_one():
    """Five general lines have neither transversals nor isolated points."""
    generator = np.random.default_rng(5)
    lines = LineSet.from_points_directions(generator.normal(size=(5, 3)), generator.normal(size=(5, 3)))
    found = singular_set(lines)
    assert set(found.locus_kinds) == {Kind.OBSERVED_LINE}
    start, goal = (Pose.looking_at(center, (0.0, 0.0, 0.0)) for center in ((4.0, 0.3, 0.2), (4.2, 0.1, 0.5)))
    answer = check_target(found, start, goal)
    assert answer.target_nearest is None
    assert answer.straight_nearest.kind is Kind.OBSERVED_LINE
