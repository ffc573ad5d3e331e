# SPDX-License-Identifier: Apache-2.0
"""The guard's scale: never blocked, never a jump, and nothing for a healthy task."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import vectors

from plsing_ros.control.guard import guarded_scale

MARGIN, FLOOR = 0.15, 0.2
moving = vectors(3, -1.0, 1.0).filter(lambda v: np.linalg.norm(v) > 1e-3)
places = st.lists(vectors(3, -0.3, 0.3), min_size=1, max_size=4).map(np.array)


def scale(offsets, velocity, health=0.0):
    return guarded_scale(np.atleast_2d(offsets), np.asarray(velocity, dtype=float), health, MARGIN, FLOOR)


@given(offsets=places, velocity=moving, health=st.floats(0.0, 2.0))
def test_it_is_between_the_floor_and_one(offsets, velocity, health):
    assert FLOOR - 1e-12 <= scale(offsets, velocity, health) <= 1.0
    if health >= 1.0:
        assert scale(offsets, velocity, health) == 1.0


@given(offset=moving, distance=st.floats(0.05, 1.0))
def test_leaving_is_free_and_approaching_is_slowed_down(offset, distance):
    toward = offset / np.linalg.norm(offset)
    assert scale(distance * toward, -toward) > 0.99
    if distance < 0.9 * MARGIN:
        assert scale(distance * toward, toward) < 0.98
    if distance > MARGIN:
        assert scale(distance * toward, toward) == 1.0


@given(offsets=places, velocity=moving, step=vectors(3, -1.0, 1.0), turn=vectors(3, -1.0, 1.0))
def test_small_changes_of_place_or_motion_change_it_little(offsets, velocity, step, turn):
    """Also on a locus, and where approaching turns into leaving; the steepest slope is that of the core, 7 / margin."""
    h = 1e-6
    before = scale(offsets, velocity)
    assert abs(scale(offsets + h * step, velocity) - before) <= 2.0 * h * 100.0 / MARGIN
    turned = velocity + h * np.linalg.norm(velocity) * turn
    assert abs(scale(offsets, turned) - before) <= 10.0 * h


def test_through_a_locus_without_a_jump():
    places = np.linspace(-0.02, 0.02, 2001)  # every fiftieth of a millimetre
    values = np.array([scale([-x, 0.0, 0.0], [1.0, 0.0, 0.0]) for x in places])
    assert np.abs(np.diff(values)).max() < 0.01
    assert values.min() < FLOOR + 0.1
    assert values[-1] > 0.99


def test_without_a_place_the_conditioning_alone_counts():
    assert guarded_scale(None, np.ones(3), 0.0, MARGIN, FLOOR) == pytest.approx(FLOOR)
    assert guarded_scale(None, np.ones(3), 1.0, MARGIN, FLOOR) == 1.0
    assert guarded_scale(np.zeros((0, 3)), np.ones(3), 0.0, MARGIN, FLOOR) == 1.0


def test_at_rest_it_is_a_number():
    assert FLOOR <= scale([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]) <= 1.0
