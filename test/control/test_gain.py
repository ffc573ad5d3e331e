# SPDX-License-Identifier: Apache-2.0
"""The adaptive gain: its value and slope at zero, its limit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plsing_ros.control.gain import adaptive_gain

gains = st.tuples(st.floats(0.01, 1.0), st.floats(1.5, 100.0), st.floats(0.1, 100.0))


@given(gains)
def test_value_and_slope_at_zero_and_the_limit(drawn):
    at_infinity, ratio, slope = drawn
    at_zero = ratio * at_infinity
    assert adaptive_gain(0.0, at_zero, at_infinity, slope) == pytest.approx(at_zero)
    h = 1e-4 * (at_zero - at_infinity) / slope
    # Central difference: the formula goes on smoothly to negative errors.
    feature_error = adaptive_gain(h, at_zero, at_infinity, slope) - adaptive_gain(-h, at_zero, at_infinity, slope)
    assert feature_error / (2.0 * h) == pytest.approx(-slope, rel=1e-6)
    assert adaptive_gain(1e6 * ratio, at_zero, at_infinity, slope) == pytest.approx(at_infinity)


@given(gains, st.floats(0.0, 10.0), st.floats(0.0, 10.0))
def test_a_larger_error_has_no_larger_gain(drawn, error, more):
    at_infinity, ratio, slope = drawn
    at_zero = ratio * at_infinity
    gain = adaptive_gain(error, at_zero, at_infinity, slope)
    assert at_infinity <= adaptive_gain(error + more, at_zero, at_infinity, slope) <= gain <= at_zero * (1.0 + 1e-12)


def test_without_a_slope_it_is_constant():
    assert adaptive_gain(1e9, 0.3, 0.7, 0.0) == 0.3
