# SPDX-License-Identifier: Apache-2.0
"""The roll-out against the loop itself: what it foresees is what then comes."""

import numpy as np
import pytest
from hypothesis import given
from near_transversal_scene import LOOK, ON_TRANSVERSAL, SCENE, SECOND, START_2, TARGET
from strategies import numbers

from plsing_ros.features import interaction_matrix, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.monitoring.closed_loop_rollout import ClosedLoopRollout, Snapshot

DESIRED = project_lines(SCENE.transformed(TARGET.inverse(), "camera"))


def loop(frames, period=0.04, gain=0.1, start=START_2):
    """Yield stamp, lines and the plain law's twist of each frame."""
    pose = start
    for i in range(frames):
        lines = SCENE.transformed(pose.inverse(), "camera")
        error = project_lines(lines) - DESIRED
        twist = -gain * np.linalg.lstsq(interaction_matrix(lines), error, rcond=None)[0]
        yield SECOND + round(i * period * SECOND), lines, twist
        pose = pose.integrate(twist, period)


def sight(stamp, lines):
    return Snapshot(stamp, project_lines(lines).reshape(-1, 3), np.array([lines.direction, lines.moment]))


def rollouts(frames, horizon=1.0, turn=1.0, **options):
    """Return what is expected at each frame, with the twist of the frame before as on topics, and the loop's speeds."""
    rollout, found, before, speeds = ClosedLoopRollout(), [], None, []
    for stamp, lines, twist in loop(frames, **options):
        if before is None:
            rollout.rest(sight(stamp, lines))
        else:
            found.append(rollout.advance(sight(stamp, lines), DESIRED.reshape(-1, 3), *before, horizon))
        before = turn * twist, stamp
        speeds.append(np.linalg.norm(twist[:3]))
    return found, np.array(speeds)


@pytest.mark.parametrize("period", [0.02, 0.04, 0.08])
@pytest.mark.parametrize("gain", [0.05, 0.08, 0.1])
def test_what_is_foreseen_is_what_comes(period, gain):
    horizon, frames = 10 * period, 60
    found, speeds = rollouts(frames, horizon, period=period, gain=gain)
    for i in range(15, frames - 11):
        window = speeds[i + 1 : i + 12]
        assert found[i].speed == pytest.approx(window.max(), rel=1e-6)
        assert found[i].time == pytest.approx(int(window.argmax()) * period, abs=1e-6)


def test_an_explosion_is_seen_as_far_ahead_as_the_horizon():
    found, speeds = rollouts(220, horizon=1.4)
    explosion = int(np.argmax(speeds > 10.0 * speeds[0]))
    assert 120 < explosion < 210
    first = next(i for i, each in enumerate(found) if each.speed > 10.0 * speeds[0])
    assert explosion - (first + 1) == round(1.4 / 0.04)


def test_it_takes_as_long_to_look_ahead_as_it_looks_ahead():
    """Two steps in a cycle, one of which is spent on keeping up."""
    found, _ = rollouts(60, horizon=1.0, start=Pose(LOOK, ON_TRANSVERSAL + [-0.02, 0.02, -0.02]))
    assert found[1].time <= 0.12 and found[10].time <= 0.5


@given(scale=numbers(0.5, 2.0))
def test_another_gain_than_before_is_followed(scale):
    """A camera that is suddenly commanded at another speed: the roll-out begins anew with that."""
    rollout, before, results = ClosedLoopRollout(), None, []
    for i, (stamp, lines, twist) in enumerate(loop(30)):
        if before is None:
            rollout.rest(sight(stamp, lines))
        else:
            results.append(rollout.advance(sight(stamp, lines), DESIRED.reshape(-1, 3), *before, 0.2))
        before = (scale if i > 20 else 1.0) * twist, stamp
    assert results[-1] is not None


@pytest.mark.parametrize("turn", [-1.0, 0.0])
def test_a_twist_of_another_law_has_no_preview(turn):
    assert set(rollouts(20, turn=turn)[0]) == {None}


def test_a_camera_that_is_carried_elsewhere_is_followed_from_there():
    rollout, frames = ClosedLoopRollout(), list(loop(40))
    elsewhere = list(loop(40, start=Pose(LOOK, ON_TRANSVERSAL + [0.2, 0.3, 0.0])))
    before, calm = None, np.linalg.norm(elsewhere[1][2][:3])
    for stamp, lines, twist in frames[:20] + elsewhere[20:]:
        if before is None:
            rollout.rest(sight(stamp, lines))
        else:
            found = rollout.advance(sight(stamp, lines), DESIRED.reshape(-1, 3), *before, 0.5)
        before = twist, stamp
    assert found.speed == pytest.approx(calm, rel=0.3)


def with_noise(lines, noise, generator):
    """Return lines with noise on their Plücker coordinates."""
    u, l = (each + noise * generator.normal(size=each.shape) for each in (lines.direction, lines.moment))  # noqa: E741
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return LineSet(u, l - np.einsum("ij,ij->i", u, l)[:, np.newaxis] * u, "camera")


def law(lines):
    return -0.1 * np.linalg.lstsq(interaction_matrix(lines), project_lines(lines) - DESIRED, rcond=None)[0]


def noisy_rollouts(noise, bias=0.0, frames=60, start=START_2, acted_on=True):
    """Return what is expected at each frame by a roll-out that is told the lines and by how much the seen ones differ.

    The camera moves without noise, so that only the noise samples can make a difference; whether the controller acts on
    the noise is told by the twists.
    """
    generator, rollout, found, before = np.random.default_rng(1), ClosedLoopRollout(), [], None
    for stamp, lines, twist in loop(frames, start=start):
        noisy = with_noise(lines, noise, generator)
        error = np.array([noisy.direction - lines.direction, noisy.moment - lines.moment])
        now = sight(stamp, lines)._replace(error=bias + error)
        if before is None:
            rollout.rest(now)
        else:
            found.append(rollout.advance(now, DESIRED.reshape(-1, 3), *before, 1.0))
        before = law(noisy) if acted_on else twist, stamp
    return found


def test_noise_adds_what_it_does_to_the_twist():
    """To first order: ten times the noise adds ten times as much, and it is what L and s with that noise give."""
    # Before the second cycle there are no noise samples.
    without = np.array([each.speed for each in noisy_rollouts(0.0)[1:]])
    added = [np.array([each.speed for each in noisy_rollouts(noise)[1:]]) - without for noise in (1e-7, 1e-6)]
    assert (added[0] > 0.0).all()
    assert np.median(added[1] / added[0]) == pytest.approx(10.0, rel=0.3)
    stamp, lines, twist = list(loop(31))[-1]
    generator, changes = np.random.default_rng(2), []
    for _ in range(200):
        changes.append(law(with_noise(lines, 1e-6, generator)) - twist)
    typical = np.median(np.linalg.norm(np.array(changes)[:, :3], axis=1))
    assert typical < np.median(added[1]) < 8.0 * typical


def test_noise_is_named_where_it_rules_and_a_wrong_pose_is_no_noise():
    near = Pose(LOOK, ON_TRANSVERSAL + [-0.02, 0.02, -0.02])
    calm = noisy_rollouts(0.0, start=near)
    assert not any(each.with_noise for each in calm)
    assert noisy_rollouts(0.0, bias=0.01, start=near) == calm
    noisy = noisy_rollouts(2e-3, start=near)
    assert all(each.with_noise for each in noisy[5:])
    assert np.median([a.speed / b.speed for a, b in zip(noisy, calm, strict=True)]) > 2.0


def test_noise_that_the_controller_does_not_act_on_adds_nothing():
    """It may filter the features, or know the lines from elsewhere: its twists are those of the lines as they are."""
    found, calm = noisy_rollouts(2e-3, acted_on=False), noisy_rollouts(0.0, acted_on=False)
    assert found == calm and None not in found
