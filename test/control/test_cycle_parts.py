# SPDX-License-Identifier: Apache-2.0
"""What a cycle remembers: integral, stall, zero twists, the gate; and the tool's twist, and the mean of two L."""

import numpy as np
import pytest
from hypothesis import assume, given
from messages import mentions
from strategies import poses, seen_lines, twists, vectors

from plsing_ros.control.command import Command, Mode
from plsing_ros.control.gate import StatusGate
from plsing_ros.control.halt_messages import HaltMessages
from plsing_ros.control.integral import ErrorIntegral
from plsing_ros.control.stall import StallWatch
from plsing_ros.control.tool import tool_twist
from plsing_ros.features import interaction_matrix, project_lines
from plsing_ros.features.mean_interaction import mean_interaction
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.levels import Level

SECOND = 10**9
IDS = (1, 2, 3)


def fed(integral, values, step=0.1, held_back=False, ids=IDS, first=1.0, limit=10.0, gain=2.0):
    result = None
    for k, value in enumerate(values):
        stamp = round((first + k * step) * SECOND)
        result = integral.update(np.full(9, value), ids, stamp, gain, limit, held_back)
    return result


def test_the_integral_adds_up_over_the_stamps():
    # The first error has no interval before it: two of 0.1 s count.
    np.testing.assert_allclose(fed(ErrorIntegral(), [9.0, 1.0, 2.0]), 2.0 * 0.1 * 3.0)


def test_the_integral_does_not_wind_up():
    integral = ErrorIntegral()
    before = fed(integral, [1.0, 1.0])
    np.testing.assert_array_equal(fed(integral, [1.0] * 5, first=1.2, held_back=True), before)
    assert np.linalg.norm(fed(integral, [100.0] * 50, first=1.7, limit=0.3)) == pytest.approx(0.3)


def test_the_integral_starts_anew_for_other_lines_and_after_a_gap():
    integral = ErrorIntegral()
    fed(integral, [1.0] * 5)
    np.testing.assert_array_equal(fed(integral, [1.0], first=1.5, ids=(1, 2, 4)), 0.0)
    fed(integral, [1.0] * 5, first=1.6, ids=(1, 2, 4))
    np.testing.assert_array_equal(fed(integral, [1.0], first=5.0, ids=(1, 2, 4)), 0.0)


def test_the_same_frame_sent_again_adds_nothing():
    integral = ErrorIntegral()
    before = fed(integral, [1.0, 1.0])
    np.testing.assert_array_equal(fed(integral, [1.0], first=1.1), before)


def test_a_stall_lasts_as_long_as_nothing_moves():
    watch = StallWatch()

    def at(seconds, ratio, error):
        return watch.stalled_for(ratio, error, 1e-3, 0.05, round(seconds * SECOND))

    assert at(1.0, 1e-4, 0.2) == 0.0
    assert at(3.0, 1e-4, 0.2) == 2.0
    assert at(3.1, 1.0, 0.2) is None  # it moves
    assert at(3.2, 1e-4, 0.2) == 0.0
    assert at(4.0, 1e-4, 0.04) is None  # it is nearly there
    assert at(4.1, 1e-4, 0.2) == 0.0
    assert at(1.0, 1e-4, 0.2) == 0.0  # the clock jumped back


def test_zero_twists_then_silence():
    counter = HaltMessages()
    halted, servoing = Command(Mode.HALTED), Command(Mode.SERVOING)
    assert [counter.to_be_published(halted, 2) for _ in range(4)] == [True, True, False, False]
    assert counter.to_be_published(servoing, 2)
    assert [counter.to_be_published(halted, 2) for _ in range(3)] == [True, True, False]
    assert all(counter.to_be_published(halted, -1) for _ in range(100))
    assert not counter.to_be_published(Command(Mode.WAITING), -1)


def test_the_gate_opens_for_a_recent_status_of_an_allowed_level():
    gate = StatusGate(Level.WARN, 0.5, 0.1)
    assert mentions(gate.closed(SECOND), "singularity statuses")
    gate.receive(int(Level.WARN), "near", SECOND, SECOND)
    assert gate.closed(SECOND) is None
    assert mentions(gate.closed(SECOND * 16 // 10), "singularity statuses", "0.6 s")
    for level in (Level.CRITICAL, Level.STALE, Level.UNOBSERVABLE, Level.DISABLED):
        gate.receive(int(level), "because", 2 * SECOND, 2 * SECOND)
        assert mentions(gate.closed(2 * SECOND), level.name, "WARN", "because")
    gate.receive(0, "", 3 * SECOND, 3 * SECOND)
    assert gate.closed(3 * SECOND) is None
    gate.receive(99, "", 3 * SECOND, 3 * SECOND)  # no level at all
    assert gate.closed(3 * SECOND) is None
    gate.receive(int(Level.CRITICAL), "", SECOND, 3 * SECOND)  # old news
    assert gate.closed(3 * SECOND) is None
    assert gate.closed(3 * SECOND) is None


@given(T_world_camera=poses(), T_tool_camera=poses(), twist=twists())
def test_the_tool_moves_as_the_camera_that_is_fixed_to_it(T_world_camera, T_tool_camera, twist):
    """Central differences of the tool's pose while the camera moves."""
    h = 1e-5
    before, after = (T_world_camera.integrate(twist, sign * h) @ T_tool_camera.inverse() for sign in (-1.0, 1.0))
    rotation = (T_world_camera @ T_tool_camera.inverse()).rotation
    v = rotation.T @ (after.translation - before.translation) / (2.0 * h)
    spin = rotation.T @ (after.rotation - before.rotation) / (2.0 * h)
    omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
    np.testing.assert_allclose(tool_twist(T_tool_camera, twist), np.concatenate([v, omega]), atol=2e-5)


@given(lines=seen_lines(min_size=3, max_size=5), start=poses())
def test_the_mean_is_that_of_offsets_and_angles(lines, start):
    """Against L of (r, a) for each image line, r its third number and a the angle of the first two."""

    def polar(seen):
        image, L = project_lines(seen).reshape(-1, 3), interaction_matrix(seen).reshape(-1, 3, 6)
        a = np.arctan2(image[:, 1], image[:, 0])[:, np.newaxis]
        return a, np.stack([L[:, 2], np.cos(a) * L[:, 1] - np.sin(a) * L[:, 0]], axis=1)

    other = lines.transformed(start.integrate([0.1, 0.05, -0.1, 0.3, 0.2, -0.4], 1.0).inverse() @ start, "camera")
    (a, one), (_, two) = polar(lines), polar(other)
    mean = mean_interaction(
        interaction_matrix(lines), project_lines(lines), interaction_matrix(other), project_lines(other)
    ).reshape(-1, 3, 6)
    expected = 0.5 * (one + two)
    scale = 1.0 + np.abs(expected).max()
    np.testing.assert_allclose(mean[:, 2], expected[:, 0], atol=1e-9 * scale)
    np.testing.assert_allclose(np.cos(a) * mean[:, 1] - np.sin(a) * mean[:, 0], expected[:, 1], atol=1e-9 * scale)
    np.testing.assert_allclose(np.cos(a) * mean[:, 0] + np.sin(a) * mean[:, 1], 0.0, atol=1e-9 * scale)


def unexplained(lines, twist, matrix_of):
    """The largest part of s - s* along which an image line can move that a matrix times the motion does not explain."""
    here = lines.transformed(Pose(np.eye(3), np.zeros(3)).integrate(twist, 1.0).inverse(), "camera")
    rest = project_lines(here) - project_lines(lines) - matrix_of(here, lines) @ twist
    (x, y, _), rows = project_lines(here).reshape(-1, 3).T, rest.reshape(-1, 3)
    return np.hypot(x * rows[:, 1] - y * rows[:, 0], rows[:, 2]).max()


def mean_of(here, target):
    return mean_interaction(
        interaction_matrix(here), project_lines(here), interaction_matrix(target), project_lines(target)
    )


@given(lines=seen_lines(min_size=4, max_size=6), twist=vectors(6, -1.0, 1.0))
def test_the_mean_explains_the_error_to_second_order(lines, twist):
    """Half the motion leaves an eighth, or less, of what the mean of L and L* does not explain."""
    whole, half = (unexplained(lines, size * twist, mean_of) for size in (4e-3, 2e-3))
    assume(whole > 1e-10)  # else it is rounding
    assert whole / half > 6.8


def test_the_current_matrix_explains_it_to_first_order_only():
    lines = LineSet.from_points_directions(
        [[-1.0, 0, 4], [1.0, 0, 5], [0, -1.0, 4], [0, 1.0, 5]],
        [[0.2, 1, 0.1], [0, 1, 0.3], [1, 0.2, 0.2], [1, -0.3, 0]],
    )
    twist = np.array([0.3, -0.2, 0.4, 0.2, 0.1, -0.3])
    whole, half = (unexplained(lines, size * twist, lambda here, _: interaction_matrix(here)) for size in (4e-3, 2e-3))
    assert whole / half == pytest.approx(4.0, rel=0.05)
