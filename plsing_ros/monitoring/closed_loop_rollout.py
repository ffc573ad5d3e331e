# SPDX-License-Identifier: Apache-2.0
"""Where the plain law leads: the control loop run ahead of the camera, step by step, and checked against what comes."""

from __future__ import annotations

import math
from collections import deque
from operator import mul
from typing import NamedTuple

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array

_SECOND = 1_000_000_000
# The commanded twist follows the law if their cosine is above this.
_SAME_DIRECTION = 0.8
# The commanded twists of the latest cycles are those foreseen if their regression on these has a slope in this range;
# noise near a singularity makes each by itself useless.
_SLOPE = (0.5, 1.6)
_FORGET = 0.85
# Image lines that deviate by up to this are as foreseen [mean square of l'].
MAX_DEVIATION = 0.02**2
# Steps in one cycle: more than one until the roll-out is as far ahead as it is to be, then one keeps it there.
_STEPS = 2
# A speed that comes out of a leap counts this many times.
_AFTER_LEAP = 1.25
# At each step the law is also asked what it would command with the noise of so many of the latest frames; the largest
# change of speed counts so many times, because other noise may do more.
_NOISE_SAMPLES, _WITH_NOISE = 2, 2.0
REMEMBERED_FRAMES = 25
# Less than this is rounding [1, m].
_MIN_NOISE = 1e-9
# Speeds and turns are not followed beyond this; every number that is published is finite.
_FASTEST = 1e9  # [m/s], [rad/s]
_MIN_DEPTH = 1e-9  # [m]
_SHORTEST_STEP, _LONGEST_STEP = 10_000_000, _SECOND // 2  # [ns]


class Expected(NamedTuple):
    """The fastest motion ahead.

    Attributes:
        speed: Linear speed [m/s], a quarter more after a leap across a singularity.
        time: Until then [s].
        with_noise: Whether more than half of it is what noise of the features, as it was lately, may add.
    """

    speed: float
    time: float
    with_noise: bool = False


class Snapshot(NamedTuple):
    """What is known of the camera at one instant.

    Attributes:
        stamp: [ns].
        image: The image lines, shape (n, 3).
        lines: The best that is known of the lines in the camera frame: direction and moment, shape (2, n, 3).
        error: By how much those that are seen differ from them, shape (2, n, 3), or None if it is not known.
    """

    stamp: int
    image: Array
    lines: Array
    error: Array | None = None


class _Sample(NamedTuple):
    """One step of the roll-out: at a stamp [ns] the camera sees lines (2, n, 3), and the law commands a twist (6,)."""

    stamp: int
    lines: Array
    twist: Array
    speed: float
    with_noise: bool = False


_AT_REST = np.zeros(6)
_SQRT_HALF = math.sqrt(0.5)
_NOTHING = _Sample(0, np.zeros((2, 0, 3)), _AT_REST, 0.0)


class ClosedLoopRollout:
    """Runs the control loop ahead with the period of the features, and reports the fastest speed it meets.

    What the camera sees, the target and the twist that is really commanded are the only inputs: the gain is read off
    the twist. As long as the camera sees what was foreseen, one step in each cycle keeps the roll-out ahead;
    otherwise it begins anew from what is seen. A twist in another direction than the law's ends the roll-out, because
    it then says nothing about what comes. Each step is repeated with samples of the latest features' noise, if known.

    Source: new, docs/monitor.md.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything: another target, other lines, or features that were missing."""
        self._previous: Snapshot | None = None
        self._noise: deque[Array] = deque(maxlen=REMEMBERED_FRAMES)
        self._noise_sampled = 0
        # How far the latest commanded twists are from the law's at the lines as they are, and as they are seen.
        self._apart = self._apart_as_seen = 0.0
        self._end()

    def _end(self) -> None:
        self._samples: deque[_Sample] = deque()
        self._gain, self._step = 0.0, 0
        # The fastest sample, and those that will be it when the ones before are past.
        self._fastest: deque[_Sample] = deque([_NOTHING])
        # Sums of products of foreseen twists with commanded ones and with themselves.
        self._product = self._square = 0.0
        # Of the roll-out before this one, until this one has got as far.
        self._before = _NOTHING

    def rest(self, snapshot: Snapshot) -> None:
        """Note what the camera sees while no law moves it."""
        self._end()
        self._note_noise(snapshot)
        self._previous = snapshot

    def advance(
        self, snapshot: Snapshot, target_image: Array, twist: Array, twist_stamp: int, horizon: float
    ) -> Expected | None:
        """Go on with the roll-out and return the fastest motion ahead, or None if it is not known.

        Args:
            snapshot: What the camera sees now; its rows are the same lines at every call since the last `clear`.
            target_image: The image lines at the target in the same order, shape (n, 3).
            twist: The latest commanded twist, shape (6,).
            twist_stamp: Of the features it was commanded for [ns].
            horizon: How far to look ahead [s].
        """
        self._note_noise(snapshot)
        previous, self._previous = self._previous, snapshot
        if previous is None or snapshot.stamp <= previous.stamp:
            return self._ahead(snapshot.stamp) if self._samples else None
        commanded_for = previous if twist_stamp - previous.stamp < snapshot.stamp - twist_stamp else snapshot
        law = self._law_as_seen(commanded_for, target_image, twist) if twist_stamp == commanded_for.stamp else None
        if not self._as_foreseen(snapshot, twist, commanded_for.stamp, law):
            if law is None:
                law = _law_at(commanded_for.lines, target_image)
            self._begin(snapshot, target_image, twist, law, snapshot.stamp - previous.stamp)
        if not self._samples:
            return None
        end = snapshot.stamp + round(horizon * _SECOND)
        for _ in range(_STEPS):
            if self._samples[-1].stamp >= end or self._samples[-1].speed >= _FASTEST:
                break
            self._go_on(target_image)
        return self._ahead(snapshot.stamp)

    def _law_as_seen(self, snapshot: Snapshot, target_image: Array, twist: Array) -> Array | None:
        """Return the law's twist for gain 1 at the lines with the noise that is seen, if the controller acts on that.

        It may as well filter the features, or know the lines from elsewhere: the directions of its twists tell.
        """
        if snapshot.error is None or not self._noise:
            return None
        as_is, as_seen = _law_at(snapshot.lines, target_image), _law_at(snapshot.lines + snapshot.error, target_image)
        if as_is is None or as_seen is None:
            return None
        self._apart = _FORGET * self._apart + _squared_sine(twist, as_is)
        self._apart_as_seen = _FORGET * self._apart_as_seen + _squared_sine(twist, as_seen)
        return as_seen if self._acts_on_noise else None

    @property
    def _acts_on_noise(self) -> bool:
        return self._apart_as_seen < self._apart

    def _as_foreseen(self, snapshot: Snapshot, twist: Array, twist_stamp: int, law: Array | None) -> bool:
        """Drop what is past, and return whether the roll-out was right about the present."""
        samples, commanded = self._samples, True
        while samples and samples[0].stamp < snapshot.stamp - self._step // 2:
            sample = samples.popleft()
            if abs(sample.stamp - twist_stamp) <= self._step // 2:
                commanded = self._is_commanded(sample.twist if law is None else self._gain * law, twist)
        if not commanded:
            # Another law, another target or another gain: nothing that was foreseen holds.
            self._end()
            return False
        if not samples:
            return False
        deviation = _core.image_deviation(samples[0].lines[1], snapshot.image)
        return deviation <= MAX_DEVIATION * len(snapshot.image)

    def _is_commanded(self, foreseen: Array, twist: Array) -> bool:
        numbers = foreseen.tolist()
        self._product = _FORGET * self._product + sum(map(mul, numbers, twist.tolist()))
        self._square = _FORGET * self._square + sum(map(mul, numbers, numbers))
        return _SLOPE[0] * self._square <= self._product <= _SLOPE[1] * self._square

    def _begin(self, snapshot: Snapshot, target_image: Array, twist: Array, law: Array | None, period: int) -> None:
        # Noise can hide the law in one twist; then what the latest ones said still holds.
        gain = 0.0 if law is None else _projection(law, twist) or self._gain
        now = _law_step(snapshot.lines, _AT_REST, 0.0, target_image, gain) if gain else None
        if now is None:
            self._end()
            return
        if self._samples:
            self._before = self._fastest[0]
        self._gain = gain
        self._step = min(max(period, _SHORTEST_STEP), _LONGEST_STEP)
        self._samples.clear()
        self._fastest.clear()
        self._append(_Sample(snapshot.stamp, *now, _speed(now[1].tolist())))

    def _go_on(self, target_image: Array) -> None:
        last = self._samples[-1]
        stamp = last.stamp + self._step
        ahead = _law_step(last.lines, last.twist, self._step / _SECOND, target_image, self._gain)
        if ahead is None:
            # The roll-out ran into a singularity: as fast as it gets.
            self._append(_Sample(stamp, last.lines, last.twist, _FASTEST))
            return
        lines, twist = ahead
        after, before = twist.tolist(), last.twist.tolist()
        speed = _speed(after)
        if math.dist(after, before) > math.hypot(*before):
            # Across a singularity in one step: where the camera lands on the other side is a matter of rounding.
            speed *= _AFTER_LEAP
        by_noise = _WITH_NOISE * self._speed_by_noise(lines, twist, target_image) if self._acts_on_noise else 0.0
        self._append(_Sample(stamp, lines, twist, min(speed + by_noise, _FASTEST), by_noise > speed))

    def _note_noise(self, snapshot: Snapshot) -> None:
        """Remember the noise of what is seen; between two frames, what is wrong with the pose falls out."""
        previous = self._previous
        if previous is None or previous.error is None or snapshot.error is None or snapshot.stamp <= previous.stamp:
            return
        noise, size = _core.subtract(snapshot.error.ravel(), previous.error.ravel())
        if _SQRT_HALF * size > _MIN_NOISE:
            self._noise.append(_SQRT_HALF * noise.reshape(snapshot.error.shape))

    def _speed_by_noise(self, lines: Array, twist: Array, target_image: Array) -> float:
        """Return by how much the speed changes if the law sees the lines with the noise of the latest frames [m/s]."""
        change = 0.0
        for _ in range(_NOISE_SAMPLES):
            self._noise_sampled += 1
            noise = self._noise[self._noise_sampled % len(self._noise)]
            noisy = _law_step(lines + noise, _AT_REST, 0.0, target_image, self._gain)
            # Where the noise makes it singular, it is as fast as it gets.
            change = max(change, _FASTEST if noisy is None else _speed((noisy[1] - twist).tolist()))
        return change

    def _append(self, sample: _Sample) -> None:
        self._samples.append(sample)
        while self._fastest and self._fastest[-1].speed < sample.speed:
            self._fastest.pop()
        self._fastest.append(sample)

    def _ahead(self, now: int) -> Expected:
        while self._fastest[0].stamp < self._samples[0].stamp:
            self._fastest.popleft()
        fastest = self._fastest[0]
        if self._before.stamp > self._samples[-1].stamp and self._before.speed > fastest.speed:
            fastest = self._before
        return Expected(fastest.speed, max(fastest.stamp - now, 0) / _SECOND, fastest.with_noise)


def _law_step(
    lines: Array, twist: Array, duration: float, target_image: Array, gain: float
) -> tuple[Array, Array] | None:
    """Return lines (2, n, 3) after a motion and the twist that the law commands there, or None if it has none."""
    return _core.step_law(lines, target_image, twist, duration, gain, _MIN_DEPTH, _FASTEST)


def _law_at(lines: Array, target_image: Array) -> Array | None:
    """Return the law's twist for gain 1, or None if it has none."""
    step = _law_step(lines, _AT_REST, 0.0, target_image, 1.0)
    return None if step is None else step[1]


def _speed(twist: list[float]) -> float:
    return min(math.hypot(*twist[:3]), _FASTEST)


def _squared_sine(a: Array, b: Array) -> float:
    product = float(a.dot(b))
    squares = float(a.dot(a)) * float(b.dot(b))
    return 1.0 - product * product / squares if squares > 0.0 else 0.0


def _projection(compute_twist: Array, twist: Array) -> float | None:
    """Return the factor that makes the law's twist most like the commanded one, or None if it is not that law's."""
    square, product = float(compute_twist @ compute_twist), float(compute_twist @ twist)
    commanded = float(twist @ twist)
    if square <= 0.0 or product <= 0.0 or product * product < _SAME_DIRECTION**2 * square * commanded:
        return None
    return product / square
