# SPDX-License-Identifier: Apache-2.0
"""A camera pose followed for robots of several kinds at once: those that move as told, those that drift, and others."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.stats import chi2

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.parameters.pose_estimator import FilterParameters

_ITERATIONS = 10
# A right image is refused with this probability, before a line is left out.
_FALSE_ALARM = 1e-7
# The lasting part of a twist's error, the drift, is forgotten in this time [s].
_DRIFT_TIME = 20.0
# Over so long the mean of the twists is taken for a robot that moves more evenly than it is told [s].
MEAN_TIME = 0.2
# No kind of robot is ever ruled out further than this.
_MIN_WEIGHT = 1e-12
_AT_REST = np.zeros(6)
# A state that is less likely than this does not move the mean of all.
_NEGLIGIBLE = 1e-7
# Of robots that are more wrong than expected: what a wrong turn shifts, and a wrong shift turns.
_ARM, _BEND = 0.5, 0.02  # [m], [rad/m]


@dataclass(frozen=True)
class _RobotKind:
    """What a robot may make of the twists it is given.

    Attributes:
        noise: Error of each step, against noise.twist.
        drift: Lasting error, likewise; of the mean of the twists that of each component of the mean.
        share: How probable it is at the start.
        rate: How often a robot of another kind becomes one of this [1/s].
        evenly: Whether it moves by the mean of the twists, as one with inertia does, or one whose odometry is noisy.
    """

    noise: float
    drift: float
    share: float
    rate: float
    evenly: bool = False


_ROBOT_KINDS = (
    _RobotKind(noise=1.0, drift=0.02, share=0.5, rate=0.02),
    _RobotKind(noise=1.0, drift=2.0, share=0.1, rate=0.0001),
    _RobotKind(noise=4.0, drift=6.0, share=0.1, rate=0.0001),
    # As uncertain as the mean of twists, at 25 Hz, each of which is wrong by 10 times noise.twist.
    _RobotKind(noise=1.0, drift=3.0, share=0.1, rate=0.001, evenly=True),
    _RobotKind(noise=10.0, drift=0.02, share=0.2, rate=0.001),
)


class Agreement(enum.Enum):
    """How an image agrees with a pose."""

    AGREES = 0
    MOVED = 1  # only if the camera moved in another way than the twist says
    MOSTLY = 2  # with most lines
    CONTRADICTS = 3


@dataclass(frozen=True)
class SeenLines:
    """What one image shows of a map.

    Attributes:
        lines: The map.
        rows: Of the k seen lines in it, k >= 1.
        image: Their l', shape (k, 3).
        covariances: Of angle and offset, shape (k, 3).
    """

    lines: _core.FilterMap
    rows: list[int]
    image: Array
    covariances: Array


@dataclass(frozen=True, eq=False)
class MotionFit:
    """A state after an image.

    Attributes:
        before: The state before it.
        fit: The state with what the image said of it.
    """

    before: _core.FilterState
    fit: _core.Fit

    def curvature(self, seen: SeenLines) -> _core.Curvature:
        """Return where the image told least, and how far from linear it is there."""
        own = self.fit
        return own.state.curvature(self.before, seen.lines, seen.rows, seen.image, seen.covariances, own.used)


class MotionBank:
    """A Kalman filter with gates for each kind of robot, weighed by how well each explains the images.

    Args:
        states: One for each kind.
        weights: Of each, with sum 1.
        settings: Noise and gates.
        interval: Between the last two images [s].

    Source: interacting multiple models (Blom, Bar-Shalom 1988); docs/filter.md.
    """

    def __init__(
        self, states: list[_core.FilterState], weights: list[float], settings: FilterParameters, interval: float = 0.0
    ) -> None:
        self._states = states
        self._weights = weights
        self._settings = settings
        self._interval = interval
        self._speed = self._turn_speed = self._since_update = 0.0
        self._state: _core.FilterState | None = None

    @property
    def state(self) -> _core.FilterState:
        """Mean and covariance of all."""
        if self._state is None:
            self._state = _mixture(self._states, self._weights)
        return self._state

    @staticmethod
    def start(T_world_camera: Pose, covariance: Array, map_lines: int, settings: FilterParameters) -> MotionBank:
        """Return one that knows nothing of the robot yet."""
        unit = settings.noise_twist**2 * np.eye(6)
        states = [
            _core.FilterState(
                T_world_camera.rotation, T_world_camera.translation, covariance, kind.drift**2 * unit, map_lines
            )
            for kind in _ROBOT_KINDS
        ]
        return MotionBank(states, [kind.share for kind in _ROBOT_KINDS], settings)

    def predict(self, twist: Array | None, mean: Array | None, duration: float) -> None:
        """Move on for a duration [s].

        Args:
            twist: (v, omega) in the camera's frame; None: any motion within the bounds.
            mean: Of the twists up to now, over MEAN_TIME; None likewise.
            duration: How long [s].
        """
        if self._since_update == 0.0:
            self._mix()
        settings = self._settings
        self._since_update += duration
        if twist is None or mean is None:
            # The robot may do anything within its bounds, for as long as nobody says what.
            twist = mean = _AT_REST
            rest, rest_turn = settings.max_linear_speed, settings.max_angular_speed
        else:
            rest, rest_turn = settings.noise_linear_velocity, settings.noise_angular_velocity
        (speed, turn), (mean_speed, mean_turn) = _speeds(twist), _speeds(mean)
        self._speed, self._turn_speed = max(self._speed, speed), max(self._turn_speed, turn)
        share, by_drift, memory = settings.noise_twist, _drift_twist(twist), math.exp(-duration / _DRIFT_TIME)
        for kind, state in zip(_ROBOT_KINDS, self._states, strict=True):
            if kind.evenly:
                noise = _spread(kind.noise * share * mean_speed + rest, kind.noise * share * mean_turn + rest_turn)
                forgotten = math.exp(-duration / MEAN_TIME)
                by_mean = np.diag(_spread(mean_speed, mean_turn))
                state.predict(mean, noise, by_mean, kind.drift * share, duration, forgotten)
                continue
            shift, angle = kind.noise * share * speed, kind.noise * share * turn
            beyond, beyond_turn = shift - share * speed, angle - share * turn
            noise = _spread(shift + rest + _ARM * beyond_turn, angle + rest_turn + _BEND * beyond)
            state.predict(twist, noise, by_drift, kind.drift * share, duration, memory)
        self._state = None

    def _mix(self) -> None:
        """Let the robot become one of another kind, in the time between two images."""
        share = self._settings.noise_twist
        arrivals = [-math.expm1(-kind.rate * self._interval) for kind in _ROBOT_KINDS]
        drift_std = [kind.drift * share for kind in _ROBOT_KINDS]
        self._states, self._weights = _core.FilterState.interact(
            self._states, self._weights, arrivals, drift_std, _NEGLIGIBLE
        )

    def updated(self, seen: SeenLines, agreement: Agreement) -> BankUpdate | None:
        """Return this after an image, as far as it agrees so well; None if it does not."""
        k = len(seen.rows)
        few, many = max(0, (k - 1) // 3), k - max(2, (k + 1) // 2)
        fits: list[MotionFit | None] = [None] * len(_ROBOT_KINDS)
        if agreement is Agreement.AGREES:
            fits = [self._fit(state, seen, few) for state in self._states]
        elif agreement is Agreement.MOVED:
            fits[-1] = self._fit(self._moved_otherwise(), seen, 0)
        elif many > few:
            fits[0] = self._fit(self._states[0], seen, many)
        return self._weighed(fits) if any(fits) else None

    def _fit(self, state: _core.FilterState, seen: SeenLines, removable: int) -> MotionFit | None:
        """Return a state after an image, without up to so many lines that do not agree with it; None if more do not."""
        gates = _gates(len(seen.rows), self._settings.outlier_gate, self._settings.reversal_cost)
        fit = state.fit(seen.lines, seen.rows, seen.image, seen.covariances, removable, gates, _ITERATIONS)
        return None if fit is None else MotionFit(state, fit)

    def _weighed(self, fits: list[MotionFit | None]) -> BankUpdate:
        """Weigh the kinds of robots by how well they explain an image."""
        costs = [
            math.inf if fit is None else fit.fit.cost - 2.0 * math.log(max(weight, _MIN_WEIGHT))
            for fit, weight in zip(fits, self._weights, strict=True)
        ]
        least = min(costs)
        shares = [math.exp(-0.5 * (cost - least)) for cost in costs]
        total = sum(shares)
        kind = costs.index(least)
        best = fits[kind]
        assert best is not None
        surprise = best.fit.innovation.squared - 2.0 * math.log(max(self._weights[kind], _MIN_WEIGHT))
        states = [best.fit.state if fit is None else fit.fit.state for fit in fits]
        bank = MotionBank(
            states, [max(share / total, _MIN_WEIGHT) for share in shares], self._settings, self._since_update
        )
        return BankUpdate(bank, best, least - 2.0 * math.log(total), surprise)

    def part(self, by_pose: Array, offset: float, std: float) -> MotionBank:
        """Return a part of this, see FilterState.part."""
        return self._with([state.part(by_pose, offset, std) for state in self._states], self._weights)

    def merged(self, other: MotionBank, own_weight: float, other_weight: float) -> MotionBank:
        """Return one that stands for two."""
        share = own_weight / (own_weight + other_weight)
        states, weights = [], []
        for own, state, own_share, other_share in zip(
            self._states, other._states, self._weights, other._weights, strict=True
        ):
            parts = (max(share * own_share, _MIN_WEIGHT), max((1.0 - share) * other_share, _MIN_WEIGHT))
            weights.append(sum(parts))
            states.append(_core.FilterState.mixture([own, state], [each / weights[-1] for each in parts]))
        return self._with(states, [each / sum(weights) for each in weights])

    def _with(self, states: list[_core.FilterState], weights: list[float]) -> MotionBank:
        bank = MotionBank(states, weights, self._settings, self._interval)
        bank._speed, bank._turn_speed, bank._since_update = self._speed, self._turn_speed, self._since_update
        return bank

    def _moved_otherwise(self) -> _core.FilterState:
        """Return the state of a camera that moved about as fast as it was told, but otherwise."""
        seconds = self._since_update
        state = self._states[-1].copy()
        shift, turn = 2.0 * self._speed * seconds, 2.0 * self._turn_speed * seconds
        state.inflate(8.0 * state.covariance + np.diag(_spread(shift, turn) ** 2))
        return state


@dataclass(frozen=True, eq=False)
class BankUpdate:
    """What an image makes of a bank.

    Attributes:
        bank: The bank after it.
        fit: Of the most plausible kind of robot.
        cost: -2 log likelihood of the image.
        surprise: Squared innovation of the fit, and -2 log of how plausible that kind of robot was before.
    """

    bank: MotionBank
    fit: MotionFit
    cost: float
    surprise: float


def _mixture(states: list[_core.FilterState], weights: list[float]) -> _core.FilterState:
    """Return the state that stands for all that count."""
    total = sum(weights)
    chosen = [
        (state, weight / total) for state, weight in zip(states, weights, strict=True) if weight > _NEGLIGIBLE * total
    ]
    if len(chosen) == 1:
        return chosen[0][0].copy()
    return _core.FilterState.mixture(*map(list, zip(*chosen, strict=True)))


def _drift_twist(twist: Array) -> Array:
    """Return what the drift makes of a twist, shape (6, 6).

    The drift is a scale of the linear velocity, one of the angular velocity, and a rotation of the camera on the robot
    (three numbers), as angles and shares; the last of its numbers does nothing.
    """
    vx, vy, vz, wx, wy, wz = twist.tolist()
    return np.array(
        (
            (vx, 0.0, 0.0, vz, -vy, 0.0),
            (vy, 0.0, -vz, 0.0, vx, 0.0),
            (vz, 0.0, vy, -vx, 0.0, 0.0),
            (0.0, wx, 0.0, wz, -wy, 0.0),
            (0.0, wy, -wz, 0.0, wx, 0.0),
            (0.0, wz, wy, -wx, 0.0, 0.0),
        )
    )


def _speeds(twist: Array) -> tuple[float, float]:
    """Return how fast a twist moves [m/s], and turns [rad/s]."""
    vx, vy, vz, wx, wy, wz = twist.tolist()
    return math.sqrt(vx * vx + vy * vy + vz * vz), math.sqrt(wx * wx + wy * wy + wz * wz)


def _spread(linear: float, angular: float) -> Array:
    return np.array((linear, linear, linear, angular, angular, angular))


@lru_cache(maxsize=256)
def _gates(lines: int, outlier_gate: float, reversal_cost: float) -> _core.FitGates:
    """Return when a state agrees with so many lines."""
    return _core.FitGates(outlier_gate**2, [quantile(2 * count) for count in range(lines + 1)], reversal_cost)


@lru_cache(maxsize=256)
def quantile(freedom: int, probability: float = _FALSE_ALARM) -> float:
    """Return what a sum of squares exceeds by chance with a probability, that of a false alarm by default."""
    return float(chi2.isf(probability, max(1, freedom)))
