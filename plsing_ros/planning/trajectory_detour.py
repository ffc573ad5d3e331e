# SPDX-License-Identifier: Apache-2.0
"""A trajectory that a target follows, changed where it comes near singular loci: a path round is put in its place.

Where T* comes nearer than the margin M to a locus, it is left at the last time before, t0, and joined again at the
first time after, t1, at which it is c M away from all of them, or at the farthest place there is. The share of the path
that is done at t is that of the trajectory's own length, l(t0, t) / l(t0, t1), so that velocity jumps at t0 and t1. A
camera that begins elsewhere gets a path to the first place where it can be as soon as the target.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from plsing_ros.arrays import Array
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import Pose
from plsing_ros.planning.camera_path import CameraPath, SpeedLimits
from plsing_ros.planning.clearance import Clearance
from plsing_ros.planning.detour import ROUNDED, DetourOptions, Plan, plan_path
from plsing_ros.singularities import SingularSet

Trajectory = Callable[[float], Pose]

# How far from the loci a trajectory is left and joined again, in margins: each is tried, and the least deviation wins.
_LEAVES = (1.2, 1.6, 2.0, 3.0)
# With which margins a path is planned, in margins: what plan_path keeps where it goes round is a share of its own.
_PLANNED = (1.0, 1.0 / ROUNDED)
# How far a path round may be from where the trajectory is at the same time, in margins.
_MAX_DEVIATION = 5.0
# How finely a trajectory is looked at: samples at least, the largest step between them in margins, and a bound.
_MIN_SAMPLES, _STEP, _FINEST = 201, 0.1, 50
# How many places to join the trajectory are tried for a camera that begins elsewhere.
_JOINS = 8


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of a trajectory that comes too near to a locus, or the approach to its beginning.

    Attributes:
        times: Samples from where the trajectory is left until it is joined again, shape (k,) [s].
        reason: What is done about it and why, in words.
        path: The path gone in the place of the trajectory; None where it is left as it is.
        progress: On that path at each of the times, shape (k,).
        closest: The least distance to a transversal, isolated point or observed line on it [m].
        deviation: The largest distance from where the trajectory is at the same time [m].
    """

    times: Array
    reason: str
    path: CameraPath | None
    progress: Array
    closest: float
    deviation: float


@dataclass(frozen=True, eq=False)
class TrajectoryDetour:
    """A trajectory with paths round in the place of some pieces: continuous, and elsewhere what it was.

    Attributes:
        trajectory: T_world_camera of the unchanged trajectory at a time [s].
        pieces: In the order of time, without overlap.
    """

    trajectory: Trajectory
    pieces: tuple[Piece, ...]

    def pose(self, time: float) -> Pose:
        """Return T_world_camera at a time [s] since the start of the trajectory."""
        for piece in self.pieces:
            if piece.path is not None and piece.times[0] <= time < piece.times[-1]:
                rotation, position = piece.path.poses(np.interp([time], piece.times, piece.progress))
                return Pose(rotation[0], position[0])
        return self.trajectory(time)


def plan_trajectory(
    singular: SingularSet,
    trajectory: Trajectory,
    duration: float,
    options: DetourOptions | None = None,
    start: Pose | None = None,
) -> TrajectoryDetour:
    """Return a known trajectory of a target, changed so that it keeps the margin from all thin loci where it can.

    Where it comes nearer than options.margin to a transversal, isolated point or observed line, it is left before and
    joined again after that, and a path planned by plan_path is gone between; the share of the path that is done grows
    like that of the trajectory's length, so that the speed is everywhere the same multiple of the trajectory's. A piece
    for which no such path is farther from the loci, within options.limits (or the trajectory's own speed, if it is
    faster) and five margins from where the trajectory is at the same time, stays as it is, and its reason says so.
    Surfaces cannot be gone round.

    Args:
        singular: The singular set of the observed lines.
        trajectory: T_world_camera at a time since the start [s].
        duration: How long it takes [s].
        options: How to plan; the margin is kept whole on the trajectory, also where a path has waypoints. An approach
            keeps what plan_path keeps. Where the trajectory is faster than the limits, a path round may be as fast.
        start: Where the camera is at time 0; a path from there, within options.limits, then joins the trajectory as
            soon as it can. None: on the trajectory.

    Raises:
        GeometryError: If the duration is not positive and finite.

    Source: new, docs/laws.md section "Trajectories".
    """
    if not (math.isfinite(duration) and duration > 0.0):
        raise GeometryError(f"the duration of a trajectory is {duration} s; it must be positive and finite")
    options = options or DetourOptions()
    times = _sampled(trajectory, duration, options.margin)
    return TrajectoryDetour(
        trajectory, _Planner(singular, [trajectory(time) for time in times], times, options).pieces(start)
    )


def _sampled(trajectory: Trajectory, duration: float, margin: float) -> Array:
    """Return times between which the trajectory goes on by no more than a share of the margin, as far as one sees."""
    times = np.linspace(0.0, duration, _MIN_SAMPLES, dtype=np.float64)
    steps = np.linalg.norm(np.diff([trajectory(time).translation for time in times], axis=0), axis=1)
    finer = math.ceil(min(float(steps.max()) / (_STEP * margin), _FINEST))
    return np.linspace(0.0, duration, max(finer, 1) * (_MIN_SAMPLES - 1) + 1, dtype=np.float64)


class _Planner:
    """Looks for pieces of a sampled trajectory and plans paths round."""

    def __init__(self, singular: SingularSet, poses: list[Pose], times: Array, options: DetourOptions) -> None:
        # A place where the trajectory goes on is no target, so it may be on a surface.
        options = replace(options, accept_singular_target=True)
        self._singular_set, self._poses, self._times, self._options = singular, poses, times, options
        self._position = np.array([pose.translation for pose in poses])
        self._rotation = Rotation.from_matrix(np.array([pose.rotation for pose in poses]))
        # Without surfaces, which have no path round.
        self._clearance = Clearance(singular, self._position[0], self._position[-1], options.margin, keep_side=False)
        distance = self._clearance.distances(self._position)
        self._nearest, self._part = distance.min(axis=1), distance.argmin(axis=1)

    def pieces(self, start: Pose | None) -> tuple[Piece, ...]:
        pieces, begin = [], 0
        if start is not None and not start.is_close(self._poses[0], 1e-6):
            pieces.append(self._approach(start))
            begin = int(np.searchsorted(self._times, pieces[0].times[-1]))
        while begin < len(self._times) - 1:
            short = np.flatnonzero(self._nearest[begin:] < self._options.margin)
            if len(short) == 0:
                break
            first = begin + int(short[0])
            piece = self._piece(begin, first)
            pieces.append(piece)
            begin = int(np.searchsorted(self._times, piece.times[-1])) + (piece.path is None)
        return tuple(pieces)

    def _piece(self, begin: int, first: int) -> Piece:
        """Return what is done about the samples from `first` on that are too near, not before `begin`."""
        clear = np.flatnonzero(self._nearest[first:] >= self._options.margin)
        last = first + int(clear[0]) - 1 if len(clear) else len(self._times) - 1
        worst = first + int(np.argmin(self._nearest[first : last + 1]))
        closest = float(self._nearest[worst])
        near = f"{self._clearance.names[self._part[worst]]} is {closest:.3g} m away at {self._times[worst]:.4g} s"
        best: Piece | None = None
        problems: list[str] = []
        for leave, planned in itertools.product(_LEAVES, _PLANNED):
            i, j = self._left(begin, first, leave), self._joined(last, leave)
            piece, problem = self._round(i, j, planned * self._options.margin, near)
            if piece is None:
                problems.append(problem)
            elif best is None or self._rank(piece) < self._rank(best):
                best = piece
        if best is not None and best.closest > closest:
            return best
        why = problems[-1] if best is None else "a path round comes no less near"
        times = self._times[first : last + 1]
        return Piece(times, f"{near}: unchanged, as {why}", None, np.zeros(len(times)), closest, 0.0)

    def _rank(self, piece: Piece) -> tuple[float, float]:
        return -min(piece.closest, self._options.margin), piece.deviation

    def _left(self, begin: int, first: int, leave: float) -> int:
        """Return the latest sample before `first` that is so many margins away, or the farthest one."""
        far = np.flatnonzero(self._nearest[begin : first + 1] >= leave * self._options.margin)
        return begin + int(far[-1] if len(far) else np.argmax(self._nearest[begin : first + 1]))

    def _joined(self, last: int, leave: float) -> int:
        """Return the first sample after `last` that is so many margins away, or the farthest one."""
        far = np.flatnonzero(self._nearest[last:] >= leave * self._options.margin)
        return last + int(far[0] if len(far) else np.argmax(self._nearest[last:]))

    def _round(self, i: int, j: int, margin: float, near: str) -> tuple[Piece | None, str]:
        """Return a path round from sample i to j, or None and why there is none within the bounds."""
        own = _speeds(self._position[i : j + 1], self._rotation[i : j + 1], self._times[i : j + 1])
        limits = SpeedLimits(
            max(self._options.limits.linear, own[0]),
            max(self._options.limits.angular, own[1]),
            self._options.limits.ramp,
        )
        options = replace(self._options, margin=margin, limits=limits)
        plan = plan_path(self._singular_set, self._poses[i], self._poses[j], options)
        if plan.path is None:
            return None, plan.reason
        steps = np.linalg.norm(np.diff(self._position[i : j + 1], axis=0), axis=1)
        length = np.concatenate([[0.0], np.cumsum(steps)])
        even = (self._times[i : j + 1] - self._times[i]) / (self._times[j] - self._times[i])
        piece = self._along(plan, i, j, length / length[-1] if length[-1] > 0.0 else even)
        rotation, position = plan.path.poses(piece.progress)
        linear, angular = _speeds(position, Rotation.from_matrix(rotation), piece.times)
        if piece.deviation > _MAX_DEVIATION * self._options.margin:
            return None, f"a path round is up to {piece.deviation:.3g} m from the trajectory"
        if linear > 1.001 * limits.linear or angular > 1.001 * limits.angular:
            return None, f"a path round in the same time takes {linear:.3g} m/s and {angular:.3g} rad/s"
        reason = (
            f"{near}: left at {piece.times[0]:.4g} s and joined again at {piece.times[-1]:.4g} s, "
            f"{piece.closest:.3g} m from all loci and up to {piece.deviation:.3g} m from the trajectory"
        )
        return replace(piece, reason=reason), ""

    def _approach(self, start: Pose) -> Piece:
        """Return the path from where the camera is to the trajectory."""
        clear = self._nearest >= self._options.margin
        j = 0
        for _ in range(_JOINS):
            later = np.flatnonzero(clear[j:])
            if len(later) == 0:
                break
            j += int(later[0])
            plan = plan_path(self._singular_set, start, self._poses[j], self._options)
            if plan.path is not None and plan.path.duration <= self._times[j]:
                progress = np.array([plan.path.progress(time) for time in self._times[: j + 1]])
                return replace(
                    self._along(plan, 0, j, progress), reason=f"joined at {self._times[j]:.4g} s: {plan.reason}"
                )
            earliest = plan.path.duration if plan.path is not None else self._times[j] + self._options.limits.ramp
            j = int(np.searchsorted(self._times, earliest))
            if j >= len(clear):
                break
        apart = float(np.linalg.norm(start.translation - self._position[0]))
        reason = f"it begins elsewhere than the camera, {apart:.3g} m away: no place to join it in time was found"
        return Piece(self._times[:1], reason, None, np.zeros(1), float(self._nearest[0]), 0.0)

    def _along(self, plan: Plan, i: int, j: int, progress: Array) -> Piece:
        assert plan.path is not None
        _, position = plan.path.poses(progress)
        apart = np.linalg.norm(position - self._position[i : j + 1], axis=1)
        closest = float(self._clearance.distances(position).min())
        return Piece(self._times[i : j + 1], plan.reason, plan.path, progress, closest, float(apart.max()))


def _speeds(position: Array, rotation: Rotation, times: Array) -> tuple[float, float]:
    """Return the largest |v| [m/s] and |omega| [rad/s] between samples."""
    step = np.diff(times)
    linear = np.linalg.norm(np.diff(position, axis=0), axis=1) / step
    angular = (rotation[:-1].inv() * rotation[1:]).magnitude() / step
    return float(linear.max()), float(angular.max())
