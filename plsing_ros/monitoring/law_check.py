# SPDX-License-Identifier: Apache-2.0
"""Whether the twists that are commanded are those of the law that is taken to be in force."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.planning.rollout import RolloutTask

# Laws whose roll-out commands the controller's own twists for what the camera sees.
_COMPARED = ("pinv", "dls", "adaptive_dls", "guarded", "position")
# Below these a camera rests, and noise is most of its twist [m/s], [rad/s].
_MIN_SPEED = 0.02
# A twist is the law's when it is at most this many times as long (a soft start, a gate and a slow controller shorten
# it), and its other part is no larger than this share of it.
_LONGEST, _ASIDE = 1.2, 0.25
# Of so many twists in a row, so many must not be the law's for it to be another one, and so many be it to be it again.
_WINDOW, _OTHERS, _SAME = 10, 8, 5
_FRAMES = 12


class LawCheck:
    """Keeps what the camera saw lately and the twists that answered it, and compares when it is asked."""

    def __init__(self) -> None:
        self._frames: deque[tuple[int, Pose, LineObservation]] = deque(maxlen=_FRAMES)
        self._pairs: deque[tuple[Pose, LineObservation, Array]] = deque(maxlen=_WINDOW)
        self._is_other = False

    def receive_frame(self, stamp: int, T_world_camera: Pose, observation: LineObservation) -> None:
        """Take what the camera saw at a stamp [ns]."""
        self._frames.append((stamp, T_world_camera, observation))

    def receive_twist(self, twist: Array, stamp: int) -> None:
        """Take the twist (6,) that answers the features of a stamp [ns]."""
        values = twist.tolist()
        if math.hypot(*values[:3]) < _MIN_SPEED and math.hypot(*values[3:]) < _MIN_SPEED:
            return
        for seen, pose, observation in reversed(self._frames):
            if seen == stamp:
                self._pairs.append((pose, observation, twist))
                return

    def is_other(self, task: RolloutTask) -> bool:
        """Return whether the twists are not those of the law of a task.

        Source: new, docs/concepts/risk.md.
        """
        if task.law.law not in _COMPARED:
            self._is_other = False
            return False
        pairs = list(self._pairs)
        if len(pairs) < _WINDOW:
            return self._is_other
        others = sum(not _is_of(task, *each) for each in pairs)
        if others >= _OTHERS:
            self._is_other = True
        elif len(pairs) - others >= _SAME:
            self._is_other = False
        return self._is_other


def compute_law_twist(task: RolloutTask, pose: Pose, observation: LineObservation) -> Array | None:
    """Return the twist (6,) with which the law of a task answers what is seen, or None where that is not known.

    Args:
        task: Of the roll-outs.
        pose: T_world_camera that the 3-D lines are made with.
        observation: What is seen.
    """
    if task.law.law not in _COMPARED:
        return None
    row_of = {i: row for row, i in enumerate(task.lines.ids)}
    image = np.zeros((len(task.lines), 3))
    for i, line in zip(observation.usable_ids, observation.usable_image_lines, strict=True):
        if i in row_of:
            image[row_of[i]] = line
    try:
        return task.twist(pose, image)
    except PlsingError:
        return None


def _is_of(task: RolloutTask, pose: Pose, observation: LineObservation, twist: Array) -> bool:
    law = compute_law_twist(task, pose, observation)
    if law is None:
        return True
    square = float(law @ law)
    if square == 0.0:
        return True
    share = float(twist @ law) / square
    return 0.0 < share <= _LONGEST and float(np.linalg.norm(twist - share * law)) <= _ASIDE * float(
        np.linalg.norm(twist)
    )
