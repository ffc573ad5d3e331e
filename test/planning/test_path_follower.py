# SPDX-License-Identifier: Apache-2.0
"""A follower asks for what is seen on the path, and for the motion that goes along with it."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import poses, seen_lines, vectors

from plsing_ros.features import image_depth, interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.planning.camera_path import CameraPath, SpeedLimits
from plsing_ros.planning.path_follower import PathFollower

few = settings(max_examples=30)
LIMITS = SpeedLimits(0.1, 0.2, 1.0)


@st.composite
def followers(draw):
    """A follower near poses from which all lines have an image."""
    start = draw(poses())
    in_camera = draw(seen_lines(min_size=3))
    target = start.integrate(draw(vectors(6, -0.1, 0.1)), 1.0)
    path = CameraPath(start, target, LIMITS, [start.translation + draw(vectors(3, -0.1, 0.1))])
    return PathFollower(path, in_camera.transformed(start, "world"))


def images(reference):
    """The image lines that are asked for, by id."""
    ids = reference.target.ids
    return dict(zip(ids, reference.target.view(ids, tuple(range(6))).image.reshape(-1, 3), strict=True))


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
    lines = follower.lines
    assert set(reference.target.ids) <= set(lines.ids)
    for i, desired in images(reference).items():
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
    lines = follower.lines.transformed(here.T_world_camera.inverse(), "camera")
    assume(image_depth(lines).min() > 0.05)
    rate = [(images(after)[i] - images(before)[i]) / (2.0 * step) for i in lines.ids]
    expected = interaction_matrix(lines) @ path.twist(share * path.duration)
    np.testing.assert_allclose(np.ravel(rate), expected, atol=1e-3)


@settings(max_examples=15)
@given(follower=followers())
def test_the_feedforward_alone_leads_to_the_goal(follower):
    path, cycle = follower.path, 0.04
    assume(path.duration > 0.0)
    pose = path.start
    for _ in range(int(path.duration / cycle) + 2):
        pose = pose.integrate(follower.reference().feedforward, cycle)
        follower.advance(cycle)
    assert follower.reference().progress == 1.0
    assert not follower.reference().feedforward.any()
    # The first cycle is spent at rest, before the length of a cycle is known.
    assert np.linalg.norm(pose.translation - path.target.translation) < 3e-3


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
    np.testing.assert_array_equal(follower.reference().T_world_camera.translation, follower.path.target.translation)


def test_lines_without_an_image_on_the_way_are_left_out():
    target = Pose(np.eye(3), np.array([1.0, 0.0, 0.0]))
    lines_points = [[0.5, 0.0, 0.0], [0.0, 1.0, 3.0], [0.0, -1.0, 3.0], [1.0, 0.0, 4.0]]
    directions = [[0.0, 1.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.2], [0.0, 1.0, 0.0]]
    lines = LineSet.from_points_directions(lines_points, directions)
    follower = PathFollower(CameraPath(Pose(np.eye(3), np.zeros(3)), target, LIMITS), lines)
    follower.advance(0.5 * follower.path.duration)
    assert set(follower.reference().target.ids) == {2, 3, 4}


@few
@given(follower=followers(), share=st.floats(0.0, 1.0), twist=vectors(6, -0.3, 0.3))
def test_the_displacement_taken_back_leads_to_the_way(follower, share, twist):
    """The camera's centre goes straight in space while it turns: integrated here in many small steps."""
    follower.advance(share * follower.path.duration)
    reference = follower.reference()
    asked = reference.T_world_camera
    pose = asked.integrate(twist, 1.0)
    back = -reference.displacement(pose)
    velocity, turn = pose.rotation @ back[:3], Rotation.from_rotvec(back[3:]).as_matrix()
    np.testing.assert_allclose(pose.translation + velocity, asked.translation, atol=1e-12)
    np.testing.assert_allclose(pose.rotation @ turn, asked.rotation, atol=1e-12)


@few
@given(follower=followers(), twist=vectors(6, -1e-5, 1e-5))
def test_image_and_displacement_tell_the_same_near_the_way(follower, twist):
    reference = follower.reference()
    pose = reference.T_world_camera.integrate(twist, 1.0)
    lines = follower.lines.transformed(pose.inverse(), "camera")
    assume(lines.ids == reference.target.ids and image_depth(lines).min() > 0.1)
    view = reference.target.view(lines.ids, tuple(range(6)))
    change = project_lines(lines).ravel() - view.image
    np.testing.assert_allclose(view.interaction @ reference.displacement(pose), change, atol=1e-6)
