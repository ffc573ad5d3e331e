# SPDX-License-Identifier: Apache-2.0
"""Speed limits that keep the screw."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import numbers, vectors

from plsing_ros.control.saturation import saturate

limits = st.floats(1e-3, 1e3) | st.just(math.inf)


@given(twist=vectors(6, -1e6, 1e6), size=st.sampled_from([1.0, 1e-6, 1e150, 1e300]), linear=limits, angular=limits)
def test_limits_hold_and_the_direction_stays(twist, size, linear, angular):
    result, factor = saturate(twist * size, linear, angular)
    assert 0.0 < factor <= 1.0
    assert math.hypot(*result[:3]) <= linear * (1.0 + 1e-12)
    assert math.hypot(*result[3:]) <= angular * (1.0 + 1e-12)
    np.testing.assert_allclose(result, twist * size * factor, rtol=1e-12)


@given(
    axis=vectors(3, -1.0, 1.0).filter(lambda v: np.linalg.norm(v) > 1e-3),
    point=vectors(3, -5.0, 5.0),
    pitch=numbers(-2.0, 2.0),
)
def test_axis_and_pitch_of_the_screw_are_kept(axis, point, pitch):
    """Two factors, one for each part, would move the axis: v = point x omega + pitch omega would no longer hold."""
    omega = 10.0 * axis
    result, _ = saturate(np.concatenate([np.cross(point, omega) + pitch * omega, omega]), 0.1, 0.2)
    np.testing.assert_allclose(result[:3], np.cross(point, result[3:]) + pitch * result[3:], atol=1e-12)


def test_below_the_limits_nothing_changes():
    twist = np.array([0.1, 0.0, 0.0, 0.0, 0.2, 0.0])
    assert saturate(twist, 0.1, 0.2) == (pytest.approx(twist), 1.0)
