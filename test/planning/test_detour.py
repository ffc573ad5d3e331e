# SPDX-License-Identifier: Apache-2.0
"""Planned ways keep clear, as plain point-to-line distances say, or are refused with a reason."""

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from messages import mentions
from plain_distances import distances
from strategies import directions, numbers, vectors

from plsing_ros.errors import GeometryError
from plsing_ros.features import degenerate_projections, interaction_matrix, inverse_condition_number
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file
from plsing_ros.planning.detour import Decision, DetourOptions, plan_path
from plsing_ros.simulation import near_transversal
from plsing_ros.singularities import singular_set

SINGULAR = singular_set(read_scene(config_file("paper_p4l.yaml")))
TARGET = Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION)


def at(position):
    return Pose(TARGET.rotation, np.asarray(position))


def assert_clear(plan, found, start, target, share):
    """The path keeps its margin, less near ends that have less, and a bit less between the places that are checked."""
    rotation, centers = plan.path.poses(np.linspace(0.0, 1.0, 3000))
    keep = np.full((len(centers), 1), plan.margin)
    for end in (start.translation, target.translation):
        away = np.linalg.norm(centers - end, axis=1)[:, np.newaxis]
        keep = np.minimum(keep, 0.9 * distances(end[np.newaxis], found) + 0.5 * away)
    between = 0.02 * plan.path.length
    assert (distances(centers, found) >= share * keep - between).all()
    np.testing.assert_array_equal(plan.path.start.translation, start.translation)
    np.testing.assert_array_equal(plan.path.target.rotation, target.rotation)


@pytest.mark.parametrize(
    ("start", "decision"),
    zip(
        near_transversal.STARTS, [Decision.STRAIGHT, Decision.DETOUR, Decision.STRAIGHT, Decision.STRAIGHT], strict=True
    ),
)
def test_from_the_starts_of_the_paper(start, decision):
    plan = plan_path(SINGULAR, at(start.position), TARGET)
    assert plan.decision is decision
    assert plan.margin == 0.2
    assert_clear(plan, SINGULAR, at(start.position), TARGET, 0.7)
    _, centers = plan.path.poses(np.linspace(0.0, 1.0, 500))
    apart = np.linalg.norm(centers - TARGET.translation, axis=1)
    assert apart.max() <= 1.2 * apart[0]
    if decision is Decision.DETOUR:
        assert re.search(r"\btransversal 1\b.*\b0\.00", plan.reason)
        # The straight path would have met it.
        assert distances(np.linspace(start.position, TARGET.translation, 500), SINGULAR).min() < 0.003
        assert distances(centers, SINGULAR).min() > 0.14


def test_a_plan_is_always_the_same():
    start = at(near_transversal.STARTS[1].position)
    one, other = (plan_path(SINGULAR, start, TARGET) for _ in range(2))
    for here, there in zip(one.path.sampled(50), other.path.sampled(50), strict=True):
        np.testing.assert_array_equal(here.translation, there.translation)
        np.testing.assert_array_equal(here.rotation, there.rotation)


@st.composite
def tasks(draw):
    """A scene of three to six lines, and two poses within 2 m that look at it."""
    n = draw(st.integers(3, 6))
    points = [draw(vectors(3, -2.0, 2.0)) for _ in range(n)]
    lines = LineSet.from_points_directions(points, [draw(directions()) for _ in range(n)])
    center = draw(directions())
    center = center / np.linalg.norm(center) * draw(numbers(2.5, 5.0))
    start, target = (center + draw(vectors(3, -1.0, 1.0)) for _ in range(2))
    down = np.eye(3)[np.argmin(np.abs(center))]
    return lines, Pose.look_at(start, (0.0, 0.0, 0.0), down), Pose.look_at(target, (0.1, 0.2, 0.0), down)


@settings(max_examples=25)
@given(task=tasks())
def test_ways_are_clear_or_refused(task):
    lines, start, target = task
    singular = singular_set(lines)
    plan = plan_path(singular, start, target)
    assert plan.reason
    if plan.decision is Decision.REFUSE:
        assert plan.path is None
        return
    assert_clear(plan, singular, start, target, 1.0 if plan.decision is Decision.STRAIGHT else 0.7)
    _, centers = plan.path.poses(np.linspace(0.0, 1.0, 300))
    apart = np.linalg.norm(centers - target.translation, axis=1)
    assert apart.max() <= 1.2 * apart[0] + 1e-9


@settings(max_examples=15)
@given(across=directions(), side=st.floats(0.0, 6.28), before=numbers(0.1, 1.0), after=numbers(0.1, 1.0))
def test_a_way_across_a_transversal_leads_round_it(across, side, before, after):
    """Start and target on opposite sides of L_M, wherever and however far: the straight path meets it."""
    transversal = SINGULAR.transversals[0]
    place = transversal.point + transversal.direction * float(across[0])
    first = np.cross(transversal.direction, np.eye(3)[0])
    first /= np.linalg.norm(first)
    away = np.cos(side) * first + np.sin(side) * np.cross(transversal.direction, first)
    start, target = (Pose.look_at(place + shift * away, (0.0, 0.0, 0.0)) for shift in (-before, after))
    assume(
        not any(
            degenerate_projections(SINGULAR.lines.transformed(p.inverse(), "camera")).any() for p in (start, target)
        )
    )
    plan = plan_path(SINGULAR, start, target)
    if plan.decision is Decision.REFUSE:
        return
    assert plan.decision is Decision.DETOUR
    assert_clear(plan, SINGULAR, start, target, 0.7)


def test_most_ways_across_a_transversal_are_found():
    """Of twelve paths across L_M in all directions, none is refused."""
    transversal = SINGULAR.transversals[0]
    place = near_transversal.POINT_ON_TRANSVERSAL
    first = np.cross(transversal.direction, np.eye(3)[0])
    first /= np.linalg.norm(first)
    for side in np.arange(12) * (2.0 * np.pi / 12):
        away = np.cos(side) * first + np.sin(side) * np.cross(transversal.direction, first)
        plan = plan_path(SINGULAR, at(place - 0.3 * away), at(place + 0.4 * away))
        assert plan.decision is Decision.DETOUR, plan.reason
        assert plan.margin >= 0.1


@pytest.mark.parametrize("kind", ["transversal 1", "isolated point 1"])
def test_a_target_on_a_locus_is_refused_or_accepted_on_request(kind):
    place = SINGULAR.isolated_points[0]
    if kind == "transversal 1":
        place = SINGULAR.transversals[0].point + 0.3 * SINGULAR.transversals[0].direction
    start, target = (Pose.look_at(place + shift, (0.3, 0.2, 0.0)) for shift in (np.array([0.3, 0.3, 0.4]), np.zeros(3)))
    plan = plan_path(SINGULAR, start, target)
    assert plan.decision is Decision.REFUSE
    assert plan.path is None
    assert re.search(rf"\btarget\b.*{kind}", plan.reason)
    assert "0.001 m" in plan.reason
    accepted = plan_path(SINGULAR, start, target, DetourOptions(accept_singular_target=True))
    assert accepted.decision is not Decision.REFUSE
    np.testing.assert_array_equal(accepted.path.target.translation, place)


def test_a_target_from_which_a_line_has_no_image_is_refused():
    line = SINGULAR.lines
    plan = plan_path(SINGULAR, TARGET, at(line.point[1] + 0.7 * line.direction[1]))
    assert plan.decision is Decision.REFUSE
    assert mentions(plan.reason, "line 2", "target")


def test_a_scene_that_is_singular_everywhere_is_refused():
    parallel = LineSet.from_points_directions([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 0, 1]] * 4)
    start, target = (Pose.look_at(center, (0.4, 0.3, 0.0)) for center in ((3.0, 0.5, 0.2), (3.2, 0.6, 0.1)))
    plan = plan_path(singular_set(parallel), start, target)
    assert plan.decision is Decision.REFUSE
    assert mentions(plan.reason, "singular", "every camera")


THREE = singular_set(SINGULAR.lines.select([0, 1, 2]))


@settings(max_examples=40)
@given(first=vectors(3, -3.0, 3.0), shift=vectors(3, -1.0, 1.0))
def test_surfaces_are_crossed_only_between_a_start_and_a_goal_on_different_sides(first, shift):
    centers = np.array([first + (0.0, 0.0, 6.0), first + shift + (0.0, 0.0, 6.0)])
    values = np.array([surface.value(centers) for surface in THREE.surfaces])
    assume(np.abs(values).min() > 1e-3 and np.linalg.norm(shift) > 1e-2)
    # A target within 1 mm of a locus is refused for that.
    assume(np.linalg.norm(THREE.distance_arrays(centers[1]).closest_point - centers[1], axis=1).min() > 2e-3)
    start, target = (Pose.look_at(center, (0.5, 0.5, 0.5), (0.0, 1.0, 0.0)) for center in centers)
    plan = plan_path(THREE, start, target)
    separating = [surface for surface, (a, b) in zip(THREE.surfaces, values, strict=True) if a * b < 0.0]
    refusing = plan_path(THREE, start, target, DetourOptions(cross_surfaces=False))
    if separating:
        assert refusing.decision is Decision.REFUSE
        assert all(surface.name in refusing.reason for surface in separating)
        assert "separate" in refusing.reason
    if plan.decision is Decision.REFUSE:
        return
    _, path = plan.path.poses(np.linspace(0.0, 1.0, 400))
    for surface in THREE.surfaces:
        if surface in separating:
            assert surface.name in plan.reason
        elif "across" not in plan.reason:
            side = np.sign(surface.value(path))
            assert (side == side[0]).all()


def test_the_camera_is_tilted_past_a_line_in_the_focal_plane():
    """A turn by 90 degrees in place; half-way the focal plane goes through line 1."""
    points = [[2.0, 0.0, -2.0], [0.3, -0.5, 3.0], [3.0, 1.0, 2.0], [4.0, -1.0, 1.0], [2.0, 2.0, 3.0]]
    lines = LineSet.from_points_directions(
        points, [[0.0, 1.0, 0.0], [1.0, 0.3, 0.5], [0.2, 1.0, 0.1], [0.3, 0.2, 1.0], [1.0, -1.0, 0.2]]
    )
    start = Pose(np.eye(3), np.zeros(3))
    target = start.integrate([0.0, 0.0, 0.0, 0.0, np.pi / 2, 0.0], 1.0)
    half_way = start.integrate([0.0, 0.0, 0.0, 0.0, np.pi / 4, 0.0], 1.0)
    assert degenerate_projections(lines.transformed(half_way.inverse(), "camera"))[0]
    plan = plan_path(singular_set(lines), start, target)
    assert plan.decision is not Decision.REFUSE, plan.reason
    for pose in plan.path.sampled(500):
        seen = lines.transformed(pose.inverse(), "camera").moment
        angle = np.arctan2(np.hypot(seen[:, 0], seen[:, 1]), np.abs(seen[:, 2]))
        assert angle.min() > np.radians(4.9)
        np.testing.assert_array_equal(pose.translation, 0.0)


def test_the_conditioning_on_the_way_is_as_good_as_at_its_ends():
    start = at(near_transversal.STARTS[1].position)
    plan = plan_path(SINGULAR, start, TARGET)

    def condition(pose):
        return inverse_condition_number(interaction_matrix(SINGULAR.lines.transformed(pose.inverse(), "camera")))

    least = 0.3 * min(condition(start), condition(TARGET))
    assert min(condition(pose) for pose in plan.path.sampled(300)) > 0.99 * least


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"margin": 0.0}, "detour option 'margin' is 0.0; it must be positive and finite"),
        ({"max_distance": float("inf")}, "'max_distance' is inf"),
        ({"condition_ratio": 1.0}, "'condition_ratio' is 1.0; allowed: 0 to below 1"),
        ({"focal_angle": -0.1}, "'focal_angle' is -0.1"),
    ],
)
def test_options_out_of_range_are_refused(values, message):
    with pytest.raises(GeometryError, match=message):
        DetourOptions(**values)
