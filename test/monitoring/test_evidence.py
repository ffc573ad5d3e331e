# SPDX-License-Identifier: Apache-2.0
"""A probability from counts: calibrated for a constant share, steadier than one count, and quick to follow a change."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from strategies import numbers

from plsing_ros.monitoring.evidence import Evidence


@given(st.lists(st.tuples(st.integers(0, 8), st.just(8)), min_size=1, max_size=30), numbers(0.0, 0.99))
def test_it_is_a_probability_and_never_sure(counts, kept):
    evidence = Evidence()
    for harmed, samples in counts:
        assert 0.0 < evidence.add(harmed, samples, kept) < 1.0


def test_of_a_constant_share_it_says_that_share_with_less_spread_than_one_count():
    generator = np.random.default_rng(4)
    for share in (0.1, 0.5, 0.8):
        said = []
        for _ in range(300):
            evidence = Evidence()
            for harmed in generator.binomial(8, share, size=20):
                last = evidence.add(int(harmed), 8, 0.8)
            said.append(last)
        assert abs(np.mean(said) - share) < 0.04
        assert np.std(said) < 0.6 * np.sqrt(share * (1.0 - share) / 8)


def test_a_count_that_contradicts_begins_anew():
    evidence = Evidence()
    for _ in range(50):
        calm = evidence.add(0, 8, 0.8)
    assert calm < 0.02
    assert evidence.add(8, 8, 0.8) > 0.9
