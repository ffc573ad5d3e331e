# SPDX-License-Identifier: Apache-2.0
"""Whether a wrong pose leads the camera away from the target, as the image tells."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from scipy.special import chdtri

from plsing_ros.arrays import Array
from plsing_ros.control.displacement import composed
from plsing_ros.control.image_mismatch import ImageMismatch, covariances_by_motion, whitened
from plsing_ros.control.pose_doubt import DOUBTFUL, OF_A_POSE

# How sure it is that the errors of the image are not larger than what the best pose leaves of it says.
_SURE = 0.95
# The least variance of the image over what is said, singular value of J over the largest, and distance [m].
_LEAST = 1e-6
# A pose may be off by a hundred times what its covariance says where the image does not tell.
_WIDE = 1e-4
# The camera is as far away as the image shows beyond so many standard deviations; farther than before beyond so many,
# for this is asked of every frame, and at first the two are close.
_DEVIATIONS = 2.0
_OF_A_DIFFERENCE = 4.0
# As many frames are looked at together.
_FRAMES = 10
# Steps to where the image puts the camera in the first frame, when the pose may be far off; later ones follow it by one
# each. A step must take away this share of what is left.
_STEPS = 8
_WORTH = 0.1


class Departure:
    """Watches how far from the target the camera is by the image.

    Attributes:
        scale: Variance of the image's errors over what is said: the largest that leaves so little, at most 1.
    """

    def __init__(self) -> None:
        self.scale = 1.0
        # The latest frames with the same lines, and where the camera is by them, seen from where the pose puts it.
        self._latest: deque[ImageMismatch] = deque(maxlen=_FRAMES)
        self._delta: Array = np.zeros(6)
        # Where the camera began by the pose, how far from the target by the image then [m], and whether it was farther.
        self._first: Array | None = None
        self._began = 0.0
        self._led_away = self._paused = False

    def pause(self) -> None:
        """Take note that the camera was told to stand still: what moves it meanwhile is not the pose."""
        self._paused = True

    def change_lines(self) -> None:
        """Forget the latest frames: the next ones have other lines."""
        self._latest.clear()
        self._delta = np.zeros(6)

    def update(self, seen: ImageMismatch, own: Array, lasting: Array, pose: Array, told: Array) -> float:
        """Learn from a frame, and return by how much more than its covariance allows the pose is off.

        That is 0 until the image shows that the camera is farther from the target than where it began. A pose that led
        there is not believed again. Of lines that any pose explains, three, nothing is learnt.

        Args:
            seen: The mismatch of the frame.
            own, lasting: Covariances of image lines in one frame, and of errors that are the same in all, shape (n, 3).
            pose: Covariance of what a pose may explain, shape (6, 6).
            told: The displacement from the target by the pose, as a twist over unit time, shape (6,).

        Source: new, docs/pose_laws.md.
        """
        spare = len(seen.r) - OF_A_POSE
        if spare <= 0:
            return 0.0
        self._latest.append(seen)
        frames, known = len(self._latest), np.linalg.inv(pose)
        together = ImageMismatch.together(self._latest)
        left, limit = math.inf, float(chdtri(spare, _SURE))
        for _ in range(_STEPS if frames == 1 else 1):
            table = self._taken_there(together)
            # Frames count as independent, and what lasts in them once. Near a line the error of each pose matters, too.
            of_pose = covariances_by_motion(table[:, :6], pose)
            rows = whitened(table, np.tile(own + frames * lasting, (frames, 1)) + of_pose)
            of_mean = (own + of_pose.reshape(frames, -1, 3).mean(axis=0)) / frames + lasting
            mean = whitened(table.reshape(frames, -1, 7).mean(axis=0), of_mean)
            if not math.isfinite(float(np.square(rows).sum() + np.square(mean).sum())):
                # What cannot be computed with is for the law to say.
                self.change_lines()
                return 0.0
            J, r = mean[:, :6], mean[:, 6]
            rest = float(np.square(r - J @ np.linalg.lstsq(J, r, _LEAST)[0]).sum())
            if rest > (1.0 - _WORTH) * left:
                break
            J, r = rows[:, :6], rows[:, 6]
            left, normal, right = rest, J.T @ J, J.T @ r
            variance = left / limit + _LEAST
            information = normal + variance * _WIDE * known
            self._delta = np.asarray(np.linalg.solve(information, right), dtype=float)
        self.scale = min(1.0, variance)
        self._watch(told, variance * np.linalg.inv(information)[:3, :3], pose[:3, :3])
        if not self._led_away:
            return 0.0
        explained = float(right @ self._delta) - float(right @ np.linalg.solve(normal + self.scale * known, right))
        return max(0.0, explained / (OF_A_POSE * self.scale) - DOUBTFUL)

    def _taken_there(self, together: ImageMismatch) -> Array:
        """Return J and r, taken where the image puts the camera but as functions of delta, side by side."""
        there = together.seen_from(self._delta)
        if there is None:
            self._delta, there = np.zeros(6), together
        return np.column_stack([there.J, there.r + there.J @ self._delta])

    def _watch(self, told: Array, covariance: Array, pose: Array) -> None:
        """Take note of where the camera is by the image.

        Args:
            told: By the pose, as a twist, shape (6,).
            covariance: Of the image's word, shape (3, 3) [m^2].
            pose: Of the position in told, shape (3, 3) [m^2].
        """
        position = composed(told, self._delta)[:3]
        variances, axes = np.linalg.eigh(covariance)
        unsure = _DEVIATIONS * np.sqrt(np.maximum(variances, 0.0))
        at_least = float(np.linalg.norm(np.maximum(np.abs(axes.T @ position) - unsure, 0.0)))
        if self._first is None:
            self._first, self._began = told, float(np.linalg.norm(position))
        # What the image says now of where the camera began is off by the same: less of it counts in the difference.
        began = composed(self._first, self._delta)[:3]
        here, there = (each / max(float(np.linalg.norm(each)), _LEAST) for each in (position, began))
        variance = (here - there) @ covariance @ (here - there) + here @ pose @ here + there @ pose @ there
        farther = float(np.linalg.norm(position) - np.linalg.norm(began))
        if farther > _OF_A_DIFFERENCE * math.sqrt(float(variance)) or at_least > self._began:
            if self._paused:
                self._first, self._began = told, max(self._began, at_least)
            else:
                self._led_away = True
        self._paused = False
