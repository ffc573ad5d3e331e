# SPDX-License-Identifier: Apache-2.0
"""What the camera sees of each line against the map: its mean, and how sure that is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays
from strategies import numbers

from plsing_ros.features import LineObservation, project_lines
from plsing_ros.geometry import LineSet
from plsing_ros.monitoring.map_residuals import MapResiduals

LINES = LineSet.from_points_directions(
    [[0.1, 0.2, 2.0], [-0.3, 0.1, 1.5], [0.2, -0.2, 2.5]], [[1, 0, 0.2], [0, 1, 0.1], [1, 1, 0]], "camera", (4, 7, 9)
)


def off(errors, usable=(True, True, True)):
    """What is seen if each image line is off by an angle and an offset, shape (3, 2)."""
    x, y, z = project_lines(LINES).reshape(-1, 3).T
    angle = np.arctan2(y, x) + errors[:, 0]
    image = np.column_stack([np.cos(angle), np.sin(angle), z + errors[:, 1]])
    return LineObservation(LINES.ids, image, np.array(usable), LINES.select(np.flatnonzero(usable)))


@given(errors=arrays(float, (12, 3, 2), elements=numbers(-0.05, 0.05)))
@settings(deadline=None, max_examples=30)
def test_mean_and_its_covariance_are_those_of_the_frames(errors):
    residuals = MapResiduals(LINES)
    for each in errors:
        residuals.add(off(each))
    rows = residuals.rows()
    assert rows[:, :2] == pytest.approx(errors.mean(axis=0), abs=1e-12)
    for row, line in zip(rows, range(3), strict=True):
        expected = np.cov(errors[:, line].T) / len(errors) + 1e-8 * np.eye(2)
        assert row[2:] == pytest.approx(expected[[0, 0, 1], [0, 1, 1]], abs=1e-12)


def test_lines_that_were_hardly_seen_are_not_told():
    residuals = MapResiduals(LINES)
    assert residuals.rows() is None
    for k in range(4):
        residuals.add(off(np.full((3, 2), 0.01), (True, True, k < 2)))
    residuals.add(LineObservation.from_image_lines(LINES.ids, off(np.zeros((3, 2))).image_lines))
    rows = residuals.rows()
    assert np.isfinite(rows[:2]).all() and np.isnan(rows[2]).all()
    assert rows[:2, :2] == pytest.approx(0.01)


def test_old_frames_are_forgotten():
    residuals = MapResiduals(LINES)
    for error in (0.05, 0.0):
        for _ in range(300):
            residuals.add(off(np.full((3, 2), error)))
            residuals.rows()
    assert np.abs(residuals.rows()[:, :2]).max() < 1e-4
