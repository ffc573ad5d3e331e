# SPDX-License-Identifier: Apache-2.0
"""Changed trajectories keep clear of the loci, as plain distances and a minimisation over time say, and join up."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from messages import mentions
from plain_distances import distances
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from strategies import directions, numbers, vectors

from paper.scenes import four_lines
from paper.tasks import QUADRIFOLIA, TRAJECTORIES, paper_tasks
from paper.variants import AVOIDANCE
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.planning.camera_path import SpeedLimits
from plsing_ros.planning.detour import DetourOptions
from plsing_ros.planning.trajectory_detour import plan_trajectory
from plsing_ros.simulation import near_transversal
from plsing_ros.singularities import singular_set

SINGULAR = singular_set(four_lines())
TASKS = paper_tasks()
MARGIN = AVOIDANCE.margin


def positions(trajectory, times):
    return np.array([trajectory(time).translation for time in times])


def lowest_distance(trajectory, begin, end, found):
    """By sampling, and minimisation about the lowest sample."""
    times = np.linspace(begin, end, 401)
    near = distances(positions(trajectory, times), found).min(axis=1)
    k = int(np.argmin(near))
    around = (times[max(k - 1, 0)], times[min(k + 1, len(times) - 1)])
    finer = minimize_scalar(lambda t: distances(positions(trajectory, [t]), found).min(), bounds=around)
    return min(near[k], finer.fun)


def assert_joins_up(changed, desired, duration):
    """No jumps where pieces begin and end, and nothing changed outside of them."""
    for piece in changed.pieces:
        if piece.path is None:
            continue
        for time in piece.times[[0, -1]]:
            before, after = changed.pose(np.nextafter(time, -1.0)), changed.pose(time)
            np.testing.assert_allclose(before.translation, after.translation, atol=1e-9)
            np.testing.assert_allclose(before.rotation, after.rotation, atol=1e-9)
            np.testing.assert_allclose(after.translation, desired(time).translation, atol=1e-9)
            np.testing.assert_allclose(after.rotation, desired(time).rotation, atol=1e-9)
    for time in np.linspace(0.0, duration, 97):
        if not any(piece.path and piece.times[0] <= time <= piece.times[-1] for piece in changed.pieces):
            np.testing.assert_array_equal(changed.pose(time).translation, desired(time).translation)
            np.testing.assert_array_equal(changed.pose(time).rotation, desired(time).rotation)


def speeds(trajectory, times):
    poses = [trajectory(time) for time in times]
    linear = np.linalg.norm(np.diff([pose.translation for pose in poses], axis=0), axis=1) / np.diff(times)
    rotation = Rotation.from_matrix(np.array([pose.rotation for pose in poses]))
    return linear.max(), ((rotation[:-1].inv() * rotation[1:]).magnitude() / np.diff(times)).max()


@pytest.mark.parametrize(
    "task", [TASKS[TRAJECTORIES][0], *TASKS[QUADRIFOLIA][1:3]], ids=lambda task: task.name.replace(" ", "")
)
def test_the_papers_singular_trajectories_go_round(task):
    """Also the one whose centre has an observed line and the leaves' path round it beside it."""
    duration = task.path.duration
    changed = plan_trajectory(SINGULAR, task.target_pose, duration, AVOIDANCE)
    assert changed.pieces and all(piece.path for piece in changed.pieces)
    assert lowest_distance(task.target_pose, 0.0, duration, SINGULAR) < 0.005
    assert lowest_distance(changed.pose, 0.0, duration, SINGULAR) >= 0.995 * MARGIN
    assert_joins_up(changed, task.target_pose, duration)
    times = np.linspace(0.0, duration, 4001)
    apart = np.linalg.norm(positions(changed.pose, times) - positions(task.target_pose, times), axis=1)
    assert MARGIN < apart.max() <= 5.0 * MARGIN
    assert apart.max() == pytest.approx(max(piece.deviation for piece in changed.pieces), abs=0.01)
    assert speeds(changed.pose, times)[0] <= AVOIDANCE.limits.linear


@pytest.mark.parametrize("task", [TASKS[TRAJECTORIES][1], TASKS[QUADRIFOLIA][0]], ids=lambda task: task.name)
def test_what_is_far_from_all_loci_stays_as_it_is(task):
    changed = plan_trajectory(SINGULAR, task.target_pose, task.path.duration, AVOIDANCE)
    assert changed.pieces == ()
    for time in np.linspace(0.0, task.path.duration, 50):
        np.testing.assert_array_equal(changed.pose(time).translation, task.target_pose(time).translation)


@st.composite
def crossings(draw):
    """Three to six lines, and a curve through a point near a locus, with a turn on the path."""
    n = draw(st.integers(3, 6))
    points = [draw(vectors(3, -2.0, 2.0)) for _ in range(n)]
    singular = singular_set(LineSet.from_points_directions(points, [draw(directions()) for _ in range(n)]))
    loci = [t.point + draw(numbers(-1.0, 1.0)) * t.direction for t in singular.transversals]
    loci += [*singular.isolated_points, singular.lines.point[0]]
    middle = draw(st.sampled_from(loci)) + draw(numbers(0.0, 0.2)) * draw(directions())
    along, bend, turn = draw(directions()), draw(vectors(3, -0.2, 0.2)), draw(vectors(3, -0.3, 0.3))
    rotation = Rotation.from_rotvec(draw(vectors(3, -2.0, 2.0)))
    duration = draw(numbers(5.0, 30.0))

    def desired(time):
        s = 2.0 * time / duration - 1.0
        turned = rotation * Rotation.from_rotvec(s * turn)
        return Pose(turned.as_matrix(), middle + s * along + s * s * bend)

    return singular, desired, duration


@settings(max_examples=10)
@given(crossing=crossings(), margin=numbers(0.03, 0.2))
def test_any_trajectory_keeps_clear_or_stays_as_it_is_with_a_reason(crossing, margin):
    found, desired, duration = crossing
    options = DetourOptions(margin=margin, limits=SpeedLimits(1.0, 1.0))
    changed = plan_trajectory(found, desired, duration, options)
    assert_joins_up(changed, desired, duration)
    end = 0.0
    for piece in changed.pieces:
        assert piece.reason and piece.times[0] >= end
        own = lowest_distance(desired, piece.times[0], piece.times[-1], found)
        assert own < margin + 1e-9
        # Between the places at which way and trajectory are looked at, a little less is possible.
        if piece.path is None:
            assert piece.closest == pytest.approx(own, abs=0.06 * margin) and "unchanged" in piece.reason
        else:
            assert lowest_distance(changed.pose, piece.times[0], piece.times[-1], found) >= 0.95 * piece.closest - 1e-3
            assert piece.closest > own - 1e-9
            times = np.linspace(piece.times[0], piece.times[-1], 300)
            apart = np.linalg.norm(positions(changed.pose, times) - positions(desired, times), axis=1)
            assert apart.max() <= 5.1 * margin
            limit, own_speed = speeds(changed.pose, times), speeds(desired, times)
            assert limit[0] <= 1.05 * max(1.0, own_speed[0]) and limit[1] <= 1.05 * max(1.0, own_speed[1])
        # What lies between the pieces keeps the margin itself.
        if piece.times[0] > end:
            assert lowest_distance(desired, end, piece.times[0], found) >= 0.89 * margin
        end = piece.times[-1]
    if end < duration:
        assert lowest_distance(desired, end, duration, found) >= 0.89 * margin


def line_of_flight(first, last, duration):
    """From one point to the other at constant speed, looking at the origin from the middle."""
    rotation = Pose.look_at(0.5 * (np.asarray(first) + last), (0.0, 0.0, 0.0)).rotation
    return lambda time: Pose(rotation, first + (np.asarray(last) - first) * (time / duration))


L_M = SINGULAR.transversals[0]
ON_L_M = L_M.point + L_M.direction * float((near_transversal.POINT_ON_TRANSVERSAL - L_M.point) @ L_M.direction)
ACROSS = np.cross(L_M.direction, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(L_M.direction, [1.0, 0.0, 0.0]))


def test_a_trajectory_along_a_transversal_runs_beside_it():
    """It comes from the side, turns onto L_M for a metre, and leaves to the other side."""
    waypoints = ON_L_M + np.array([ACROSS, 0.0 * ACROSS, L_M.direction, L_M.direction - ACROSS])

    def desired(time):
        position = [np.interp(time, [0.0, 10.0, 20.0, 30.0], column) for column in waypoints.T]
        return Pose(near_transversal_rotation, np.array(position))

    near_transversal_rotation = Pose.look_at(ON_L_M, (0.0, 0.0, 0.0)).rotation
    changed = plan_trajectory(SINGULAR, desired, 30.0, AVOIDANCE)
    (piece,) = changed.pieces
    assert piece.path and piece.times[0] < 9.0 and piece.times[-1] > 21.0
    assert lowest_distance(changed.pose, 0.0, 30.0, SINGULAR) >= 0.995 * MARGIN
    assert_joins_up(changed, desired, 30.0)


def test_a_trajectory_that_begins_and_ends_on_loci_leaves_and_reaches_them():
    """Nothing can be changed about its ends; in between L_N is gone round as before."""
    first, middle, last = ON_L_M, TASKS[TRAJECTORIES][0].path.position(25.0), SINGULAR.isolated_points[0]
    legs = line_of_flight(first, middle, 30.0), line_of_flight(middle, last, 30.0)
    rotation = Pose.look_at(middle, (0.0, 0.0, 0.0)).rotation

    def desired(time):
        leg, rest = (legs[0], time) if time < 30.0 else (legs[1], time - 30.0)
        return Pose(rotation, leg(rest).translation)

    changed = plan_trajectory(SINGULAR, desired, 60.0, AVOIDANCE)
    np.testing.assert_array_equal(changed.pose(0.0).translation, first)
    np.testing.assert_allclose(changed.pose(60.0).translation, last, atol=1e-12)
    crossed = [piece for piece in changed.pieces if piece.times[0] < 30.0 < piece.times[-1]]
    assert len(crossed) == 1 and crossed[0].path and crossed[0].closest >= MARGIN
    ends = [changed.pieces[0], changed.pieces[-1]]
    assert all(piece.path is None and "unchanged" in piece.reason and piece.closest < 1e-9 for piece in ends)


def test_a_bound_that_leaves_no_way_round_is_named():
    task = TASKS[TRAJECTORIES][0]
    middle = task.path.position(25.0)
    still = Pose(task.target_pose(0.0).rotation, middle)
    standing = plan_trajectory(SINGULAR, lambda time: still, 5.0, AVOIDANCE)
    (piece,) = standing.pieces
    assert piece.path is None and mentions(piece.reason, "path round", "near")
    np.testing.assert_array_equal(standing.pose(2.0).translation, middle)
    # As slow as the trajectory itself, every path round takes longer.
    narrow = plan_trajectory(
        SINGULAR, task.target_pose, task.path.duration, DetourOptions(margin=0.1, limits=SpeedLimits(1e-3, 1e-3))
    )
    (piece,) = narrow.pieces
    assert piece.path is None and mentions(piece.reason, "m/s", "transversal 2")
    assert narrow.pose(25.0) is not None and np.array_equal(narrow.pose(25.0).translation, middle)


def test_parallel_lines_leave_nothing_to_go_round():
    lines = LineSet.from_points_directions(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 2.0, 0.0]], [[0.0, 0.0, 1.0]] * 4
    )
    singular = singular_set(lines)
    assert singular.singular_everywhere
    desired = line_of_flight([-1.0, -3.0, 0.0], [-1.0, 3.0, 0.05], 20.0)
    crossing = line_of_flight([-1.0, 0.0, 0.0], [0.5, 0.0, 0.05], 20.0)
    assert plan_trajectory(singular, desired, 20.0, AVOIDANCE).pieces == ()
    pieces = plan_trajectory(singular, crossing, 20.0, AVOIDANCE).pieces
    assert pieces and all(each.path is None and mentions(each.reason, "singular", "every camera") for each in pieces)


def approach(start, duration=40.0):
    target = near_transversal.TARGET_POSITION
    rotation = Pose.from_quaternion(target, near_transversal.ORIENTATION).rotation
    beside = 0.02 * L_M.direction

    def desired(time):
        return Pose(rotation, target + beside * time)

    options = DetourOptions(margin=0.15)
    return plan_trajectory(SINGULAR, desired, duration, options, Pose(rotation, np.asarray(start))), desired, options


def test_a_camera_that_begins_elsewhere_goes_round_on_its_way_to_the_trajectory():
    start = near_transversal.STARTS[1].position
    changed, desired, options = approach(start)
    (piece,) = changed.pieces
    join = piece.times[-1]
    assert piece.path and "goes round" in piece.reason and 10.0 < join < 30.0
    np.testing.assert_allclose(changed.pose(0.0).translation, start, atol=1e-12)
    straight = np.linspace(start, desired(join).translation, 500)
    assert distances(straight, SINGULAR).min() < 0.02
    assert lowest_distance(changed.pose, 0.0, join, SINGULAR) > 0.7 * options.margin
    # It is there when the target is, at the speed allowed, and goes on with it.
    np.testing.assert_allclose(changed.pose(join - 1e-9).translation, desired(join).translation, atol=1e-6)
    np.testing.assert_array_equal(changed.pose(join + 1.0).translation, desired(join + 1.0).translation)
    assert speeds(changed.pose, np.linspace(0.0, join, 2001))[0] <= 1.01 * options.limits.linear


def test_a_trajectory_that_is_over_too_soon_cannot_be_joined():
    changed, desired, _ = approach(near_transversal.STARTS[1].position, duration=5.0)
    (piece,) = changed.pieces
    assert piece.path is None and mentions(piece.reason, "join")
    np.testing.assert_array_equal(changed.pose(0.0).translation, desired(0.0).translation)


def test_a_camera_that_is_only_turned_joins_too():
    task = TASKS[TRAJECTORIES][1]
    turned = task.target_pose(0.0).integrate([0.0, 0.0, 0.0, 0.0, 0.0, 0.4], 1.0)
    changed = plan_trajectory(SINGULAR, task.target_pose, task.path.duration, AVOIDANCE, turned)
    (piece,) = changed.pieces
    assert piece.path and 2.0 < piece.times[-1] < 6.0
    np.testing.assert_allclose(changed.pose(0.0).rotation, turned.rotation, atol=1e-12)
    join = piece.times[-1]
    np.testing.assert_allclose(changed.pose(join - 1e-9).rotation, task.target_pose(join).rotation, atol=1e-6)


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_a_trajectory_without_duration_is_refused(duration):
    with pytest.raises(GeometryError, match="duration"):
        plan_trajectory(SINGULAR, TASKS[TRAJECTORIES][0].target_pose, duration)
