# SPDX-License-Identifier: Apache-2.0
"""The commanded twist, and what the plain law will make of the task if it commands that twist."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation, decompose, interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.line_alignment import matched
from plsing_ros.monitoring.closed_loop_rollout import (
    MAX_DEVIATION,
    REMEMBERED_FRAMES,
    ClosedLoopRollout,
    Expected,
    Snapshot,
)
from plsing_ros.monitoring.target_estimation import TargetEstimator
from plsing_ros.parameters import MonitorParameters

_SECOND = 1_000_000_000
# Cycles for which a roll-out is waited for before being near a singularity counts by itself: at the start of a task,
# and when one was lost.
_PATIENCE_AT_START, _PATIENCE = 15, 5
# A camera that has not moved for this long rests [ns].
_REST = _SECOND


class Prediction:
    """Receives twists and roll-outs the law that commands them.

    Attributes:
        rules: Whether the roll-out alone is to alert: there is one, or there will be one in a moment.
        first_speed: At which the present motion began, to which growth refers [m/s]; 0 before any.
    """

    def __init__(self) -> None:
        self._rollout = ClosedLoopRollout()
        self._search = TargetEstimator()
        self._ids: tuple[int, ...] = ()
        # Frames at rest, looked at when a motion begins: most never are.
        self._at_rest: deque[tuple[int, LineSet, Array, Pose | None, LineSet]] = deque(maxlen=REMEMBERED_FRAMES + 1)
        self.restart()

    def restart(self) -> None:
        """Begin with another task: another target, or another clock."""
        self._twist: tuple[int, Array] | None = None
        self.first_speed, self._moved = 0.0, 0
        self._patience = _PATIENCE_AT_START
        self.rules = False
        self.interrupt()

    def interrupt(self) -> None:
        """Drop the roll-out: features were missing, or are not what they were."""
        self._rollout.clear()
        self._at_rest.clear()
        self._search.clear()
        self._previous: tuple[int, Array, LineSet] | None = None

    def receive_twist(self, twist: Array, stamp: int, min_speed: float) -> None:
        """Take the commanded twist, shape (6,), for the features of a stamp [ns].

        Args:
            twist: (v, omega) in the optical frame [m/s, rad/s].
            stamp: [ns].
            min_speed: Below this the camera rests [m/s].
        """
        self._twist = (stamp, twist)
        speed = math.hypot(*twist.tolist()[:3])
        if speed < min_speed:
            return
        # A motion begins when the camera leaves its rest; that speed is what growth refers to. A camera that only turns
        # for an instant does not rest.
        # Also after a twist that was stamped far ahead, by whatever clock: it says nothing about the present.
        if self.first_speed == 0.0 or abs(stamp - self._moved) > _REST:
            self.first_speed = speed
        self._moved = stamp

    def recent_twist(self, stamp: int, timeout: float) -> Array | None:
        """Return the latest twist if it is for features within a time [s] of the stamp [ns]."""
        if self._twist is None or abs(stamp - self._twist[0]) > timeout * _SECOND:
            return None
        return self._twist[1]

    def growth(
        self,
        observation: LineObservation,
        pose: Pose | None,
        scene: LineSet,
        target_image: Array | None,
        twist: Array | None,
        stamp: int,
        parameters: MonitorParameters,
    ) -> Expected | None:
        """Return the fastest motion ahead, in multiples of the speed at the start, or None if it is not known.

        Args:
            observation: What the camera sees.
            pose: T_world_camera, if it is known.
            scene: The lines in the scene frame.
            target_image: Image lines at the target, shape (n, 3), if known; otherwise it is found from the twists.
            twist: The recent one, if there is any.
            stamp: Of the observation [ns].
            parameters: In force.
        """
        lines = observation.lines_camera
        if lines is None or parameters.horizon == 0.0:
            self.rules = False
            return None
        if lines.ids != self._ids:
            self.interrupt()
            self._ids = lines.ids
        image = observation.usable_image_lines
        expected = None
        commanded = None if self.first_speed == 0.0 else self._twist
        if twist is not None and commanded is not None and target_image is None:
            target_image = self._target_image(twist, commanded[0])
        if twist is None or commanded is None or target_image is None:
            self._at_rest.append((stamp, lines, image, pose, scene))
        else:
            while self._at_rest:
                self._rollout.rest(_sight(*self._at_rest.popleft()))
            sight = _sight(stamp, lines, image, pose, scene)
            expected = self._rollout.advance(sight, target_image, twist, commanded[0], parameters.horizon)
            if expected is None:
                self._search.clear()
        self._previous = (stamp, image, lines)
        self._patience = self._patience - 1 if expected is None else _PATIENCE
        self.rules = self._patience >= 0
        if expected is None:
            return None
        return Expected(
            max(expected.speed, parameters.min_speed) / self.first_speed, expected.time, expected.with_noise
        )

    def _target_image(self, twist: Array, twist_stamp: int) -> Array | None:
        """Return s* as rows, shape (n, 3), as far as the twists tell it."""
        search, previous = self._search, self._previous
        if search.target_image is None and previous is not None and previous[0] == twist_stamp:
            search.add(previous[1], decompose(interaction_matrix(previous[2])), twist)
        return search.target_image


def _sight(stamp: int, lines: LineSet, image: Array, pose: Pose | None, scene: LineSet) -> Snapshot:
    """Return what is known: the scene's lines in the camera frame if they have that image, else those seen."""
    if pose is not None:
        of_scene = matched(scene, lines)
        expected, error = _core.compare_lines(
            of_scene.direction,
            of_scene.moment,
            pose.rotation,
            pose.translation,
            lines.direction,
            lines.moment,
        )
        if _core.image_deviation(expected[1], image) <= MAX_DEVIATION * len(image):
            return Snapshot(stamp, image, expected, error)
    return Snapshot(stamp, image, np.array([lines.direction, lines.moment]))
