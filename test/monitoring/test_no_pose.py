# SPDX-License-Identifier: Apache-2.0
"""A camera that sees lines while nobody finds its pose: the robot stands still, and the monitor says so."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from messages import mentions
from near_transversal_scene import LOOK, SCENE, SECOND, TARGET

from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor

CALM = Pose(LOOK, TARGET.translation + [0.1, -0.1, 0.1])
SEEN = LineObservation.of_lines(SCENE.transformed(CALM.inverse(), "camera"))
WHY = "no pose: a motion is not observable"
# As pose_estimator completes an image for which it finds no pose.
BLIND = dataclasses.replace(SEEN, lines_camera=None, verdict=LinesVerdict.POOR, verdict_reason=WHY)


class Stream:
    """A monitor that is shown frame after frame."""

    def __init__(self, target=TARGET, **options):
        self.monitor, self.now = SingularityMonitor(SCENE, target, **options), 10**12

    def see(self, observation, seconds=0.1):
        self.now += round(seconds * SECOND)
        if observation.lines_camera is not None:
            self.monitor.receive_pose(CALM, self.now)
        return self.monitor.answer(observation, self.now, self.now)


@given(st.floats(0.3, 5.0), st.integers(3, 60))
def test_it_alerts_after_the_time_that_is_given_and_not_before(timeout, rate):
    stream = Stream(no_pose_timeout=timeout)
    for frame in range(int(rate * timeout) + 3):
        found = stream.see(BLIND, 1.0 / rate)
        elapsed = frame / rate
        if elapsed < timeout - 1e-6:
            assert found.level is Level.UNOBSERVABLE and WHY in found.reason
        if elapsed > timeout + 1e-6:
            assert found.level is Level.CRITICAL and found.kind == "no pose"
            assert mentions(found.reason, "target", WHY)


def test_one_pose_ends_it_and_the_time_begins_anew():
    stream = Stream()
    for _ in range(25):
        found = stream.see(BLIND)
    assert found.level is Level.CRITICAL
    assert stream.see(SEEN).level is Level.OK
    # A few frames without a pose are waited for, as those without lines are.
    assert [stream.see(BLIND).level for _ in range(4)] == [Level.OK] * 3 + [Level.UNOBSERVABLE]
    assert stream.see(SEEN).level is Level.OK


@pytest.mark.parametrize(
    ("options", "observation"),
    [
        ({"target": None}, BLIND),
        ({"no_pose_timeout": 0.0}, BLIND),
        # A camera that waits for its scene sees nothing: that is no run that fails.
        ({}, dataclasses.replace(BLIND, usable=np.zeros(4, dtype=bool))),
        ({}, dataclasses.replace(BLIND, usable=np.array([True, True, False, False]))),
    ],
)
def test_without_a_target_or_lines_it_is_only_unobservable(options, observation):
    stream = Stream(**options)
    assert {stream.see(observation).level for _ in range(60)} == {Level.UNOBSERVABLE}


def test_silence_is_stale_for_ever_and_no_time_of_a_camera_that_sees():
    stream = Stream()
    for _ in range(100):
        stream.now += SECOND
        assert stream.monitor.silence(stream.now).level is Level.STALE
    for _ in range(15):
        assert stream.see(BLIND).level is Level.UNOBSERVABLE
    stream.now += 3 * SECOND
    assert stream.monitor.silence(stream.now).level in (Level.STALE, Level.UNOBSERVABLE)
    assert stream.see(BLIND).level is Level.UNOBSERVABLE
