# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import numbers

from plsing_ros.monitoring.slope import Slope

MILLISECONDS = 1_000_000


@given(rate=numbers(-10.0, 10.0), start=numbers(), n=st.integers(2, 30))
def test_a_straight_line_has_its_slope(rate, start, n):
    slope = Slope(10)
    results = [slope.add(start + rate * 0.04 * i, 1 + 40 * MILLISECONDS * i) for i in range(n)]
    assert results[0] is None
    assert results[-1][0] == pytest.approx(rate, abs=1e-8)


def test_a_rate_out_of_noise_is_small_and_its_error_right():
    generator = np.random.default_rng(0)
    slope = Slope(10)
    results = [slope.add(generator.normal(), 1 + 40 * MILLISECONDS * i) for i in range(3000)]
    rates, errors = np.array(results[10:]).T
    assert np.std(rates) == pytest.approx(0.11 / 0.04, rel=0.1)
    assert np.mean(np.abs(rates) < 3.0 * errors) > 0.97


def test_a_gap_or_a_stamp_that_is_not_later():
    slope = Slope(10)
    slope.add(1.0, 1)
    assert slope.add(2.0, 1) is None
    assert slope.add(5.0, 1_001 * MILLISECONDS) is None
    assert slope.add(6.0, 2_001 * MILLISECONDS)[0] == pytest.approx(1.0)
