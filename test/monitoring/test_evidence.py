# SPDX-License-Identifier: Apache-2.0
"""Probabilities from counts and sizes from samples: of what is constant, steadier than one count, quick to change."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from strategies import numbers

from plsing_ros.monitoring.evidence import Evidence, Sizes


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


@given(st.lists(numbers(0.0, 10.0), min_size=1, max_size=9), st.integers(1, 9))
def test_of_one_answer_the_size_is_the_one_that_so_many_samples_reach(samples, reaching):
    reaching = min(reaching, len(samples))
    size = Sizes().add(np.array(samples), 0.5, reaching / len(samples))
    assert size == sorted(samples, reverse=True)[reaching - 1]


@given(st.integers(1, 20), numbers(0.0, 1.0))
def test_sizes_of_before_count_as_much_as_is_kept_of_them(answers, kept):
    sizes = Sizes()
    for _ in range(answers):
        sizes.add(np.full(8, 3.0), kept, 0.25)
    # Samples of before are three in four of all, or fewer: then the size is that of now.
    before = sum(weight for weight in kept ** np.arange(1, answers + 1) if weight >= 0.05)
    if abs(before / (before + 1.0) - 0.25) > 1e-3:
        assert sizes.add(np.full(8, 1.0), kept, 0.25) == (3.0 if before / (before + 1.0) > 0.25 else 1.0)
