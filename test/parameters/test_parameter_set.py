# SPDX-License-Identifier: Apache-2.0
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plsing_ros.errors import ParameterError
from plsing_ros.parameters import ParameterSet
from plsing_ros.parameters.parameter_set import parameter


@dataclass(frozen=True)
class Example(ParameterSet):
    low: float = parameter(1.0, "range.low", "The low end", unit="m", minimum=0.0, maximum=10.0)
    high: float = parameter(2.0, "range.high", "The high end", unit="m", minimum=0.0)
    count: int = parameter(3, "count", "A count", minimum=1, maximum=5)
    on: bool = parameter(False, "on", "A switch")
    mode: str = parameter("a", "mode", "A word", choices=("a", "b"))
    row: tuple[float, ...] = parameter((1.0,), "row", "Numbers", maximum=9.0)
    std: tuple[float, ...] = parameter((1.0,), "std", "One number or more", maximum=9.0, one_for_all=True)

    def check(self):
        if self.low > self.high:
            raise ParameterError("range.low is above range.high")


def test_values_go_by_their_ros_names():
    changed = Example.from_values({"range.low": 0, "count": 5, "on": True, "mode": "b", "row": [1, 2.5]})
    assert changed == Example(0.0, 2.0, 5, True, "b", (1.0, 2.5))
    assert Example.from_values({"std": 2}).std == Example.from_values({"std": [2.0]}).std == (2.0,)
    assert isinstance(changed.low, float) and changed.values()["range.low"] == 0.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"range.lwo": 1.0}, "unknown parameter 'range.lwo'; did you mean 'range.low'"),
        ({"zzz": 1.0}, "unknown parameter 'zzz'; known are: range.low, range.high, count, on, mode, row"),
        ({"range.low": 11}, "parameter 'range.low' is 11 m; allowed: 0 to 10 m"),
        ({"range.high": -1.0}, "allowed: at least 0 m"),
        ({"range.low": float("inf")}, "must be finite"),
        ({"range.low": None}, "must be a number m"),
        ({"range.low": [1.0]}, "must be a number m"),
        ({"count": 2.0}, "must be a whole number"),
        ({"count": True}, "must be a whole number"),
        ({"on": 1}, "must be true or false"),
        ({"mode": "c"}, "parameter 'mode' is 'c'; allowed: one of a, b"),
        ({"row": [1.0, 10.0]}, r"parameter 'row\[1\]' is 10.0; allowed: at most 9"),
        ({"row": [1.0, float("nan")]}, r"parameter 'row\[1\]' is nan; it must be finite"),
        ({"row": "abc"}, "must be an array of float"),
        ({"row": 5.0}, "must be an array of float"),
        ({"std": True}, r"parameter 'std\[0\]' is True; it must be a number"),
        ({"std": 10.0}, r"parameter 'std\[0\]' is 10.0; allowed: at most 9"),
        ({"range.low": 3.0}, "range.low is above range.high"),
    ],
)
def test_what_is_not_allowed_is_refused_by_name(values, message):
    with pytest.raises(ParameterError, match=message):
        Example.from_values(values)
    with pytest.raises(ParameterError, match=message):
        Example().with_values(values)


def test_rules_between_values_look_at_the_whole():
    assert Example().with_values({"range.low": 5.0, "range.high": 6.0}).low == 5.0


scalars = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(), st.binary())


@given(values=st.dictionaries(st.sampled_from(list(Example.specifications())), scalars | st.lists(scalars)))
def test_any_value_is_either_valid_or_a_parameter_error(values):
    try:
        made = Example.from_values(values)
    except ParameterError:
        return
    assert 0.0 <= made.low <= 10.0 and 1 <= made.count <= 5 and made.mode in ("a", "b")
