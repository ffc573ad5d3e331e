import pytest

from plsing_ros.servoing.levels import Indicator, Level, worst


def levels_of(values, hysteresis=1.2):
    level, result = Level.OK, []
    for value in values:
        level, _, _ = worst([Indicator(value, 1.0, 0.1, "x")], hysteresis, [level])
        result.append(level)
    return result


def test_levels_follow_the_thresholds():
    assert levels_of([2.0, 0.99, 0.5, 0.09, 0.5, 2.0], 1.0) == [
        Level.OK,
        Level.WARN,
        Level.WARN,
        Level.CRITICAL,
        Level.WARN,
        Level.OK,
    ]


def test_a_value_that_trembles_at_a_threshold_changes_the_level_once():
    assert levels_of([1.01, 0.99, 1.01, 0.99, 1.19, 1.21]) == [Level.OK, *[Level.WARN] * 4, Level.OK]
    assert levels_of([0.11, 0.09, 0.11, 0.119, 0.121]) == [
        Level.WARN,
        Level.CRITICAL,
        Level.CRITICAL,
        Level.CRITICAL,
        Level.WARN,
    ]


def test_the_worst_of_several_decides_and_gives_the_reason():
    good, bad = Indicator(5.0, 1.0, 0.1, "a"), Indicator(0.05, 1.0, 0.1, "b 0.05", " m")
    level, reason, each = worst([good, bad], 1.2, [Level.OK, Level.OK])
    assert (level, each) == (Level.CRITICAL, [Level.OK, Level.CRITICAL])
    assert reason == "b 0.05 is below 0.1 m"


def test_all_reasons_of_the_worst_level_are_given():
    level, reason, _ = worst([Indicator(0.5, 1.0, 0.1, "a"), Indicator(0.6, 1.0, 0.1, "b")], 1.2, [Level.OK] * 2)
    assert level is Level.WARN and reason == "a is below 1; b is below 1"


def test_a_held_level_says_that_it_is_held():
    _, reason, _ = worst([Indicator(1.1, 1.0, 0.1, "a")], 1.2, [Level.WARN])
    assert reason == "a is not yet 1.2 times better than 1"


@pytest.mark.parametrize("value", [0.0, 1e-300, 1.0])
def test_a_threshold_of_zero_is_off(value):
    assert worst([Indicator(value, 0.0, 0.0, "a")], 1.2, [Level.OK])[0] is Level.OK


def test_nothing_to_judge_is_ok():
    assert worst([], 1.2, []) == (Level.OK, "", [])
