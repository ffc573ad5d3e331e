# SPDX-License-Identifier: Apache-2.0
import pytest
from messages import mentions

from plsing_ros.stamp_filter import StampFilter

SECOND = 1_000_000_000
NOW = 1000 * SECOND


@pytest.fixture
def fresh():
    return StampFilter("features", timeout=0.2, future_tolerance=0.1)


@pytest.mark.parametrize("age", [0.0, 0.19, -0.09])
def test_recent_stamps_are_accepted(fresh, age):
    assert fresh.refusal(NOW - int(age * SECOND), NOW) is None
    assert fresh.silence(NOW) is None


@pytest.mark.parametrize(
    ("stamp", "words"),
    [
        (0, "no stamp"),
        (-1, "stamped at -1e-09 s, before time zero"),
        (NOW - SECOND, "1 s old, allowed are 0.2 s"),
        (NOW + SECOND, "1 s ahead of the clock, allowed are 0.1 s"),
        (SECOND, "is use_sim_time set"),
        (NOW + 500 * SECOND, "is use_sim_time set"),
    ],
)
def test_others_are_refused_and_leave_no_trace(fresh, stamp, words):
    assert words in fresh.refusal(stamp, NOW)
    assert fresh.last_stamp is None
    assert "features" in fresh.silence(NOW) and "refused" in fresh.silence(NOW)


def test_a_stamp_that_goes_back_is_refused_but_a_repeated_one_is_not(fresh):
    assert fresh.refusal(NOW, NOW) is None
    assert fresh.refusal(NOW, NOW) is None
    assert mentions(fresh.refusal(NOW - SECOND // 20, NOW), "out of order", "0.05 s")


def test_silence_grows_with_the_clock_and_ends_with_a_message(fresh):
    assert "features" in fresh.silence(NOW)
    fresh.refusal(NOW, NOW)
    assert fresh.silence(NOW + SECOND // 10) is None
    assert all(each in fresh.silence(NOW + SECOND) for each in ("features", "1 s", "0.2 s"))
    assert fresh.refusal(NOW + SECOND, NOW + SECOND) is None
    assert fresh.silence(NOW + SECOND) is None


def test_a_clock_that_jumps_back_starts_anew(fresh):
    fresh.refusal(NOW, NOW)
    earlier = NOW - 100 * SECOND
    assert fresh.refusal(earlier, earlier) is None
    fresh.refusal(NOW, NOW)
    assert mentions(fresh.silence(earlier), "features")


def test_a_clock_that_goes_back_by_less_than_the_tolerance_has_not_jumped(fresh):
    fresh.refusal(NOW, NOW)
    assert not fresh.follow_clock(NOW - 9 * SECOND // 100)
    assert fresh.last_stamp == NOW
    assert fresh.follow_clock(NOW - 2 * SECOND // 10)
    assert fresh.last_stamp is None


def test_a_frame_from_the_near_future_does_not_block_those_before_it(fresh):
    assert fresh.refusal(NOW + 9 * SECOND // 100, NOW) is None
    assert fresh.refusal(NOW + 3 * SECOND // 100, NOW + 3 * SECOND // 100) is None


@pytest.mark.parametrize("offset", [-SECOND, SECOND, -(SECOND // 20)])
def test_one_stray_frame_among_good_ones_is_told_from_bad_ones_alone(fresh, offset):
    assert not fresh.is_stray(NOW, NOW)
    assert not fresh.is_stray(NOW + SECOND, NOW)  # nothing good has come
    fresh.refusal(NOW, NOW)
    assert fresh.is_stray(NOW + offset, NOW)
    later = NOW + SECOND
    assert not fresh.is_stray(later + 2 * offset, later)  # nothing good for too long
    assert not fresh.is_stray(later, later)


def test_messages_that_come_too_seldom_are_refused_with_both_numbers():
    steady = StampFilter("features", 0.2, 0.1, "features_timeout")
    stamps, answers = [NOW + k * SECOND // 4 for k in range(4)], []
    for stamp in stamps:
        steady.silence(stamp - SECOND // 100)
        answers.append(steady.refusal(stamp, stamp))
    assert answers[0] is None and all(mentions(each, "0.25 s", "features_timeout", "0.2 s") for each in answers[1:])
    assert steady.refusal(stamps[-1] + SECOND // 10, stamps[-1] + SECOND // 10) is None
