import pytest

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
    assert fresh.silence(NOW).startswith("no usable features received yet; the latest were refused: ")


def test_a_stamp_that_goes_back_is_refused_but_a_repeated_one_is_not(fresh):
    assert fresh.refusal(NOW, NOW) is None
    assert fresh.refusal(NOW, NOW) is None
    assert "out of order: stamped 0.05 s before" in fresh.refusal(NOW - SECOND // 20, NOW)


def test_silence_grows_with_the_clock_and_ends_with_a_message(fresh):
    assert fresh.silence(NOW) == "no features received yet"
    fresh.refusal(NOW, NOW)
    assert fresh.silence(NOW + SECOND // 10) is None
    assert fresh.silence(NOW + SECOND) == "no features for 1 s, allowed are 0.2 s"
    assert fresh.refusal(NOW + SECOND, NOW + SECOND) is None
    assert fresh.silence(NOW + SECOND) is None


def test_a_clock_that_jumps_back_starts_anew(fresh):
    fresh.refusal(NOW, NOW)
    earlier = NOW - 100 * SECOND
    assert fresh.refusal(earlier, earlier) is None
    fresh.refusal(NOW, NOW)
    assert fresh.silence(earlier) == "no features received yet"


def test_a_clock_that_goes_back_by_less_than_the_tolerance_has_not_jumped(fresh):
    fresh.refusal(NOW, NOW)
    assert not fresh.follow_clock(NOW - 9 * SECOND // 100)
    assert fresh.last_stamp == NOW
    assert fresh.follow_clock(NOW - 2 * SECOND // 10)
    assert fresh.last_stamp is None
