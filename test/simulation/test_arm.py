# SPDX-License-Identifier: Apache-2.0
"""The arm against MuJoCo's kinematics and against differences; how it follows twists."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from messages import mentions
from scipy.spatial.transform import Rotation

from plsing_ros.errors import GeometryError
from plsing_ros.geometry import Pose
from plsing_ros.simulation.arm import LIMITS, Arm
from plsing_ros.simulation.arm_motion import follow_twist

ARM = Arm(Pose(Rotation.from_rotvec([0.2, -0.3, 1.0]).as_matrix(), [-0.4, 0.1, 0.05]))
BENT = np.array([0.3, 0.4, 1.5, -0.6, 0.9, 0.5])
joints = st.lists(st.floats(-0.98, 0.98), min_size=6, max_size=6).map(lambda shares: np.array(shares) * LIMITS)
twists = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).map(np.array)


def moved(before, after):
    """The motion from one pose to another in the frame of the first, by the rotation vector of SciPy."""
    off = before.inverse() @ after
    return np.concatenate([off.translation, Rotation.from_matrix(off.rotation).as_rotvec()])


@given(at=joints)
def test_the_jacobian_is_the_difference_quotient_of_the_pose(at):
    step = 1e-6
    pairs = [(ARM.camera_pose(at - step * row), ARM.camera_pose(at + step * row)) for row in np.eye(6)]
    here = ARM.camera_pose(at)
    columns = [(moved(here, after) - moved(here, before)) / (2 * step) for before, after in pairs]
    np.testing.assert_allclose(ARM.jacobian(at), np.column_stack(columns), atol=1e-7)


@settings(max_examples=30)
@given(at=joints)
def test_joints_are_found_for_every_pose_that_the_arm_can_have(at):
    pose = ARM.camera_pose(at)
    found = ARM.joints_for(pose)
    assert (np.abs(found) <= LIMITS).all()
    assert np.abs(moved(ARM.camera_pose(found), pose)).max() < 1e-5


def test_a_pose_out_of_reach_is_refused_with_its_distance():
    with pytest.raises(GeometryError, match=r"\b2\.00 m\b"):
        Arm(Pose(np.eye(3), np.zeros(3))).joints_for(Pose.look_at((2.0, 0.0, 0.0), (3.0, 0.0, 0.0)))


@given(twist=twists)
def test_away_from_singularities_and_limits_the_camera_follows(twist):
    motion = follow_twist(ARM, BENT, 0.1 * twist, 10.0, 0.01)
    assert motion.reason == ""
    np.testing.assert_allclose(ARM.jacobian(BENT) @ motion.speeds, 0.1 * twist, atol=1e-9)


# Upright arm and forearm: the sideways speed is carried, at the price of a turn.
@example(at=LIMITS * [0, 0.75, 0, 0, 0, 0], twist=np.array([0, 1.0, 0, 0, 0, 0]), limit=1.0, duration=0.5)
@given(at=joints, twist=twists, limit=st.floats(0.01, 3.0), duration=st.floats(1e-3, 0.5))
def test_no_joint_is_too_fast_or_leaves_its_limits_and_what_is_not_followed_is_said(at, twist, limit, duration):
    motion = follow_twist(ARM, at, twist, limit, duration)
    assert np.abs(motion.speeds).max() <= limit * (1 + 1e-12)
    assert (np.abs(at + duration * motion.speeds) <= LIMITS * (1 + 1e-12)).all()
    missing = np.linalg.norm(ARM.jacobian(at) @ motion.speeds - twist)
    assert motion.reason or missing <= 0.5 * np.linalg.norm(twist) + 1e-9


def test_a_fast_motion_keeps_its_direction():
    twist = np.array([1.0, 2.0, -3.0, 0.5, 0.2, 0.1])
    motion = follow_twist(ARM, BENT, twist, 0.5, 0.01)
    carried = ARM.jacobian(BENT) @ motion.speeds
    np.testing.assert_allclose(carried / np.linalg.norm(carried), twist / np.linalg.norm(twist), atol=1e-9)
    assert np.abs(motion.speeds).max() == pytest.approx(0.5) and mentions(motion.reason, "joint_1")


def test_at_its_singularity_the_arm_stays_slow_and_says_so():
    straight = BENT * [1, 1, 1, 1, 0, 1]
    lost = np.linalg.svd(ARM.jacobian(straight))[0][:, -1]
    motion = follow_twist(ARM, straight, 0.1 * lost, 10.0, 0.01)
    assert np.abs(motion.speeds).max() < 0.1 and mentions(motion.reason, "singularity")
    near = straight + 1e-3 * np.array([0, 0, 0, 0, 1, 0])
    assert np.abs(follow_twist(ARM, near, 0.1 * lost, 10.0, 0.01).speeds).max() < 5.0


def test_in_front_of_a_limit_the_arm_stops():
    at = BENT.copy()
    at[2] = LIMITS[2] - 1e-4
    speeds = np.array([0, 0, 1.0, 0, 0, 0])
    motion = follow_twist(ARM, at, ARM.jacobian(at) @ speeds, 10.0, 0.01)
    np.testing.assert_allclose(motion.speeds, [0, 0, 0.01, 0, 0, 0], atol=1e-9)
    assert mentions(motion.reason, "joint_3", "2.62 rad")
    back = follow_twist(ARM, at, -ARM.jacobian(at) @ speeds, 10.0, 0.01)
    assert back.reason == "" and back.speeds[2] == pytest.approx(-1.0)
