# SPDX-License-Identifier: Apache-2.0
"""Features, poses and ids that contradict each other or the scene, as the monitor says them."""

import numpy as np
import pytest
from control.test_refusals import CAMERA, CONTRADICTIONS, LINES, seen
from hypothesis import given
from scipy.spatial.transform import Rotation
from strategies import numbers, vectors

from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters import MonitorParameters
from plsing_ros.simulation import near_transversal

SECOND = 10**9
NAMED = (Level.CRITICAL, Level.UNOBSERVABLE)


def monitor_with(**values):
    task = {
        "lines.points": LINES.point.ravel(),
        "lines.directions": LINES.direction.ravel(),
        "lines.position_std": [0.0],
        "lines.direction_std": [0.0],
        "target.known": True,
        "target.position": near_transversal.TARGET_POSITION,
        "target.orientation": near_transversal.ORIENTATION,
    }
    return SingularityMonitor.from_parameters(MonitorParameters.from_values({**task, **values}))


@pytest.mark.parametrize("with_pose", [True, False])
@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_every_contradiction_is_named_from_the_first_frame_on_and_after_good_ones(name, with_pose):
    observation, words = CONTRADICTIONS[name]
    for good_frames in (0, 3):
        monitor = monitor_with()
        for frame in range(good_frames + 1):
            stamp = (frame + 1) * SECOND // 10
            if with_pose:
                monitor.receive_pose(CAMERA, stamp)
            found = monitor.answer(seen() if frame < good_frames else observation, stamp, stamp)
        assert found.level in NAMED, (name, found.level)
        assert words in found.reason, found.reason


def told(pose, camera=None):
    """What is said of right features with another pose."""
    monitor = monitor_with()
    camera = CAMERA if camera is None else camera
    monitor.receive_pose(pose, SECOND)
    return monitor.answer(LineObservation.of_lines(LINES.transformed(camera.inverse(), "camera")), SECOND, SECOND)


NEAR = Pose(CAMERA.rotation, near_transversal.POINT_ON_TRANSVERSAL + np.array([0.003, 0.0, 0.0]))


@given(direction=vectors(3, -1.0, 1.0).filter(lambda v: np.linalg.norm(v) > 0.1), apart=numbers(0.05, 5.0))
def test_a_pose_that_contradicts_exact_lines_is_named_however_near_a_transversal_the_camera_is(direction, apart):
    shift = apart * direction / np.linalg.norm(direction)
    found = told(Pose(NEAR.rotation, NEAR.translation + shift), NEAR)
    assert found.level in NAMED and "camera_pose" in found.reason


@pytest.mark.parametrize(
    "wrong",
    [NEAR.inverse(), Pose(NEAR.rotation @ Rotation.from_euler("z", 90, degrees=True).as_matrix(), NEAR.translation)],
    ids=["inverted", "turned by 90 degrees"],
)
def test_an_inverted_or_turned_pose_is_named(wrong):
    found = told(wrong, NEAR)
    assert found.level in NAMED and "camera_pose" in found.reason


def test_an_unknown_id_is_left_out_and_said():
    right = seen()
    both = LineSet(
        np.vstack([right.lines_camera.direction, [[1.0, 0.0, 0.0]]]),
        np.vstack([right.lines_camera.moment, [[0.0, 4.0, -0.5]]]),
        "camera",
        (*right.ids, 99),
    )
    monitor, other = monitor_with(), monitor_with()
    found = monitor.answer(LineObservation.of_lines(both), SECOND, SECOND)
    without = other.answer(right, SECOND, SECOND)
    assert found.level is without.level and found.line_count == 4
    assert "99" in found.reason and "left out" in found.reason and "99" not in without.reason
