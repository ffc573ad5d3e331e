"""Servo runs of many tasks at once, by every control law: an implementation of its own, not the package's.

Scenes are filled up with lines of weight zero, so that one array holds all. Projection, L, inverses, guard, saturation
and motion are written anew from docs/conventions.md and docs/controller.md, so that the study does not rest on the code
it judges; the planned ways of detour are the package's, which is what is judged there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.law_list import Law, feedback, guard, saturated
from benchmark.servo_tasks import Task, mean_rotations, seen
from plsing_ros.geometry import Pose
from plsing_ros.servoing.ways.camera_path import CameraPath
from plsing_ros.servoing.ways.detour import DetourOptions, plan_way
from plsing_ros.singularities import SingularSet

TIME_STEP = 0.04  # [s]
ARRIVED, TURNED = 1e-3, np.radians(0.1)  # [m], [rad]
# A camera farther from its way than this is given a new one [m].
REPLAN_DISTANCE = 0.3
_FAR = 1e6  # [m]


@dataclass(eq=False)
class Batch:
    """Tasks as arrays: k tasks, room for m lines each.

    Attributes:
        direction, moment: Of the lines in the scene frame, shape (k, m, 3).
        weight: 1 for lines, 0 for room left, shape (k, m).
        R, t: Of T_scene_camera at the start, shapes (k, 3, 3) and (k, 3).
        R_goal, t_goal: At the goal, likewise.
        locus_point, locus_direction: Transversals and points (direction zero), shape (k, p, 3); far away where fewer.
        sets: Singular sets, for planning; empty where no law plans.
    """

    direction: np.ndarray
    moment: np.ndarray
    weight: np.ndarray
    R: np.ndarray
    t: np.ndarray
    R_goal: np.ndarray
    t_goal: np.ndarray
    locus_point: np.ndarray
    locus_direction: np.ndarray
    sets: tuple[SingularSet, ...] = ()

    @classmethod
    def of(cls, tasks: Sequence[Task], sets: Sequence[SingularSet]) -> Batch:
        """Collect tasks and the singular sets of their scenes."""
        loci = [_thin_loci(found) for found in sets]
        k, m = len(tasks), max(len(task.lines) for task in tasks)
        p = max(1, *(len(point) for point, _ in loci))
        direction, moment, weight = np.zeros((k, m, 3)), np.zeros((k, m, 3)), np.zeros((k, m))
        direction[:, :, 0], moment[:, :, 1] = 1.0, 1.0
        locus_point, locus_direction = np.full((k, p, 3), _FAR), np.zeros((k, p, 3))
        for i, task in enumerate(tasks):
            n, q = len(task.lines), len(loci[i][0])
            direction[i, :n], moment[i, :n], weight[i, :n] = task.lines.direction, task.lines.moment, 1.0
            locus_point[i, :q], locus_direction[i, :q] = loci[i]
        poses = [
            np.array([getattr(getattr(task, end), what) for task in tasks])
            for end in ("start", "goal")
            for what in ("rotation", "translation")
        ]
        return cls(direction, moment, weight, *poses, locus_point, locus_direction, tuple(sets))


@dataclass(eq=False)
class Outcome:
    """What became of k runs, each until it arrived (without noise) or time was up.

    Attributes:
        arrived: Within ARRIVED and TURNED of the goal, shape (k,).
        seconds: How long the run took [s].
        peak, peak_turn: Largest |v| [m/s] and |omega| [rad/s].
        length: Of the way gone [m].
        farthest: Largest distance to the goal, in that of the start.
        final_distance, final_turn: Root mean square over the last seconds [m], [rad].
        distance: If traces are kept, to the goal at each step, shape (steps, k) [m]; also position and twist.
    """

    arrived: np.ndarray
    seconds: np.ndarray
    peak: np.ndarray
    peak_turn: np.ndarray
    length: np.ndarray
    farthest: np.ndarray
    final_distance: np.ndarray
    final_turn: np.ndarray
    position: list[np.ndarray] = field(default_factory=list)
    twist: list[np.ndarray] = field(default_factory=list)


def run(
    batch: Batch,
    law: Law,
    seconds: float,
    noise: float = 0.0,
    seed: int = 0,
    last: float = 5.0,
    keep: bool = False,
    quiet: int = 0,
    progress: Callable[[], object] = lambda: None,
) -> Outcome:
    """Run all tasks.

    Args:
        batch: The tasks.
        law: By which law.
        seconds: For how long at most.
        noise: Standard deviation of Gaussian noise on all Plücker coordinates (u, l) of each line in the camera frame.
        seed: Of the noise; the same for all laws.
        last: Over how long the final errors are averaged [s].
        keep: Whether to keep the traces.
        quiet: How many steps at the start have no noise.
        progress: Called at each step.
    """
    k, steps = len(batch.t), round(seconds / TIME_STEP)
    R, t = batch.R.copy(), batch.t.copy()
    goal_image, goal_L = seen(*_in_camera(batch, batch.R_goal, batch.t_goal), batch.weight)
    goal_values = np.linalg.svd(goal_L.reshape(k, -1, 6), compute_uv=False)
    reference = np.maximum(goal_values[:, -1], 1e-6 * goal_values[:, 0])
    first = np.linalg.norm(t - batch.t_goal, axis=1)
    peak, peak_turn, length, farthest = np.zeros((4, k))
    arrived, time_taken = np.zeros(k, dtype=bool), np.full(k, seconds)
    ways = _Ways(batch) if law.follows else None
    squares, turn_squares, counted = np.zeros(k), np.zeros(k), 0
    rng = np.random.default_rng(seed)
    alive = np.ones(k, dtype=bool)
    result = Outcome(arrived, time_taken, peak, peak_turn, length, farthest, squares, turn_squares)
    for step in range(steps):
        distance = np.linalg.norm(t - batch.t_goal, axis=1)
        turn = _angle(batch.R_goal, R)
        np.maximum(farthest, distance / np.maximum(first, 1e-9), out=farthest)
        if noise == 0.0:
            there = alive & (distance <= ARRIVED) & (turn <= TURNED)
            arrived |= there
            time_taken[there] = step * TIME_STEP
            alive &= ~there
        elif step >= steps - round(last / TIME_STEP):
            squares += distance**2
            turn_squares += turn**2
            counted += 1
        u, m = _in_camera(batch, R, t)
        if noise > 0.0:
            u, m = noisy(u, m, rng.normal(scale=noise if step >= quiet else 0.0, size=(2, *u.shape)))
        rows = np.flatnonzero(alive)
        if len(rows) == 0:
            break
        image, L = seen(u[rows], m[rows], batch.weight[rows])
        desired, desired_L = goal_image[rows], goal_L[rows]
        feedforward, away = np.zeros((2, len(rows), 6))
        if ways is not None:
            desired, desired_L, feedforward, R_asked, t_asked = ways.reference(rows, R, t)
            away = _displacement(R_asked, t_asked, *_placed(batch, rows, u[rows], m[rows]))
        error = ((image - desired) * batch.weight[rows, :, np.newaxis]).reshape(len(rows), -1)
        inverted = desired_L if law.interaction == "desired" else L
        if law.interaction == "mean":
            inverted = 0.5 * (L + _turned(desired_L, desired, image))
        parts = np.linalg.svd(inverted.reshape(len(rows), -1, 6), full_matrices=False)
        twist = feedforward + feedback(law, parts, error, reference[rows], away)
        if law.inverse == "guarded":
            loci = batch.locus_point[rows] - t[rows, np.newaxis], batch.locus_direction[rows]
            velocity = np.einsum("kij,kj->ki", R[rows], twist[:, :3])
            # Whatever is inverted, the present L says how near a singularity is.
            smallest = np.linalg.svd(L.reshape(len(rows), -1, 6), compute_uv=False)[:, -1]
            twist *= guard(law, *loci, velocity, smallest / reference[rows])[:, np.newaxis]
        twist, factor = saturated(twist, law.limits)
        if ways is not None:
            ways.advance(rows, TIME_STEP * factor)
        speed = np.linalg.norm(twist[:, :3], axis=1)
        peak[rows] = np.maximum(peak[rows], speed)
        peak_turn[rows] = np.maximum(peak_turn[rows], np.linalg.norm(twist[:, 3:], axis=1))
        length[rows] += speed * TIME_STEP
        if keep:
            result.position.append(t.copy())
            result.twist.append(np.zeros((k, 6)))
            result.twist[-1][rows] = twist
        moved = mean_rotations(twist[:, 3:] * TIME_STEP, twist[:, :3] * TIME_STEP)
        t[rows] += np.einsum("kij,kj->ki", R[rows], moved)
        R[rows] = R[rows] @ Rotation.from_rotvec(twist[:, 3:] * TIME_STEP).as_matrix()
        progress()
    final, final_turn = np.linalg.norm(t - batch.t_goal, axis=1), _angle(batch.R_goal, R)
    result.final_distance = np.sqrt(squares / counted) if counted else final
    result.final_turn = np.sqrt(turn_squares / counted) if counted else final_turn
    return result


def noisy(u: np.ndarray, m: np.ndarray, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lines, shapes (..., 3), with noise (2, ..., 3) on their coordinates, brought back to lines."""
    u = u + drawn[0]
    u /= np.linalg.norm(u, axis=-1, keepdims=True)
    m = m + drawn[1]
    return u, m - np.einsum("...i,...i->...", m, u)[..., np.newaxis] * u


def _in_camera(batch: Batch, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return batch.direction @ R, (batch.moment - np.cross(t[:, np.newaxis], batch.direction)) @ R


def _turned(L: np.ndarray, image: np.ndarray, to: np.ndarray) -> np.ndarray:
    """Return L of image lines with its rows turned, so that angles change where those of other image lines do."""
    across, across_to = (np.stack([-each[..., 1], each[..., 0]], axis=-1) for each in (image, to))
    turned = L.copy()
    turned[:, :, :2] = np.einsum("kni,knj,knjc->knic", across_to, across, L[:, :, :2])
    return turned


def _placed(batch: Batch, rows: np.ndarray, u: np.ndarray, m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return R and t of the cameras that see 3-D lines (u, m): Kabsch's rotation, then least squares."""
    scene_u, weight = batch.direction[rows], batch.weight[rows]
    left, _, right = np.linalg.svd(np.einsum("kn,kni,knj->kij", weight, scene_u, u))
    left[:, :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, np.newaxis]
    R = left @ right
    arm = batch.moment[rows] - m @ np.swapaxes(R, 1, 2)
    outer = np.einsum("kn,kni,knj->kij", weight, scene_u, scene_u)
    normal = weight.sum(axis=1)[:, np.newaxis, np.newaxis] * np.eye(3) - outer
    pull = np.einsum("kn,kni->ki", weight, np.cross(scene_u, arm))
    return R, np.linalg.solve(normal, pull[..., np.newaxis])[..., 0]


def _displacement(R_asked: np.ndarray, t_asked: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the twists that lead from poses asked for to those of the cameras in unit time, in the camera frames."""
    shift = np.einsum("kji,kj->ki", R, t - t_asked)
    return np.concatenate([shift, Rotation.from_matrix(np.swapaxes(R_asked, 1, 2) @ R).as_rotvec()], axis=1)


class _Ways:
    """Ways followed by a batch, planned anew for a camera that is elsewhere."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        k = len(batch.t)
        self._paths = [self._planned(row, batch.R[row], batch.t[row]) for row in range(k)]
        self._time, self._cycle = np.zeros(k), np.zeros(k)
        self._expected = batch.t.copy()

    def _planned(self, row: int, R: np.ndarray, t: np.ndarray) -> CameraPath | None:
        goal = Pose(self._batch.R_goal[row], self._batch.t_goal[row])
        return plan_way(self._batch.sets[row], Pose(R, t), goal, DetourOptions()).path

    def advance(self, rows: np.ndarray, seconds: np.ndarray) -> None:
        self._time[rows] += seconds
        self._cycle[rows] = seconds

    def reference(self, rows: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return desired image lines, L, feed-forward, R and t; where a plan is refused, those of standing still."""
        batch = self._batch
        for row in rows[np.linalg.norm((t - self._expected)[rows], axis=1) > REPLAN_DISTANCE]:
            self._paths[row] = self._planned(row, R[row], t[row])
            self._time[row] = self._cycle[row] = 0.0
            self._expected[row] = t[row]
        asked_R, asked_t, twists = R[rows].copy(), t[rows].copy(), np.zeros((len(rows), 6))
        for i, row in enumerate(rows):
            path = self._paths[row]
            if path is not None:
                pose = path.pose(self._time[row])
                asked_R[i], asked_t[i] = pose.rotation, pose.translation
                twists[i] = path.twist(self._time[row] + 0.5 * self._cycle[row])
                self._expected[row] = pose.translation
        u = batch.direction[rows] @ asked_R
        m = (batch.moment[rows] - np.cross(asked_t[:, np.newaxis], batch.direction[rows])) @ asked_R
        return *seen(u, m, batch.weight[rows]), twists, asked_R, asked_t


def _thin_loci(found: SingularSet) -> tuple[np.ndarray, np.ndarray]:
    """Return points and directions of transversals and isolated points, the direction of a point being zero."""
    points = [transversal.point for transversal in found.transversals] + list(found.isolated_points)
    directions = [transversal.direction for transversal in found.transversals]
    return np.reshape(points, (-1, 3)), np.vstack(
        [np.reshape(directions, (-1, 3)), np.zeros_like(found.isolated_points)]
    )


def _angle(R: np.ndarray, other: np.ndarray) -> np.ndarray:
    chord = np.linalg.norm((R - other).reshape(len(R), 9), axis=1) / np.sqrt(8.0)
    return 2.0 * np.arcsin(np.minimum(chord, 1.0))
