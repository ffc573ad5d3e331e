"""Where the plain law leads: the control loop run ahead of the camera, step by step, and checked against what comes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.servoing.monitoring.law_step import FASTEST, law, lines_after

_SECOND = 1_000_000_000
# The commanded twist follows the law if their cosine is above this.
_SAME_DIRECTION = 0.8
# The commanded twists of the latest cycles are those foreseen if their regression on these has a slope in this range;
# noise near a singularity makes each by itself useless.
_SLOPE = (0.5, 1.6)
_FORGET = 0.85
# Image lines that deviate from the preview by less than this are as foreseen [root mean square of l'].
_AS_FORESEEN = 0.02
# Steps in one cycle: more than one until the preview is as far ahead as it is to be, then one keeps it there.
_STEPS = 2
# A speed that comes out of a leap counts this many times.
_AFTER_LEAP = 1.25
_SHORTEST_STEP, _LONGEST_STEP = 10_000_000, _SECOND // 2  # [ns]


class Expected(NamedTuple):
    """The fastest motion ahead.

    Attributes:
        speed: Linear speed [m/s], a quarter more after a leap across a singularity.
        time: Until then [s].
    """

    speed: float
    time: float


class Sight(NamedTuple):
    """What is known of the camera at one instant.

    Attributes:
        stamp: [ns].
        image: The image lines, shape (n, 3).
        lines: Returns the best that is known of the lines in the camera frame: direction and moment, shape (2, n, 3).
    """

    stamp: int
    image: Array
    lines: Callable[[], Array]


class _Sample(NamedTuple):
    """One step of the preview: at a stamp [ns] the camera sees lines (2, n, 3), and the law commands a twist (6,)."""

    stamp: int
    lines: Array
    twist: Array
    speed: float


_NOTHING = _Sample(0, np.zeros((2, 0, 3)), np.zeros(6), 0.0)


class LawPreview:
    """Runs the control loop ahead with the period of the features, and reports the fastest speed it meets.

    What the camera sees, the goal and the twist that is really commanded are the only inputs: the gain is read off the
    twist. As long as the camera sees what was foreseen, one step in each cycle keeps the preview ahead; otherwise it
    begins anew from what is seen. A twist in another direction than the law's ends the preview, because it then says
    nothing about what comes.

    Source: new, docs/monitor.md.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything: another goal, other lines, or features that were missing."""
        self._previous: Sight | None = None
        self._end()

    def _end(self) -> None:
        self._samples: deque[_Sample] = deque()
        self._gain, self._step = 0.0, 0
        self._fastest = _NOTHING
        # Sums of products of foreseen twists with commanded ones and with themselves.
        self._product = self._square = 0.0
        # Of the preview before this one, until this one has got as far.
        self._before: tuple[float, int] = (0.0, 0)

    def rest(self, sight: Sight) -> None:
        """Note what the camera sees while no law moves it."""
        self._end()
        self._previous = sight

    def advance(self, sight: Sight, desired: Array, twist: Array, twist_stamp: int, horizon: float) -> Expected | None:
        """Go on with the preview and return the fastest motion ahead, or None if it is not known.

        Args:
            sight: What the camera sees now; its rows are the same lines at every call since the last `clear`.
            desired: The image lines at the goal in the same order, shape (n, 3).
            twist: The latest commanded twist, shape (6,).
            twist_stamp: Of the features it was commanded for [ns].
            horizon: How far to look ahead [s].
        """
        previous, self._previous = self._previous, sight
        if previous is None or sight.stamp <= previous.stamp:
            return self._ahead(sight.stamp) if self._samples else None
        commanded_for = previous if twist_stamp - previous.stamp < sight.stamp - twist_stamp else sight
        try:
            if not self._as_foreseen(sight, twist, commanded_for.stamp):
                self._begin(sight, desired, twist, commanded_for, sight.stamp - previous.stamp)
        except np.linalg.LinAlgError:
            self._end()
        if not self._samples:
            return None
        end = sight.stamp + round(horizon * _SECOND)
        for _ in range(_STEPS):
            if self._samples[-1].stamp >= end or self._samples[-1].speed >= FASTEST:
                break
            self._go_on(desired)
        return self._ahead(sight.stamp)

    def _as_foreseen(self, sight: Sight, twist: Array, twist_stamp: int) -> bool:
        """Drop what is past, and return whether the preview was right about the present."""
        samples, commanded = self._samples, True
        while samples and samples[0].stamp < sight.stamp - self._step // 2:
            sample = samples.popleft()
            if abs(sample.stamp - twist_stamp) <= self._step // 2:
                commanded = self._is_commanded(sample.twist, twist)
        if not commanded:
            # Another law, another goal or another gain: nothing that was foreseen holds.
            self._end()
            return False
        if not samples:
            return False
        return is_alike(samples[0].lines, sight.image)

    def _is_commanded(self, foreseen: Array, twist: Array) -> bool:
        self._product = _FORGET * self._product + float(foreseen @ twist)
        self._square = _FORGET * self._square + float(foreseen @ foreseen)
        return _SLOPE[0] * self._square <= self._product <= _SLOPE[1] * self._square

    def _begin(self, sight: Sight, desired: Array, twist: Array, commanded_for: Sight, period: int) -> None:
        gain = _projection(law(commanded_for.lines(), desired), twist)
        if gain is None:
            # Noise can hide the law in one twist; then what the latest ones said still holds.
            gain = self._gain
        if gain == 0.0:
            self._end()
            return
        if self._samples:
            self._before = (self._fastest.speed, self._fastest.stamp)
        self._gain = gain
        self._samples.clear()
        self._step = min(max(period, _SHORTEST_STEP), _LONGEST_STEP)
        self._fastest = self._sample(sight.stamp, sight.lines(), desired)
        self._samples.append(self._fastest)

    def _go_on(self, desired: Array) -> None:
        last = self._samples[-1]
        stamp = last.stamp + self._step
        try:
            sample = self._sample(stamp, lines_after(last.lines, last.twist * (self._step / _SECOND)), desired)
            change = sample.twist - last.twist
            if change @ change > last.twist @ last.twist:
                # Across a singularity in one step: where the camera lands on the other side is a matter of rounding.
                sample = sample._replace(speed=_AFTER_LEAP * sample.speed)
        except np.linalg.LinAlgError:
            # The preview ran into a singularity: as fast as it gets.
            sample = _Sample(stamp, last.lines, last.twist, FASTEST)
        self._samples.append(sample)
        if sample.speed > self._fastest.speed:
            self._fastest = sample

    def _sample(self, stamp: int, lines: Array, desired: Array) -> _Sample:
        twist = self._gain * law(lines, desired)
        return _Sample(stamp, lines, twist, min(math.sqrt(float(twist[:3] @ twist[:3])), FASTEST))

    def _ahead(self, now: int) -> Expected:
        if self._fastest.stamp < self._samples[0].stamp:
            self._fastest = max(self._samples, key=lambda each: each.speed)
        speed, stamp = self._fastest.speed, self._fastest.stamp
        if self._before[1] > self._samples[-1].stamp and self._before[0] > speed:
            speed, stamp = self._before
        return Expected(speed, max(stamp - now, 0) / _SECOND)


def is_alike(lines: Array, image: Array) -> bool:
    """Return whether lines in the camera frame (2, n, 3) have about these image lines (n, 3)."""
    moment = lines[1]
    deviation = (moment / np.hypot(moment[:, 0], moment[:, 1])[:, np.newaxis] - image).ravel()
    return bool(deviation @ deviation <= len(image) * _AS_FORESEEN**2)


def _projection(law_twist: Array, twist: Array) -> float | None:
    """Return the factor that makes the law's twist most like the commanded one, or None if it is not that law's."""
    square, product = float(law_twist @ law_twist), float(law_twist @ twist)
    commanded = float(twist @ twist)
    if square <= 0.0 or product <= 0.0 or product * product < _SAME_DIRECTION**2 * square * commanded:
        return None
    return product / square
