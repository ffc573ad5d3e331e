# SPDX-License-Identifier: Apache-2.0
"""Whether a wrong pose leads away from the target, as the image tells."""

import numpy as np
from hypothesis import given, settings
from strategies import numbers, vectors
from test_pose_laws import LINES, TARGET, covariance, seen_by

from plsing_ros.control.departure import Departure
from plsing_ros.control.image_mismatch import ImageMismatch

OWN, LASTING = np.tile([1.6e-5, 0.0, 1e-6], (5, 1)), np.tile([4e-5, 0.0, 4e-5], (5, 1))
BESIDE = np.array([1.0, 0.0, 0.0])


def frame(departure, offset, error, errors_of_image=0.0):
    """Let it see a frame from an offset of the target, shape (6,), by a pose that is off by an error."""
    pose = TARGET.integrate(offset, 1.0)
    wrong = pose.integrate(error, 1.0)
    off = TARGET.inverse() @ wrong
    told = np.concatenate([off.rotation.T @ off.translation, np.zeros(3)])
    image = seen_by(pose).image_lines.ravel() + errors_of_image
    seen = ImageMismatch(LINES.transformed(wrong.inverse(), "camera"), image, np.zeros(10))
    return departure.update(seen, OWN, LASTING, covariance(), told)


def displaced(direction, by):
    return np.concatenate([by * direction / np.linalg.norm(direction), np.zeros(3)])


@given(start=vectors(3, -1.0, 1.0), on=numbers(1.1, 3.0), towards=vectors(3, -1.0, 1.0), off=numbers(0.1, 0.8))
@settings(deadline=None, max_examples=30)
def test_a_wrong_pose_is_doubted_once_the_camera_is_farther_away_and_not_before(start, on, towards, off):
    start, error = start + 2.0 * BESIDE, displaced(towards + 2.0 * BESIDE, off)
    departure = Departure()
    for share in (1.0, 0.9, 0.5, 0.1):
        assert frame(departure, displaced(start, 0.1 * share), error) == 0.0
    for _ in range(20):
        doubt = frame(departure, displaced(start, 0.1 * on), error)
    assert doubt > 0.0
    # Nor is it believed again when it is back.
    assert frame(departure, displaced(start, 0.01), error) > 0.0


@given(start=vectors(3, -1.0, 1.0), on=numbers(1.0, 5.0))
@settings(deadline=None, max_examples=30)
def test_a_right_pose_is_not_doubted_wherever_the_camera_goes(start, on):
    departure = Departure()
    for share in (1.0, 0.5, 0.5 * on, on):
        assert frame(departure, displaced(start + 2.0 * BESIDE, 0.1 * share), np.zeros(6)) == 0.0


def test_a_camera_that_was_moved_while_it_was_told_to_stand_still_was_not_led_away():
    error = displaced(BESIDE, 0.3)
    for carried in (False, True):
        departure = Departure()
        assert frame(departure, displaced(BESIDE, 0.1), error) == 0.0
        if carried:
            departure.pause()
        assert (frame(departure, displaced(BESIDE, 0.5), error) == 0.0) is carried
        assert (frame(departure, displaced(BESIDE, 0.4), error) == 0.0) is carried


def test_errors_of_an_image_that_no_pose_explains_leave_a_pose_more_room():
    scales, pattern = [], np.array([[0.0, 0.0, each] for each in (1.0, -1.0, 1.0, 1.0, -1.0)]).ravel()
    for size in (0.0, 3e-4, 1e-3, 1.0):
        departure = Departure()
        frame(departure, displaced(BESIDE, 0.1), np.zeros(6), size * pattern)
        scales.append(departure.scale)
    assert scales[0] < 1e-5 and scales == sorted(scales) and scales[0] < scales[1] < scales[2] and scales[3] == 1.0


def test_three_lines_tell_nothing():
    departure, lines = Departure(), LINES.select([0, 2, 4])
    for offset in (0.1, 0.5):
        pose = TARGET.integrate(displaced(BESIDE, offset), 1.0)
        image = seen_by(pose, lines).image_lines.ravel()
        seen = ImageMismatch(lines.transformed(TARGET.inverse(), "camera"), image, np.zeros(6))
        assert departure.update(seen, OWN[:3], LASTING[:3], covariance(), np.zeros(6)) == 0.0


def test_what_cannot_be_computed_with_teaches_nothing():
    departure, error = Departure(), displaced(BESIDE, 0.3)
    assert frame(departure, displaced(BESIDE, 0.1), error) == 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        assert frame(departure, displaced(BESIDE, 0.5), error, errors_of_image=1e200) == 0.0
    assert frame(departure, displaced(BESIDE, 0.1), error) == 0.0
    assert frame(departure, displaced(BESIDE, 0.5), error) > 0.0
