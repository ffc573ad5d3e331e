# SPDX-License-Identifier: Apache-2.0
"""The covariance of the commanded twist, beside differences of the commands themselves."""

import numpy as np
import pytest
from messages import mentions
from test_pose_laws import LINES, SECOND, TARGET, covariance, seen_by, servo_with

from plsing_ros.features import LineObservation

HERE = TARGET.integrate([0.02, -0.03, 0.05, 0.01, -0.02, 0.03], 1.0)
OWN = np.array([[4e-6, 1e-7, 1e-6], [1e-6, 0.0, 1e-6], [9e-6, -1e-6, 4e-6], [1e-6, 1e-8, 1e-6], [2e-6, 0.0, 3e-6]])
POSE = covariance(0.004, 0.003)
STEP = 1e-6


def answered(law, off=None, error=None):
    """Return a servo that has answered one frame: image lines off by (angle, offset) each, the pose by a twist."""
    servo = servo_with(law, gain=0.7)
    told = HERE if error is None else HERE.integrate(error, 1.0)
    image = seen_by(HERE).image_lines.copy()
    if off is not None:
        angle = np.arctan2(image[:, 1], image[:, 0]) + off[:, 0]
        image = np.column_stack([np.cos(angle), np.sin(angle), image[:, 2] + off[:, 1]])
    servo.receive_pose(told, SECOND, POSE)
    observation = LineObservation(LINES.ids, image, np.ones(5, dtype=bool), seen_by(told).lines_camera, covariances=OWN)
    return servo, servo.answer(observation, SECOND, SECOND)


def slopes(law, with_pose):
    """Return the derivatives of the twist by angles and offsets, shape (6, 10), and by the pose, shape (6, 6)."""
    by_image = []
    for unit in np.eye(10):
        ends = [answered(law, off=sign * STEP * unit.reshape(5, 2))[1].twist for sign in (1.0, -1.0)]
        by_image.append((ends[0] - ends[1]) / (2.0 * STEP))
    by_pose = [np.zeros(6)] * 6
    if with_pose:
        ends = [[answered(law, error=sign * STEP * unit)[1].twist for sign in (1.0, -1.0)] for unit in np.eye(6)]
        by_pose = [(each[0] - each[1]) / (2.0 * STEP) for each in ends]
    return np.array(by_image).T, np.array(by_pose).T


@pytest.mark.parametrize("law", ["pinv", "dls", "adaptive_dls", "guarded", "position", "fused"])
def test_it_is_what_errors_of_image_and_pose_make_of_the_twist(law):
    by_image, by_pose = slopes(law, law in ("position", "fused"))
    blocks = np.zeros((10, 10))
    for i, (first, mixed, second) in enumerate(OWN):
        blocks[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[first, mixed], [mixed, second]]
    expected = by_image @ blocks @ by_image.T + by_pose @ POSE @ by_pose.T
    servo, command = answered(law)
    assert command.mode.moves
    got = servo.twist_covariance()
    # What the error that is left makes of errors of L and of the frame is beyond the first order.
    assert np.abs(got - expected).max() < 0.1 * np.abs(expected).max()
    assert np.linalg.eigvalsh(got)[0] > -1e-12 * np.abs(got).max()


def test_it_shrinks_with_the_speed_and_is_zero_at_rest():
    servo, command = answered("pinv")
    assert not command.saturated
    free = servo.twist_covariance()
    slow = servo_with("pinv", gain=0.7, max_linear_speed=0.1 * np.linalg.norm(command.twist[:3]))
    image = seen_by(HERE)
    observation = LineObservation(LINES.ids, image.image_lines, image.usable, image.lines_camera, covariances=OWN)
    slow.answer(observation, SECOND, SECOND)
    np.testing.assert_allclose(slow.twist_covariance(), 0.01 * free, rtol=1e-9)
    slow.halt("for a test")
    assert not slow.twist_covariance().any()


def test_what_could_not_be_checked_is_said():
    servo = servo_with("pinv")
    servo.answer(seen_by(HERE), SECOND, SECOND)
    assert servo.unchecked == ""
    servo.step(LineObservation(LINES.ids, seen_by(HERE).image_lines), 1.2)
    assert mentions(servo.unchecked, "pose_estimator")
