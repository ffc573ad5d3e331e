# SPDX-License-Identifier: Apache-2.0
"""A line that is far off and says so: laws that do not weigh lines go without it."""

import numpy as np
import pytest
from messages import mentions

from plsing_ros.control.servo_controller import ServoController
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose

SECOND, STEP = 10**9, 0.1
NUMBERS = np.random.default_rng(3).uniform(-1.0, 1.0, size=(2, 8, 3))
LINES = LineSet.from_points_directions(*NUMBERS)
TARGET = Pose(np.eye(3), np.array([0.1, 0.2, -4.0]))
START = TARGET.integrate([0.2, -0.1, 0.15, 0.05, -0.08, 0.1], 1.0)
SURE, UNSURE = 5e-4, 0.1  # [rad]
BAD = 4


def seen_from(pose, lines=LINES, known=True):
    """Line 4 is as far off as it says, always to the same side."""
    seen = LineObservation.of_lines(lines.transformed(pose.inverse(), "camera"))
    image, rows = seen.image_lines.copy(), np.array(lines.ids) == BAD
    angle = np.arctan2(image[:, 1], image[:, 0]) + UNSURE * rows
    image = np.column_stack([np.cos(angle), np.sin(angle), image[:, 2]])
    deviation = np.where(rows, UNSURE, SURE)
    covariances = np.square(deviation)[:, None] * [1.0, 0.0, 1.0]
    return LineObservation(seen.ids, image, seen.usable, seen.lines_camera, covariances=covariances if known else None)


def servo_for(law, lines=LINES):
    return ServoController(lines, TARGET, law=law, gain=1.0, max_linear_speed=0.0, max_angular_speed=0.0)


def distance_at_the_end(law, lines=LINES, known=True):
    servo, pose = servo_for(law, lines), START
    for k in range(100):
        command = servo.step(seen_from(pose, lines, known), 1.0 + k * STEP)
        pose = pose.integrate(command.twist, STEP)
    return np.linalg.norm(pose.translation - TARGET.translation), command.reason


@pytest.mark.parametrize("law", ["pinv", "dls", "adaptive_dls", "guarded"])
def test_they_arrive_by_the_other_lines(law):
    off, reason = distance_at_the_end(law)
    assert off < 1e-3 and mentions(reason, "line 4 left out", "less certain")
    assert distance_at_the_end(law, known=False)[0] > 0.02


def test_four_lines_are_all_used():
    # Three of these see about as well alone.
    four = LINES.select([1, 3, 5, 7])
    assert BAD in four.ids
    twists = [servo_for("pinv", four).step(seen_from(START, four, known), 1.0) for known in (True, False)]
    np.testing.assert_array_equal(twists[0].twist, twists[1].twist)
    assert "left out" not in twists[0].reason


@pytest.mark.parametrize("law", ["pinv", "guarded", "detour"])
def test_the_twist_and_its_covariance_are_those_without_the_line(law):
    others = LINES.select([row for row, i in enumerate(LINES.ids) if i != BAD])
    one, other = servo_for(law), servo_for(law, others)
    found, expected = one.step(seen_from(START), 1.0), other.step(seen_from(START, others), 1.0)
    assert expected.mode.moves
    np.testing.assert_allclose(found.twist, expected.twist, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(one.twist_covariance(), other.twist_covariance(), rtol=1e-6)


@pytest.mark.parametrize("law", ["position", "fused"])
def test_a_law_that_weighs_lines_or_does_without_keeps_them(law):
    assert "left out" not in servo_for(law).step(seen_from(START), 1.0).reason
