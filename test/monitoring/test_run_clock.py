# SPDX-License-Identifier: Apache-2.0
"""When a run begins, how long it has been at its target, and how far it is along the motions that are asked for."""

import numpy as np
import pytest
from near_transversal_scene import LOOK, SECOND, TARGET
from scipy.spatial.transform import Rotation

from plsing_ros.geometry import Pose
from plsing_ros.monitoring.run_clock import RunClock, distance_between

FAR = Pose(LOOK, TARGET.translation + [1.0, 0.0, 0.0])
NEAR = Pose(LOOK, TARGET.translation + [0.5, 0.0, 0.0])


def moved(clock, seconds, pose):
    stamp = round(seconds * SECOND)
    clock.note_motion(stamp, 0.1)
    return clock.update(stamp, pose, TARGET)


def test_a_run_begins_anew_at_rest_but_not_while_it_moves():
    clock = RunClock()
    assert clock.update(SECOND, FAR, TARGET) == 0.0
    first = clock.run
    for second in range(2, 7):
        assert moved(clock, second, NEAR) == second - 1.0
        assert clock.start_distance == pytest.approx(1.0)
    assert clock.run == first
    # Rest for more than a second: another run, which stays one as long as the camera rests.
    assert clock.update(8 * SECOND, NEAR, TARGET) == 0.0
    assert clock.start_distance == pytest.approx(0.5) and clock.run == first + 1
    assert clock.update(9 * SECOND, NEAR, TARGET) == 0.0 and clock.run == first + 1


def test_a_run_is_over_a_second_after_the_arrival_and_not_when_noise_passes_the_target():
    clock = RunClock()
    clock.update(0, FAR, TARGET)
    for tenth in range(1, 31):
        # Every other frame seems to be there.
        moved(clock, 0.1 * tenth, TARGET if tenth % 2 else NEAR)
    assert clock.start == 0 and clock.arrived_for == 0.0
    for tenth in range(31, 40):
        assert moved(clock, 0.1 * tenth, TARGET) == pytest.approx(0.1 * tenth)
        assert clock.arrived_for == pytest.approx(0.1 * (tenth - 31))
    first = clock.run
    assert moved(clock, 4.2, TARGET) == 0.0
    assert clock.run == first + 1


def test_a_start_that_was_poorly_known_is_no_nearer_than_the_camera_can_have_come_from():
    clock, far = RunClock(), Pose(LOOK, TARGET.translation + [3.0, 0.0, 0.0])
    clock.note_motion(SECOND, 0.1)
    clock.update(SECOND, FAR, TARGET, deviation=1.0)
    moved(clock, 2.0, far)
    # Seen 3 m away after 0.1 m of motion.
    assert clock.start_distance == pytest.approx(2.9)
    moved(clock, 3.0, Pose(LOOK, TARGET.translation + [9.0, 0.0, 0.0]))
    assert clock.start_distance == pytest.approx(1.0 + 3.0)
    exact = RunClock()
    exact.note_motion(SECOND, 0.1)
    exact.update(SECOND, FAR, TARGET)
    moved(exact, 2.0, far)
    assert exact.start_distance == pytest.approx(1.0)


def test_distances_are_those_of_the_degrees_of_freedom_in_use():
    here = TARGET @ Pose(Rotation.from_rotvec([0.0, 0.3, 0.0]).as_matrix(), np.array([0.1, 0.2, 0.4]))
    distance, angle = distance_between(here, TARGET, [1] * 6)
    assert distance == pytest.approx(np.linalg.norm([0.1, 0.2, 0.4])) and angle == pytest.approx(0.3)
    camera = here.rotation.T @ (here.translation - TARGET.translation)
    assert distance_between(here, TARGET, (1, 1, 0, 1, 0, 1)) == pytest.approx((np.linalg.norm(camera[:2]), 0.0))
