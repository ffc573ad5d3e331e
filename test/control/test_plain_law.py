# SPDX-License-Identifier: Apache-2.0
"""The law in one call against the law with all its options."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import seen_lines, vectors

from plsing_ros.control.compute_twist import compute_twist
from plsing_ros.control.plain_law import compute_plain_twist
from plsing_ros.features import feature_error, interaction_matrix
from plsing_ros.features.target import TargetView
from plsing_ros.geometry import LineSet
from plsing_ros.parameters import ControllerParameters


def parameters(**values):
    return ControllerParameters(target_source="topic", **values)


any_task = given(
    lines=seen_lines(min_size=1),
    numbers=vectors(24, -1.0, 1.0),
    gain=st.sampled_from([0.1, 1000.0]),
    threshold=st.sampled_from([1e-12, 1e-2]),
)


def rounding_of_twist(values, threshold, speed):
    """Return how far rounding may take a twist; not where it may put a singular value on the threshold's other side."""
    ratio = values / values[0]
    assume(not ((ratio > 1e-14) & (ratio < 1e-4)).any() and (np.abs(ratio - threshold) > 1e-13).all())
    return 1e-14 * speed * values[0] / values[ratio > threshold].min() ** 2


@any_task
def test_it_is_the_law_with_all_its_options_when_none_is_in_use(lines, numbers, gain, threshold):
    chosen = parameters(gain=gain, pinv_threshold=threshold)
    assert chosen.is_plain
    image, target = np.resize(numbers, (2, 3 * len(lines)))
    error, norm = feature_error(image, target)
    expected = compute_twist(chosen, interaction_matrix(lines), image, error, None, TargetView(target, None, None))
    allowed = rounding_of_twist(expected.values, threshold, gain * norm)
    found, error_norm = compute_plain_twist(chosen, lines, image, target)
    np.testing.assert_allclose(found.twist, expected.twist, rtol=0.0, atol=allowed)
    np.testing.assert_allclose(found.values, expected.values, rtol=0.0, atol=1e-14 * expected.values[0])
    assert (found.gain, found.damping, found.health) == (expected.gain, expected.damping, expected.health)
    assert found.speed == pytest.approx(np.linalg.norm(found.twist), rel=1e-14)
    assert error_norm == norm


@any_task
def test_it_is_least_squares_by_another_library(lines, numbers, gain, threshold):
    image, target = np.resize(numbers, (2, 3 * len(lines)))
    L = interaction_matrix(lines)
    allowed = rounding_of_twist(np.linalg.svd(L, compute_uv=False), threshold, gain * np.linalg.norm(image - target))
    expected = -gain * np.linalg.lstsq(L, image - target, rcond=threshold)[0]
    found, error_norm = compute_plain_twist(parameters(gain=gain, pinv_threshold=threshold), lines, image, target)
    np.testing.assert_allclose(found.twist, expected, rtol=0.0, atol=allowed)
    assert error_norm == pytest.approx(np.linalg.norm(image - target), rel=1e-14)


@pytest.mark.parametrize(
    "option",
    [
        {"law": "guarded"},
        {"interaction": "mean"},
        {"gain_slope": 1.0},
        {"integral_gain": 1.0},
        {"degrees_of_freedom": (1, 1, 1, 1, 1, 0)},
        {"secondary_twist": (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)},
    ],
    ids=lambda option: next(iter(option)),
)
def test_with_an_option_it_is_not_the_plain_law(option):
    assert not parameters(**option).is_plain


def test_there_is_no_twist_for_a_line_without_an_image():
    points, directions = [[1, 0, 2], [0, 1, 2], [0, 0, 2]], [[0, 1, 0], [1, 0, 1], [0, 0, 1]]
    lines = LineSet.from_points_directions(points, directions, ids=(4, 5, 6))
    assert compute_plain_twist(parameters(), lines, np.ones(9), np.ones(9)) is None
