# SPDX-License-Identifier: Apache-2.0
"""A timed way: where it begins and ends, that its twist is its motion, that it keeps its limits."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import numbers, poses, vectors

from plsing_ros.errors import GeometryError
from plsing_ros.geometry import Pose
from plsing_ros.planning.camera_path import CameraPath, SpeedLimits

few = settings(max_examples=30)
shares = st.floats(0.02, 0.98)
limits = st.builds(SpeedLimits, numbers(0.01, 2.0), numbers(0.01, 2.0), numbers(0.1, 5.0))


@st.composite
def paths(draw):
    waypoints = np.reshape(draw(st.lists(vectors(), max_size=3)), (-1, 3))
    return CameraPath(draw(poses()), draw(poses()), draw(limits), waypoints, draw(vectors(3, -0.5, 0.5)))


def between(one, other):
    """Twist that takes one pose to the other in unit time, in the first one's frame, to first order."""
    turn = Rotation.from_matrix(one.rotation.T @ other.rotation).as_rotvec()
    return np.concatenate([one.rotation.T @ (other.translation - one.translation), turn])


@few
@given(path=paths())
def test_it_goes_from_start_to_goal(path):
    for pose, end in ((path.pose(0.0), path.start), (path.pose(path.duration), path.target)):
        # A path may be so short that its duration underflows on the path.
        np.testing.assert_allclose(pose.translation, end.translation, rtol=0.0, atol=1e-100)
        np.testing.assert_allclose(pose.rotation, end.rotation, rtol=0.0, atol=1e-100)
    # Also as a limit, not only by definition.
    rotation, position = path.poses(np.array([0.0, 1.0]))
    np.testing.assert_allclose(position, [path.start.translation, path.target.translation], atol=1e-12)
    np.testing.assert_allclose(rotation, [path.start.rotation, path.target.rotation], atol=1e-7)
    assert path.progress(0.0) == (0.0 if path.duration > 0.0 else 1.0)
    assert path.progress(path.duration) == 1.0
    assert not path.twist(0.0).any()
    assert not path.twist(path.duration).any()


@few
@given(path=paths(), share=shares)
def test_the_twist_is_the_central_difference_of_the_pose(path, share):
    # In a shorter time rounding of the positions is a speed.
    assume(path.duration > 1e-3)
    time, step = share * path.duration, 1e-5 * path.duration
    before, middle, after = (path.pose(time + sign * step) for sign in (-1.0, 0.0, 1.0))
    difference = (between(middle, after) - between(middle, before)) / (2.0 * step)
    # Where a ramp ends the twist has a kink, which the difference misses by a share of the step.
    np.testing.assert_allclose(path.twist(time), difference, atol=3e-5 * (1.0 + np.abs(difference).max()))


@few
@given(path=paths(), speed=limits, share=st.floats(0.0, 1.0))
def test_it_keeps_the_speed_limits_and_starts_and_stops_gently(path, speed, share):
    path = CameraPath(path.start, path.target, speed, [0.5 * (path.start.translation + path.target.translation) + 1.0])
    time = share * path.duration
    ramp = max(min(time, path.duration - time) / speed.ramp, 0.0)
    twist = path.twist(time)
    assert np.linalg.norm(twist[:3]) <= speed.linear * min(1.0, ramp) * (1.0 + 1e-9) + 1e-12
    assert np.linalg.norm(twist[3:]) <= speed.angular * min(1.0, ramp) * (1.0 + 1e-9) + 1e-12


@few
@given(path=paths(), share=st.floats(0.0, 1.0))
def test_the_twist_is_continuous(path, share):
    assume(path.duration > 0.0)
    step = 1e-9 * path.duration
    change = path.twist(share * path.duration + step) - path.twist(share * path.duration)
    assert np.abs(change).max() <= 1e-6


@few
@given(start=poses(), target=poses(), share=st.floats(0.0, 1.0))
def test_without_corners_it_is_straight_and_turns_the_shortest_way(start, target, share):
    path = CameraPath(start, target, SpeedLimits())
    rotation, position = path.poses(np.array([share]))
    straight = (1.0 - share) * start.translation + share * target.translation
    np.testing.assert_allclose(position[0], straight, atol=1e-9)
    whole = Rotation.from_matrix(start.rotation.T @ target.rotation).magnitude()
    done = Rotation.from_matrix(start.rotation.T @ rotation[0]).magnitude()
    assert done == pytest.approx(share * whole, abs=1e-6)


def test_corners_are_rounded_but_not_forgotten():
    start, target = Pose(np.eye(3), np.zeros(3)), Pose(np.eye(3), np.array([1.0, 0.0, 0.0]))
    path = CameraPath(start, target, SpeedLimits(), [[0.5, 0.5, 0.0]])
    _, position = path.poses(np.linspace(0.0, 1.0, 500))
    waypoint = np.linalg.norm(position - [0.5, 0.5, 0.0], axis=1).min()
    # One third of the spline's interval of 2^0.5 / 24 m on either side, at 45 degrees.
    assert 0.0 < waypoint < 0.03
    inside = np.abs(position[:, 0] - 0.5) + position[:, 1]
    assert inside.max() <= 0.5 + 1e-12
    assert np.linalg.norm(np.diff(position, axis=0), axis=1).sum() <= path.length


def test_a_tilt_is_full_half_way():
    path = CameraPath(Pose(np.eye(3), np.zeros(3)), Pose(np.eye(3), np.ones(3)), SpeedLimits(), tilt=[0.3, 0.0, 0.0])
    rotation, _ = path.poses(np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(
        Rotation.from_matrix(rotation).as_rotvec(), [[0, 0, 0], [0.3, 0, 0], [0, 0, 0]], atol=1e-9
    )


@few
@given(pose=poses())
def test_a_goal_that_is_the_start_is_reached_at_once(pose):
    path = CameraPath(pose, Pose(pose.rotation, pose.translation), SpeedLimits())
    assert path.duration == pytest.approx(0.0, abs=1e-3)
    assert path.pose(1.0).translation == pytest.approx(pose.translation)
    assert not path.twist(1.0).any()


@few
@given(path=paths(), count=st.integers(2, 20))
def test_sampled_poses_begin_at_the_start_and_end_at_the_goal(path, count):
    sampled = path.sampled(count)
    assert len(sampled) == count
    assert (sampled[0], sampled[-1]) == (path.start, path.target)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"linear": 0.0}, "speed limit 'linear' is 0.0 m/s; it must be positive and finite"),
        ({"angular": float("nan")}, "'angular' is nan rad/s"),
        ({"ramp": -1.0}, "'ramp' is -1.0 s"),
    ],
)
def test_limits_that_are_none_are_refused(values, message):
    with pytest.raises(GeometryError, match=message):
        SpeedLimits(**values)


@pytest.mark.parametrize("waypoints", [(1.0, 0.0), (1.0, 0.0, 0.0), [[1.0, 0.0]], [[np.nan, 0.0, 0.0]], "none"])
def test_corners_that_are_none_are_refused(waypoints):
    with pytest.raises(GeometryError, match="waypoints"):
        CameraPath(Pose(np.eye(3), np.zeros(3)), Pose(np.eye(3), np.ones(3)), SpeedLimits(), waypoints)
