# SPDX-License-Identifier: Apache-2.0
"""A line that the controller leaves out is left out by the roll-outs and by the check of the commanded twists."""

import numpy as np
import pytest
from near_transversal_scene import SECOND

from plsing_ros.control.servo_controller import ServoController
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.monitoring.risk_predictor import RiskPredictor
from plsing_ros.parameters import MonitorParameters
from plsing_ros.singularities import singular_set

LINES = LineSet.from_points_directions(*np.random.default_rng(3).uniform(-1.0, 1.0, size=(2, 8, 3)))
SINGULAR = singular_set(LINES)
TARGET = Pose(np.eye(3), np.array([0.1, 0.2, -4.0]))
HERE = TARGET.integrate([0.2, -0.1, 0.15, 0.05, -0.08, 0.1], 1.0)
SURE, UNSURE = 5e-4, 0.3


def seen():
    """One of eight lines is far off, and says so."""
    exact = LineObservation.of_lines(LINES.transformed(HERE.inverse(), "camera"))
    deviation = np.array([SURE] * 7 + [UNSURE])
    image, off = exact.image_lines, np.array([0.0] * 7 + [UNSURE])
    angle = np.arctan2(image[:, 1], image[:, 0]) + off
    image = np.column_stack([np.cos(angle), np.sin(angle), image[:, 2]])
    covariances = np.square(deviation)[:, None] * [1.0, 0.0, 1.0]
    return LineObservation(exact.ids, image, exact.usable, exact.lines_camera, covariances=covariances)


@pytest.mark.parametrize("law", ["pinv", "guarded", "position"])
def test_the_law_is_rolled_out_and_compared_without_it(law):
    values = {
        "lines.points": LINES.point.ravel(),
        "lines.directions": LINES.direction.ravel(),
        "lines.position_std": [0.0],
        "lines.direction_std": [0.0],
        "target.known": True,
        "target.position": TARGET.translation,
        "target.orientation": TARGET.quaternion_xyzw,
        "law": law,
        "gain": 1.0,
        "prediction.period": 0.01,
    }
    parameters, predictor = MonitorParameters.from_values(values), RiskPredictor()
    twist = ServoController(LINES, TARGET, law=law, gain=1.0).step(seen(), 1.0).twist
    assert np.linalg.norm(twist[:3]) > 0.05
    for k in range(20):
        stamp = SECOND + k * SECOND // 30
        risk = predictor.latest(stamp, HERE, None, seen(), SINGULAR, TARGET, parameters)
        assert risk is not None and predictor.other_law == ""
        if k == 0:
            np.testing.assert_allclose(risk.outcomes.first_linear_speed, np.linalg.norm(twist[:3]), rtol=1e-9)
        predictor.receive_twist(twist, stamp, 0.01)
