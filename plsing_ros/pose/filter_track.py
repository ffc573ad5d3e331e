# SPDX-License-Identifier: Apache-2.0
"""One hypothesis of where a camera is, followed through images and twists."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.stats import chi2

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters.pose_estimator import FilterParameters

_ITERATIONS = 10
# A right image is refused with this probability, before a line is left out.
_FALSE_ALARM = 1e-5
# The lasting part of the twist's error, against the part that each step has anew, and how long it lasts [s].
_DRIFT_SHARE = 0.2
_DRIFT_TIME = 20.0
# A wary filter takes twists for so many times as wrong, and lets a turn that is wrong by 1 rad/s shift by so many m/s.
_WARY = 10.0
_LEVER = 1.0  # [m]
# The filter that explains the images better is followed, once it is so much more likely, as -2 log of the ratio.
_BELIEVE_WARY, _BELIEVE_TWISTS = 9.0, 20.0
_DRIFT_UNITS = _WARY / _DRIFT_SHARE
# Two filters that differ by more, in squared standard deviations (12 on average, this once in a hundred thousand), are
# not both right, and then it is the one that assumes more that is not.
_DISAGREEMENT = 44.0


class Agreement(enum.Enum):
    """How an image agrees with a track."""

    AGREES = 0
    MOVED = 1  # only if the camera moved in another way than the twist says
    CONTRADICTS = 2


@dataclass(frozen=True, eq=False)
class TrackUpdate:
    """What an image did to a track.

    Attributes:
        agreement: Whether it could be used.
        used: Which lines were, shape (k,).
        reversed: Which lines are seen against their direction, shape (k,).
        innovation: Root mean square of the innovation of the used lines, in standard deviations: 1 if all is as stated.
        cost: -2 log likelihood of the image.
    """

    agreement: Agreement
    used: list[bool]
    reversed: Array
    innovation: float
    cost: float


class FilterTrack:
    """An iterated Kalman filter with gates.

    Args:
        lines: The scene, in the world frame.
        map_lines: The same for the core.
        T_world_camera: Where the camera is.
        covariance: Of position and orientation as in geometry_msgs/PoseWithCovariance, shape (6, 6).
        settings: Noise and gates.

    Source: docs/filter.md.
    """

    def __init__(
        self,
        lines: LineSet,
        map_lines: _core.FilterMap,
        T_world_camera: Pose,
        covariance: Array,
        settings: FilterParameters,
    ) -> None:
        self._map = map_lines
        self._settings = settings
        count = 0 if map_lines.exact else len(lines)
        self._trusting = _core.FilterState(T_world_camera.rotation, T_world_camera.translation, covariance, count)
        self._wary = self._trusting.copy()
        self.cost = 0.0
        # Until images have shown that the twists are right.
        self.wary = True
        self._balance = 0.0
        self._speed = self._turn_speed = self._since_update = 0.0

    @property
    def state(self) -> _core.FilterState:
        """The state that explains the images better."""
        return self._wary if self.wary else self._trusting

    @property
    def pose(self) -> Pose:
        """T_world_camera."""
        return Pose(self.state.rotation, self.state.position)

    def predict(self, twist: Array | None, duration: float) -> None:
        """Move on for a duration [s], by a twist (v, omega) in the camera's frame, or by any motion if it is None."""
        settings, memory = self._settings, math.exp(-duration / _DRIFT_TIME)
        self._since_update += duration
        if twist is None:
            # The robot may do anything within its bounds, for as long as nobody says what.
            noise = _spread(settings.max_linear_speed, settings.max_angular_speed)
            for state in (self._trusting, self._wary):
                state.predict(np.zeros(6), noise, np.zeros(6), duration, memory)
            return
        vx, vy, vz, wx, wy, wz = twist.tolist()
        speed, turn = math.sqrt(vx * vx + vy * vy + vz * vz), math.sqrt(wx * wx + wy * wy + wz * wz)
        self._speed, self._turn_speed = max(self._speed, speed), max(self._turn_speed, turn)
        rest, rest_turn = settings.noise_linear_velocity, settings.noise_angular_velocity
        shift, angle = settings.noise_twist * speed, settings.noise_twist * turn
        self._trusting.predict(
            twist,
            _spread(shift + rest, angle + rest_turn),
            _spread(_DRIFT_SHARE * shift, _DRIFT_SHARE * angle),
            duration,
            memory,
        )
        noise = _spread(_WARY * (shift + rest) + _LEVER * angle, _WARY * (angle + rest_turn) + shift / _LEVER)
        self._wary.predict(twist, noise, noise, duration, memory)

    def update(self, rows: list[int], image: Array, covariances: Array) -> TrackUpdate:
        """Use an image, as far as it agrees; a track that it contradicts stays as it was.

        Args:
            rows: Of the k seen lines in the scene, k >= 1.
            image: Their l', shape (k, 3).
            covariances: Of angle and offset, shape (k, 3).
        """
        few, many = max(0, (len(rows) - 1) // 3), len(rows) - max(2, (len(rows) + 1) // 2)
        trusting = self._fit(self._trusting, rows, image, covariances, few)
        wary = self._fit(self._wary, rows, image, covariances, few)
        agreement = Agreement.AGREES
        if trusting is None and wary is None:
            for moved in self._moved_otherwise():
                agreement, wary = Agreement.MOVED, self._fit(moved, rows, image, covariances, few)
                if wary is not None:
                    break
        if trusting is None and wary is None and many > few:
            agreement, trusting = Agreement.AGREES, self._fit(self._trusting, rows, image, covariances, many)
        if trusting is None and wary is None:
            return TrackUpdate(Agreement.CONTRADICTS, [False] * len(rows), np.zeros(len(rows)), math.inf, math.inf)
        self._weigh(trusting, wary)
        found = wary if self.wary else trusting
        assert found is not None
        self.cost += found.cost
        self._speed = self._turn_speed = self._since_update = 0.0
        innovation, freedom = found.innovation, 2 * sum(found.used)
        return TrackUpdate(
            agreement,
            found.used,
            innovation.reversed,
            math.sqrt(innovation.squared / max(1, freedom)),
            found.cost,
        )

    def _fit(
        self, state: _core.FilterState, rows: list[int], image: Array, covariances: Array, removable: int
    ) -> _Fit | None:
        """Return a state after an image, without up to so many lines that do not agree with it; None if more do not."""
        used = [True] * len(rows)
        gate = self._settings.outlier_gate**2
        for removed in range(removable + 1):
            after = state.copy()
            innovation = after.update(self._map, rows, image, covariances, used, _ITERATIONS)
            if innovation.good:
                worst = max(_values_of(innovation.of_line, used))
                if worst <= gate and innovation.squared <= _quantile(2 * sum(used)):
                    return _Fit(after, innovation, used, self._cost(innovation, used))
                suspect = innovation.removal
            else:
                suspect = innovation.of_line
            if removed < removable:
                used = list(used)
                used[int(np.argmax(np.where(used, suspect, -math.inf)))] = False
        return None

    def _cost(self, innovation: _core.Innovation, used: list[bool]) -> float:
        settings = self._settings
        reversals = float(innovation.reversed @ used)
        left_out = len(used) - sum(used)
        return float(
            innovation.squared
            + innovation.log_determinant
            + settings.reversal_cost * reversals
            # A line that is left out may be anywhere, within a radian or so.
            + settings.outlier_gate**2 * left_out
        )

    def _weigh(self, trusting: _Fit | None, wary: _Fit | None) -> None:
        """Follow the filter that explains the images better; the other one goes on from there, if it was refuted."""
        if trusting is None or wary is None:
            self.wary, self._balance = trusting is None, 0.0
            if trusting is None:
                assert wary is not None
                self._wary, self._trusting = wary.state, _trusting_copy(wary.state)
            else:
                self._trusting, self._wary = trusting.state, trusting.state.copy()
                self._wary.scale_drift(1.0 / _DRIFT_UNITS)
            return
        self._trusting, self._wary = trusting.state, wary.state
        self._balance += trusting.cost - wary.cost
        refuted = self._trusting.disagreement(self._wary, _DRIFT_UNITS) > _DISAGREEMENT
        if refuted or self._balance >= _BELIEVE_WARY:
            self.wary, self._balance = True, 0.0
            self._trusting = _trusting_copy(self._wary)
        elif not self.wary:
            self._balance = max(0.0, self._balance)
        elif self._balance <= -_BELIEVE_TWISTS:
            self.wary, self._balance = False, 0.0

    def _moved_otherwise(self) -> list[_core.FilterState]:
        """Return states of a camera that did not move as it was told: about as fast, or as fast as it can."""
        seconds, settings = self._since_update, self._settings
        states = []
        for shift, turn in (
            (2.0 * self._speed, 2.0 * self._turn_speed),
            (settings.max_linear_speed, settings.max_angular_speed),
        ):
            state = self._wary.copy()
            state.inflate(8.0 * state.covariance + np.diag(_spread(shift * seconds, turn * seconds) ** 2))
            states.append(state)
        return states


@dataclass(frozen=True, eq=False)
class _Fit:
    """A state after an image: with the innovation, which lines were used, and -2 log of the image's likelihood."""

    state: _core.FilterState
    innovation: _core.Innovation
    used: list[bool]
    cost: float


def _trusting_copy(wary: _core.FilterState) -> _core.FilterState:
    """Return a state that trusts twists but for the drift that a wary one has found."""
    state = wary.copy()
    state.scale_drift(_DRIFT_UNITS)
    return state


def _spread(linear: float, angular: float) -> Array:
    return np.array((linear, linear, linear, angular, angular, angular))


def _values_of(values: Array, used: list[bool]) -> list[float]:
    """Return those values that are used, and 0."""
    return [0.0, *(value for value, use in zip(values.tolist(), used, strict=True) if use)]


@lru_cache(maxsize=256)
def _quantile(freedom: int) -> float:
    """Return what a sum of squares exceeds by chance with the probability of a false alarm."""
    return float(chi2.isf(_FALSE_ALARM, max(1, freedom)))
