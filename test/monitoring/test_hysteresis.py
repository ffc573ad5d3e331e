# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from messages import mentions

from plsing_ros.levels import Level
from plsing_ros.monitoring.alarm_state import AlarmState, reasons
from plsing_ros.monitoring.hysteresis import Debounce, Hysteresis, Thresholds, threshold_text
from plsing_ros.monitoring.indicators import Indicator

THRESHOLDS = Thresholds(warn=1.0, critical=0.1, warn_exit=1.2, critical_exit=0.12)
OK, WARN, CRITICAL = Level.OK, Level.WARN, Level.CRITICAL


def levels_of(values, debounce=Debounce(), thresholds=THRESHOLDS):  # noqa: B008
    latch = Hysteresis()
    return [latch.update(value, thresholds, debounce) for value in values]


def test_levels_follow_the_thresholds():
    assert levels_of([2.0, 0.99, 0.5, 0.09, 0.5, 2.0]) == [OK, WARN, WARN, CRITICAL, WARN, OK]


def test_enter_and_exit_are_apart():
    assert levels_of([1.01, 0.99, 1.01, 0.99, 1.19, 1.21]) == [OK, *[WARN] * 4, OK]
    assert levels_of([0.11, 0.09, 0.11, 0.119, 0.121]) == [WARN, *[CRITICAL] * 3, WARN]


def test_an_exit_of_zero_is_a_fifth_above_the_entry():
    assert levels_of([0.9, 1.19, 1.21], thresholds=Thresholds(1.0, 0.1)) == [WARN, WARN, OK]


def test_a_change_must_last():
    slow = Debounce(to_raise=3, to_lower=2)
    assert levels_of([2, 0.5, 0.5, 2, 0.5, 0.5, 0.5], slow) == [*[OK] * 6, WARN]
    assert levels_of([0.5, 2, 0.5, 2, 2], slow) == [*[WARN] * 4, OK]
    assert levels_of([2, 0.05, 0.05, 0.05, 2, 0.5], slow) == [OK, OK, OK, CRITICAL, CRITICAL, WARN]
    # A single good number does not decide how far down to go.
    assert levels_of([0.05, 0.5, 2], slow) == [CRITICAL, CRITICAL, WARN]


def test_the_first_number_counts_at_once():
    assert levels_of([0.05], Debounce(100, 100)) == [CRITICAL]


@pytest.mark.parametrize("value", [0.0, 1e-300, 1.0])
def test_a_threshold_of_zero_is_off(value):
    assert levels_of([2.0, value], thresholds=Thresholds(0.0, 0.0)) == [OK, OK]


@pytest.mark.parametrize("value", [0.05, 0.5, 2.0])
@pytest.mark.parametrize("then", [Thresholds(0.0, 0.0), Thresholds(1.0, 0.0)], ids=["both", "critical"])
def test_a_level_that_is_switched_off_while_it_is_in_force_ends_at_once(value, then):
    latch, slow = Hysteresis(), Debounce(100, 100)
    assert latch.update(0.05, THRESHOLDS, slow) is CRITICAL
    level = latch.update(value, then, slow)
    assert level is then.entered(value) and latch.calm is (level is OK)


@pytest.mark.parametrize("thresholds", [Thresholds(1.0, 0.0), Thresholds(0.0, 1.0)], ids=["warn", "critical"])
@pytest.mark.parametrize("spread", [1e-3, 0.1, 0.5])
@pytest.mark.parametrize("seed", range(5))
def test_noise_at_a_threshold_raises_one_alert(thresholds, spread, seed):
    """A number that hovers at a threshold: the level goes up at most once and does not come down again."""
    values = np.abs(1.0 + spread * np.random.default_rng(seed).normal(size=5000))
    levels = levels_of([10.0, *values], Debounce(2, 25), thresholds)
    assert np.count_nonzero(np.diff(levels)) <= 1


@given(values=st.lists(st.floats(0.0, 10.0), min_size=1, max_size=60), up=st.integers(1, 5), down=st.integers(1, 5))
def test_a_level_never_changes_without_as_many_reasons_in_a_row(values, up, down):
    levels = levels_of(values, Debounce(up, down))
    for i in range(1, len(levels)):
        if levels[i] > levels[i - 1]:
            recent = [THRESHOLDS.entered(each) for each in values[max(0, i - up + 1) : i + 1]]
            assert len(recent) == up and min(recent) > levels[i - 1]
        if levels[i] < levels[i - 1]:
            recent = values[max(0, i - down + 1) : i + 1]
            assert len(recent) == down and min(recent) >= (0.12 if levels[i - 1] is CRITICAL else 1.2)


def test_the_reason_says_how_a_level_is_held():
    below, held, waits = (
        threshold_text(value, THRESHOLDS, level, " m") for value, level in ((0.05, CRITICAL), (1.1, WARN), (5.0, WARN))
    )
    assert "below 0.1 m" in below and "above 1.2 m" in held and "above 1.2 m" in waits
    # One has not come back yet, one has and waits.
    assert held != waits


def test_an_alert_whose_number_is_lost_ends_by_its_debounce():
    state = AlarmState(Debounce(to_raise=1, to_lower=3))
    risk = Indicator("risk", 1.0, Thresholds(2.0, 0.0), lambda: "probability of harm 1")
    other = Indicator("z", 9.0, Thresholds(3.0, 0.0), lambda: "z 9")
    assert state.levels(state.with_missing([risk, other])) == [Level.WARN, Level.OK]
    for expected in (Level.WARN, Level.WARN, Level.OK):
        indicators = state.with_missing([other])
        levels = state.levels(indicators)
        assert max(levels) is expected
        assert mentions(reasons(indicators, levels, "", "calm"), "risk") is (expected is Level.WARN)
    assert state.with_missing([other]) == [other]
