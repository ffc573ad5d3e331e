# SPDX-License-Identifier: Apache-2.0
"""Looking ahead: what the camera will see when the robot begins to move by an image, and how late that is."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.features import project_lines
from plsing_ros.features.projection import have_images
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.rotations import twist_exponential

_SECOND = 1_000_000_000
# More twists are never under way at once.
_MOST_TWISTS = 4096
# After a longer gap a twist is taken to have been held for this long [ns]: the robot's own timeout is not known.
_LONGEST_HOLD = 200_000_000
# A share of each frame in the mean age; gain times an age that is not looked ahead by, from which on it is said.
_AGE_MEMORY = 0.05
_MUCH_LATER = 0.5
_HERE = Pose(np.eye(3), np.zeros(3))


class _Motion(NamedTuple):
    """Rotation and translation of a camera by a twist that was held for so long [ns]."""

    held: int
    rotation: Array
    translation: Array


class LookAhead:
    """Remembers the twists that were sent, and moves features by those that act after an image was taken.

    A twist that answers the image of time s acts from s + latency until the next one does. So between an image at t
    and the motion that answers it, the twists of images in [t - latency, t) act.

    Source: Smith's predictor, with the exact motion of a camera under constant twists.
    """

    def __init__(self) -> None:
        self._sent: deque[tuple[int, Array]] = deque(maxlen=_MOST_TWISTS)
        # Of the twists that were under way when last asked, by their stamps.
        self._motions: dict[int, _Motion] = {}

    def clear(self) -> None:
        """Take note that the robot stands still."""
        self._sent.clear()
        self._motions.clear()

    def sent(self, twist: Array, stamp: int) -> None:
        """Take note of a twist (6,) of the camera that answers an image of that stamp [ns]."""
        if self._sent and self._sent[-1][0] >= stamp:
            self._motions.pop(self._sent.pop()[0], None)
        self._sent.append((stamp, twist))

    def motion(self, stamp: int, latency: float) -> Pose:
        """Return T_now_then: where the camera is when it begins to move by an image, seen from where it took it.

        Args:
            stamp: Of the image [ns].
            latency: [s].
        """
        start = stamp - round(latency * _SECOND)
        while len(self._sent) > 1 and self._sent[1][0] <= start:
            self._sent.popleft()
        entries = list(self._sent)
        ends = [*(each for each, _ in entries[1:]), stamp] if entries else []
        R, t = _HERE.rotation, _HERE.translation
        before, self._motions = self._motions, {}
        for (begin, twist), end in zip(entries, ends, strict=True):
            held = min(min(end, stamp) - max(begin, start), _LONGEST_HOLD)
            if held > 0:
                motion = before.get(begin)
                if motion is None or motion.held != held:
                    motion = _motion(twist, held)
                self._motions[begin] = motion
                R, t = R @ motion.rotation, t + R @ motion.translation
        return Pose(R, t) if R is not _HERE.rotation else _HERE

    def ahead(self, lines: LineSet, image: Array, stamp: int, latency: float) -> tuple[LineSet, Array]:
        """Return lines and image lines as they will be then; as they are where one of them would have no image.

        Args:
            lines: In the camera's optical frame.
            image: Their image lines, shape (3n,).
            stamp: Of the image [ns].
            latency: [s].
        """
        T_now_then = self.motion(stamp, latency)
        if T_now_then is _HERE:
            return lines, image
        then = lines.transformed(T_now_then.inverse(), lines.frame)
        if not have_images(then):
            return lines, image
        changed = (image + project_lines(then) - project_lines(lines)).reshape(-1, 3)
        changed[:, :2] /= np.hypot(changed[:, 0], changed[:, 1])[:, np.newaxis]
        return then, changed.ravel()


class FeatureAge:
    """Watches how old features are when they are answered, which is the least that the latency can be."""

    def __init__(self) -> None:
        self._age = 0.0
        self._warns = False

    def hint(self, stamp: int, now: int, gain: float, latency: float) -> str:
        """Return what is wrong with the latency that is looked ahead by, or "".

        Args:
            stamp: Of the features [ns].
            now: When they are answered [ns].
            gain: lambda [1/s].
            latency: That is looked ahead by [s].
        """
        self._age += _AGE_MEMORY * ((now - stamp) / _SECOND - self._age)
        missing = gain * (self._age - latency)
        self._warns = missing > (_MUCH_LATER if not self._warns else 0.8 * _MUCH_LATER)
        if not self._warns:
            return ""
        return (
            f"features are {self._age:.2g} s old when they are answered, and latency is {latency:g} s: gain times the "
            f"difference is {missing:.2g}, and the loop diverges above 1.57; set latency, or a lower gain"
        )


def _motion(twist: Array, held: int) -> _Motion:
    return _Motion(held, *twist_exponential(held / _SECOND * twist))
