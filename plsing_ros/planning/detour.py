# SPDX-License-Identifier: Apache-2.0
"""Planning a path for a camera that keeps clear of singularities: straight where that is clear, else round them.

Polygons with one waypoint, then with two, are tried, the shortest first (WaypointSearch). Each is rounded and checked
at poses along it against a share of the distances. Where a line comes near the focal plane, the camera is tilted.
Where the conditioning falls too low, the next attempt avoids the place. After the last attempt the path with the
highest lowest 1/cond is taken, and the reason says so. If nothing is clear, ever lower shares of the margin are tried.
A plan is always the same.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np

from plsing_ros.arrays import Array, BoolArray, IntArray
from plsing_ros.errors import GeometryError
from plsing_ros.features import degenerate_projections
from plsing_ros.geometry import Pose
from plsing_ros.levels import MessageWord
from plsing_ros.planning.camera_path import CameraPath, SpeedLimits, even_progress
from plsing_ros.planning.clearance import Clearance
from plsing_ros.planning.path_conditions import focal_angles, inverse_condition_numbers, lines_in_view
from plsing_ros.planning.waypoints import WaypointSearch
from plsing_ros.singularities import Kind, SingularSet

# Poses at which a path is checked.
_CHECKED = 128
# What is asked of the clearance of a path whose waypoints are rounded, as a share of what was asked of the polygon.
ROUNDED = 0.7
# Tilts tried where a line comes near the focal plane: how far [rad], and in how many directions each.
_TILTS = np.radians([12.0, 25.0, 40.0])
_TILT_DIRECTIONS = 8
# Ever lower shares of what is asked, and how many paths are checked for each.
_SHARES = (1.0, 0.5, 0.25, 0.1)
_ATTEMPTS = 8


class Decision(MessageWord):
    """What the controller would do; values as in plsing_msgs/CheckTarget."""

    STRAIGHT = 0
    DETOUR = 1
    REFUSE = 2


@dataclass(frozen=True)
class DetourOptions:
    """How to plan.

    Attributes:
        margin: Distance to keep from transversals, isolated points, observed lines and surfaces that need not be
            crossed; less near a start or target that is nearer itself [m].
        condition_ratio: Inverse condition number to keep on the path, as a share of the lower one of start and target.
        focal_angle: Angle to keep between the plane of a line's rays and the focal plane, less near the ends [rad].
        max_distance: How far from the target waypoints of a path may be, in distances of the start.
        target_margin: A target nearer to a locus than this is on it [m].
        accept_singular_target: Whether to go to a target on a locus.
        cross_surfaces: Whether to cross surfaces that separate start and target.
        limits: How fast to go.
        half_view: Tangents of half the field of view, horizontal and vertical: a path has at least as many lines in
            view as the end that sees fewer, where there is such a path; 0: not limited.
        risk_margin: By how much the predicted risk of the straight way may be higher than that of a path round
            (straight_way.plan_by_risk); 0: it is not asked for.

    Raises:
        GeometryError: If a number is outside its range.
    """

    margin: float = 0.2
    condition_ratio: float = 0.3
    focal_angle: float = math.radians(5.0)
    max_distance: float = 1.15
    target_margin: float = 1e-3
    accept_singular_target: bool = False
    cross_surfaces: bool = True
    limits: SpeedLimits = field(default_factory=SpeedLimits)
    half_view: tuple[float, float] = (0.0, 0.0)
    risk_margin: float = 0.0

    def __post_init__(self) -> None:
        for name in ("margin", "max_distance"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise GeometryError(f"detour option '{name}' is {getattr(self, name)}; it must be positive and finite")
        for name, most in (("condition_ratio", 1.0), ("focal_angle", math.pi / 2), ("target_margin", math.inf)):
            if not 0.0 <= getattr(self, name) < most:
                raise GeometryError(f"detour option '{name}' is {getattr(self, name)}; allowed: 0 to below {most:.3g}")


@dataclass(frozen=True, eq=False)
class Plan:
    """What to do about a target.

    Attributes:
        decision: What.
        reason: Why, in words.
        path: The path to go; None if refused.
        margin: Of options.margin, what the path keeps [m]; 0 if refused.
        by_pose: Whether the straight path is not followed but the target led to by the pose, across singularities.
    """

    decision: Decision
    reason: str
    path: CameraPath | None = None
    margin: float = 0.0
    by_pose: bool = False


def plan_path(singular: SingularSet, start: Pose, target: Pose, options: DetourOptions | None = None) -> Plan:
    """Return a path from start to target, or why there is none; deterministic, in milliseconds to tenths of a second.

    Args:
        singular: The singular set of the observed lines.
        start: T_world_camera at the start.
        target: T_world_camera at the target.
        options: How to plan.

    Source: new, docs/laws.md section "Detour".
    """
    options = options or DetourOptions()
    plan = _plan(singular, start, target, options)
    if plan.path is not None or not any(options.half_view):
        return plan
    blind = _plan(singular, start, target, replace(options, half_view=(0.0, 0.0)))
    return blind if blind.path is None else replace(blind, reason=f"{blind.reason}; lines leave the view on every path")


def _plan(singular: SingularSet, start: Pose, target: Pose, options: DetourOptions) -> Plan:
    refusal = target_refusal(singular, target, options)
    clearance = Clearance(singular, start.translation, target.translation, options.margin)
    if refusal is None and clearance.crossed and not options.cross_surfaces:
        refusal = f"{_list(clearance.crossed)} separates start and target"
    if refusal is not None:
        return Plan(Decision.REFUSE, refusal)
    straight = _CandidateCheck(singular, start, target, options, clearance, 1.0).path(np.zeros((0, 3)))
    if not straight.problem:
        reason = f"the straight path is clear{_crossing(clearance)}"
        return Plan(Decision.STRAIGHT, reason, straight.path, options.margin)
    # Only when there is no path round that stays on its side of a surface is one looked for that crosses it.
    sides = (True, False) if singular.surfaces and options.cross_surfaces else (True,)
    for keep_side, share in itertools.product(sides, _SHARES):
        near = Clearance(singular, start.translation, target.translation, share * options.margin, keep_side)
        paths = _paths_round(_CandidateCheck(singular, start, target, options, near, share))
        sound = [path for path in paths if path.sound]
        if sound:
            best = min(sound, key=lambda path: (path.problem != "", -path.condition))
            low = f" with {share:.0%} of the margin" if share < 1.0 else ""
            but = f", where {best.problem}" if best.problem else ""
            reason = f"goes round{low}{but}{_crossing(near)}: on the straight path, {straight.problem}"
            return Plan(Decision.DETOUR, reason, best.path, near.margin)
    return Plan(Decision.REFUSE, f"no path round was singular: on the straight path, {straight.problem}")


def _crossing(clearance: Clearance) -> str:
    if not clearance.crossed:
        return ""
    return f", across {_list(clearance.crossed)}, which cannot be gone round"


def target_refusal(singular: SingularSet, target: Pose, options: DetourOptions) -> str | None:
    """Return why a target is not gone to from anywhere, or None."""
    if singular.singular_everywhere:
        return f"the scene is singular for every camera: {singular.description}"
    seen = singular.lines.transformed(target.inverse(), "camera at the target")
    for row in np.flatnonzero(degenerate_projections(seen)):
        return f"line {seen.ids[row]} has no image at the target: it meets the camera centre or is in its focal plane"
    for nearest in singular.distances(target.translation):
        if nearest.distance > options.target_margin or options.accept_singular_target:
            break
        if nearest.kind is not Kind.OBSERVED_LINE:
            return (
                f"the target is on {nearest.name}: {nearest.distance:.2g} m from it, which counts as on it up to "
                f"{options.target_margin:.2g} m"
            )
    return None


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A path that was looked at.

    Attributes:
        path: The path.
        problem: What is wrong with it, in words; empty for nothing.
        sound: Whether nothing is wrong but the conditioning.
        condition: The lowest inverse condition number on it; 0 if not sound.
    """

    path: CameraPath
    problem: str = ""
    sound: bool = False
    condition: float = 0.0


def _paths_round(check: _CandidateCheck) -> list[_Candidate]:
    """Return paths with waypoints, short ones first, until one that passes the check."""
    waypoints = WaypointSearch(check.clearance, check.options.max_distance, check.well_conditioned)
    paths: list[_Candidate] = []
    for _ in range(_ATTEMPTS):
        polygon = waypoints.shortest(check.trouble)
        if polygon is None:
            break
        paths.append(check.path(polygon))
        if not paths[-1].problem:
            break
    return paths


class _CandidateCheck:
    """What is asked of a path for one start and target.

    Attributes:
        trouble: Centres where paths failed, and the distance to keep from each [m].
    """

    def __init__(
        self,
        singular: SingularSet,
        start: Pose,
        target: Pose,
        options: DetourOptions,
        clearance: Clearance,
        share: float,
    ) -> None:
        self.options, self.clearance = options, clearance
        self.trouble: list[tuple[Array, float]] = []
        self._lines, self._start, self._target, self._share = singular.lines, start, target, share
        ends = CameraPath(start, target, options.limits).poses(np.array([0.0, 1.0]))
        self._condition_at_ends = float(inverse_condition_numbers(singular.lines, *ends).min())
        self._angles = focal_angles(singular.lines, *ends)
        self._in_view = int(self._lines_in_view(*ends).min())

    def well_conditioned(self, progress: Array, position: Array) -> BoolArray:
        """Return whether centres (k, 3) are, with the orientation of the turn at that progress, shape (k,)."""
        if len(progress) == 0:
            # SciPy before 1.12 has no empty rotations.
            return np.zeros(0, dtype=bool)
        rotation, _ = CameraPath(self._start, self._target, self.options.limits).poses(progress)
        enough: BoolArray = inverse_condition_numbers(self._lines, rotation, position) >= self._min_condition
        return enough

    @property
    def _min_condition(self) -> float:
        if self.clearance.crossed:
            return 0.0
        return self._share * self.options.condition_ratio * self._condition_at_ends

    def path(self, waypoints: Array) -> _Candidate:
        """Return the path past waypoints (k, 3), with a tilt where one is needed, and what is wrong with it."""
        limits = self.options.limits
        path = CameraPath(self._start, self._target, limits, waypoints)
        # Dense at the ends, where distances to keep may be small.
        progress = 0.5 - 0.5 * np.cos(np.pi * even_progress(_CHECKED))
        rotation, position = path.poses(progress)
        asked = self.clearance.to_keep(position) * (ROUNDED if len(waypoints) else 1.0)
        distance = self.clearance.distances(position)
        worst = np.unravel_index(np.argmin(distance - asked), asked.shape)
        if distance[worst] < asked[worst]:
            self._avoid(position[worst[0]])
            return _Candidate(path, f"{self.clearance.names[worst[1]]} is {distance[worst]:.3g} m away")
        best = _Candidate(path, "")
        for tilt in _tilts():
            if tilt.any():
                path = CameraPath(self._start, self._target, limits, waypoints, tilt)
                rotation, position = path.poses(progress)
            if (fewest := int(self._lines_in_view(rotation, position).min())) < self._in_view:
                best = best if best.problem else _Candidate(path, f"only {fewest} lines are in view")
                continue
            line = self._line_near_focal_plane(progress, rotation, position)
            if line is not None:
                best = best if best.problem else _Candidate(path, f"line {line} comes near the focal plane")
                continue
            condition = inverse_condition_numbers(self._lines, rotation, position)
            worst_pose = int(np.argmin(condition))
            lowest = float(condition[worst_pose])
            if lowest >= self._min_condition:
                return _Candidate(path, "", True, lowest)
            if not best.sound or lowest > best.condition:
                best = _Candidate(path, f"the inverse condition number falls to {lowest:.2g}", True, lowest)
                place = position[worst_pose]
            if not tilt.any():
                break
        if best.sound:
            self._avoid(place)
        return best

    def _lines_in_view(self, rotation: Array, position: Array) -> IntArray:
        """Return how many lines are seen from each pose, shape (k,); all where the view is not limited."""
        half_view = self.options.half_view
        if not all(half_view):
            return np.full(len(position), len(self._lines))
        return lines_in_view(self._lines, rotation, position, half_view)

    def _line_near_focal_plane(self, progress: Array, rotation: Array, position: Array) -> int | None:
        """Return the id of a line whose plane of rays comes too near the focal plane, or None."""
        angle = focal_angles(self._lines, rotation, position)
        share = progress[:, np.newaxis]
        near_ends = np.minimum(0.9 * self._angles[0] + share, 0.9 * self._angles[1] + 1.0 - share)
        short = angle - np.minimum(near_ends, self._share * self.options.focal_angle)
        worst = np.unravel_index(np.argmin(short), short.shape)
        return None if short[worst] >= 0.0 else self._lines.ids[int(worst[1])]

    def _avoid(self, center: Array) -> None:
        ends = np.linalg.norm([center - self._start.translation, center - self._target.translation], axis=1)
        self.trouble.append((center, 0.5 * float(min(self.clearance.margin, *ends))))


def _tilts() -> Array:
    """Return no tilt, then ever larger ones in all directions across the optical axis, shape (k, 3) [rad]."""
    angle = np.arange(_TILT_DIRECTIONS) * (2.0 * np.pi / _TILT_DIRECTIONS)
    paths = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_TILT_DIRECTIONS)])
    return np.concatenate([np.zeros((1, 3)), *(size * paths for size in _TILTS)])


def _list(names: tuple[str, ...]) -> str:
    return " and ".join(names)
