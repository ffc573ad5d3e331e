# SPDX-License-Identifier: Apache-2.0
"""LineTracker with a camera that reads its rows one by one, on images drawn row by row from the true motion."""

from __future__ import annotations

import numpy as np
import pytest
from rendered import CAMERA, box, error, renderer

from plsing_ros.geometry import Pose
from plsing_ros.tracking import LineTracker, TrackingState

READOUT, INTERVAL, STRIP = 0.03, 1.0 / 30.0, 40


def shaken(time):
    """Return T_world_camera of a hand that moves up and down and to the side, by some 8 pixels an image."""
    up, aside = 0.03 * np.sin(7.0 * time), 0.03 * np.cos(5.0 * time)
    return Pose.look_at((0.38 + up, -0.28 + aside, 0.26 + up), (0.02 * np.sin(4.0 * time), aside, 0.8 * up))


def row_by_row(drawing, k, random):
    """Return an image of which each strip of rows is taken at its time, and the pose when the object's row was."""
    image = np.empty((CAMERA.height, CAMERA.width), dtype=np.uint8)
    for row in range(0, CAMERA.height, STRIP):
        middle = (row + 0.5 * STRIP) / CAMERA.height - 0.5
        pose = shaken(k * INTERVAL + READOUT * middle)
        image[row : row + STRIP] = drawing.render(pose.inverse(), 2.0, random)[row : row + STRIP]
    time = k * INTERVAL
    for _ in range(5):
        T_camera_model = shaken(time).inverse()
        row = CAMERA.project(T_camera_model.translation[np.newaxis])[0, 1]
        time = k * INTERVAL + READOUT * (row / CAMERA.height - 0.5)
    return image, shaken(time)


@pytest.fixture(scope="module")
def sequence():
    drawing, random = renderer(patches=20), np.random.default_rng(3)
    return [row_by_row(drawing, k, random) for k in range(14)]


def followed(sequence, readout_time, interval=INTERVAL):
    tracker = LineTracker(box(), CAMERA, readout_time=readout_time)
    found = [
        tracker.track(image, true if k == 0 else None, None if interval is None else k * interval)
        for k, (image, true) in enumerate(sequence)
    ]
    assert all(each.state in (TrackingState.TRACKING, TrackingState.WEAK) for each in found)
    return np.array([error(each.T_world_camera, true) for each, (_, true) in zip(found, sequence, strict=True)][2:])


def test_rows_read_one_by_one_are_corrected(sequence):
    at_once, by_rows = followed(sequence, 0.0), followed(sequence, READOUT)
    assert (np.median(by_rows, axis=0) < 0.3 * np.median(at_once, axis=0)).all()
    assert np.median(by_rows[:, 0]) < 1e-3


def test_without_the_time_between_images_nothing_is_corrected(sequence):
    assert np.array_equal(followed(sequence, READOUT, None), followed(sequence, 0.0))
