"""A follower asks for what is seen on the way, and for the motion that goes along with it."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import poses, seen_lines, vectors

from plsing_ros.features import image_depth, interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.servoing.camera_path import CameraPath, SpeedLimits
from plsing_ros.servoing.way_following import WayFollower

few = settings(max_examples=30)
LIMITS = SpeedLimits(0.1, 0.2, 1.0)


@st.composite
def followers(draw):
    """A follower near poses from which all lines have an image."""
    start = draw(poses())
    in_camera = draw(seen_lines(min_size=3))
    goal = start.moved(draw(vectors(6, -0.1, 0.1)), 1.0)
    path = CameraPath(start, goal, LIMITS, start.translation + draw(vectors(3, -0.1, 0.1)))
    return WayFollower(path, in_camera.transformed(start, "world"))


def image_line(line_point, line_direction, pose):
    """Normal of the plane of camera centre and line, in the camera frame, scaled: no Plücker coordinates."""
    one, other = (pose.rotation.T @ (line_point + place * line_direction - pose.translation) for place in (0.0, 1.0))
    normal = np.cross(one, other)
    return normal / np.hypot(normal[0], normal[1])


@few
@given(follower=followers(), share=st.floats(0.0, 1.2))
def test_desired_features_are_what_is_seen_on_the_way(follower, share):
    follower.advance(share * follower.path.duration)
    reference = follower.reference()
    pose = follower.path.pose(share * follower.path.duration)
    lines = follower._lines
    assert set(reference.desired) <= set(lines.ids)
    for i, desired in reference.desired.items():
        row = lines.ids.index(i)
        np.testing.assert_allclose(desired, image_line(lines.point[row], lines.direction[row], pose), atol=1e-6)


@few
@given(follower=followers(), share=st.floats(0.05, 0.9), cycle=st.floats(1e-4, 1e-1))
def test_the_feedforward_is_the_motion_in_the_middle_of_the_coming_cycle(follower, share, cycle):
    path, step = follower.path, 1e-5
    time = share * path.duration + 0.5 * cycle
    assume(path.duration > 1.0 and share * path.duration > cycle and time + step < path.duration)
    follower.advance(share * path.duration - cycle)
    follower.advance(cycle)
    before, middle, after = (path.pose(time + sign * step) for sign in (-1.0, 0.0, 1.0))
    turn = Rotation.from_matrix(before.rotation.T @ after.rotation).as_rotvec()
    motion = np.concatenate([middle.rotation.T @ (after.translation - before.translation), turn]) / (2.0 * step)
    np.testing.assert_allclose(follower.reference().feedforward, motion, atol=1e-5)


@few
@given(follower=followers(), share=st.floats(0.05, 0.9))
def test_features_move_as_the_feedforward_says(follower, share):
    path, step = follower.path, 1e-5
    assume(path.duration > 1.0)
    follower.advance(share * path.duration - step)
    before = follower.reference()
    follower.advance(step)
    here = follower.reference()
    follower.advance(step)
    after = follower.reference()
    lines = follower._lines.transformed(here.T_scene_camera.inverse(), "camera")
    assume(image_depth(lines).min() > 0.05)
    rate = [(after.desired[i] - before.desired[i]) / (2.0 * step) for i in lines.ids]
    expected = interaction_matrix(lines) @ path.twist(share * path.duration)
    np.testing.assert_allclose(np.ravel(rate), expected, atol=1e-3)


@settings(max_examples=15)
@given(follower=followers())
def test_the_feedforward_alone_leads_to_the_goal(follower):
    path, cycle = follower.path, 0.04
    assume(path.duration > 0.0)
    pose = path.start
    for _ in range(int(path.duration / cycle) + 2):
        pose = pose.moved(follower.reference().feedforward, cycle)
        follower.advance(cycle)
    assert follower.reference().progress == 1.0
    assert not follower.reference().feedforward.any()
    # The first cycle is spent at rest, before the length of a cycle is known.
    assert np.linalg.norm(pose.translation - path.goal.translation) < 3e-3


@few
@given(follower=followers())
def test_it_waits_and_never_goes_back(follower):
    follower.advance(0.3 * follower.path.duration)
    there = follower.reference()
    follower.advance(0.0)
    follower.advance(-1.0)
    assert follower.reference().progress == there.progress
    follower.advance(10.0 * follower.path.duration)
    assert follower.reference().progress == 1.0
    np.testing.assert_array_equal(follower.reference().T_scene_camera.translation, follower.path.goal.translation)


def test_lines_without_an_image_on_the_way_are_left_out():
    goal = Pose(np.eye(3), np.array([1.0, 0.0, 0.0]))
    lines_points = [[0.5, 0.0, 0.0], [0.0, 1.0, 3.0], [0.0, -1.0, 3.0]]
    lines = LineSet.from_points_directions(lines_points, [[0.0, 1.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.2]])
    follower = WayFollower(CameraPath(Pose(np.eye(3), np.zeros(3)), goal, LIMITS), lines)
    follower.advance(0.5 * follower.path.duration)
    assert set(follower.reference().desired) == {2, 3}
