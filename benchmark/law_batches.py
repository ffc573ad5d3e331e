# SPDX-License-Identifier: Apache-2.0
"""Servo runs of many tasks at once, by every control law: an implementation of its own, not the package's.

Scenes are filled up with lines of weight zero, so that one array holds all. Projection, L, inverses, guard, saturation
and motion are written anew from docs/conventions.md and docs/controller.md, so that the study does not rest on the code
it judges; the planned ways of detour are the package's, which is what is judged there.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.batch_simulation import Batch
from benchmark.law_paths import Ways
from benchmark.law_scale import Scales
from benchmark.law_variants import Law, feedback, guard, saturate
from benchmark.servo_tasks import in_camera, mean_rotations, seen

TIME_STEP = 0.04  # [s]
ARRIVED, TURNED = 1e-3, np.radians(0.1)  # [m], [rad]


@dataclass(eq=False)
class BatchOutcome:
    """What became of k runs, each until it arrived (if it was to stop there) or time was up.

    Attributes:
        arrived: Within ARRIVED and TURNED of the target, shape (k,).
        seconds: How long the run took [s].
        peak, peak_turn: Largest |v| [m/s] and |omega| [rad/s] that were commanded.
        length: Of the path gone [m].
        farthest: Largest distance to the target, in that of the start.
        kept: Least distance to a locus of the true lines, as a share of what a path is to keep there (docs/laws.md).
        final_distance, final_turn: Root mean square over the last seconds [m], [rad].
        plans: How many ways were planned, shape (k,).
        position, twist: If traces are kept, true centre and commanded twist at each step, shapes (k, 3) and (k, 6).
    """

    arrived: np.ndarray
    seconds: np.ndarray
    peak: np.ndarray
    peak_turn: np.ndarray
    length: np.ndarray
    farthest: np.ndarray
    kept: np.ndarray
    final_distance: np.ndarray
    final_turn: np.ndarray
    plans: np.ndarray
    position: list[np.ndarray] = field(default_factory=list)
    twist: list[np.ndarray] = field(default_factory=list)


def run(
    batch: Batch,
    law: Law,
    seconds: float,
    noise: float = 0.0,
    seed: int = 0,
    last: float = 5.0,
    stop: bool = True,
    keep: bool = False,
) -> BatchOutcome:
    """Run all tasks.

    Args:
        batch: The tasks.
        law: By which law.
        seconds: For how long at most.
        noise: Standard deviation of Gaussian noise on all Plücker coordinates (u, l) of each line in the camera frame.
        seed: Of the noise; the same for all laws.
        last: Over how long the final errors are averaged [s].
        stop: Whether a run ends when it arrives.
        keep: Whether to keep the traces.
    """
    k, steps = len(batch.t), round(seconds / TIME_STEP)
    R, t = batch.R.copy(), batch.t.copy()
    true_lines, map_lines = (batch.direction, batch.moment), (batch.map_direction, batch.map_moment)
    depth = batch.depth[:, np.newaxis, np.newaxis]
    target_lines = in_camera(*map_lines, batch.R_target, batch.t_target)
    planned_target = batch.R_target, batch.t_target
    if batch.taught:
        u, m = in_camera(*true_lines, batch.R_target, batch.t_target)
        target_lines = u, m * depth
        planned_target = _placed(*map_lines, batch.weight, *target_lines)
    target_image, target_L = seen(*target_lines, batch.weight)
    target_values = np.linalg.svd(target_L.reshape(k, -1, 6), compute_uv=False)
    reference = np.maximum(target_values[:, -1], 1e-6 * target_values[:, 0])
    first = np.linalg.norm(t - batch.t_target, axis=1)
    peak, peak_turn, length, farthest = np.zeros((4, k))
    kept = np.full(k, np.inf)
    arrived, time_taken = np.zeros(k, dtype=bool), np.full(k, seconds)
    paths = Ways(batch, *planned_target, *target_lines) if law.follows else None
    scales = Scales(batch, law.max_scale_error) if law.follows and not batch.taught else None
    squares, turn_squares, counted = np.zeros(k), np.zeros(k), 0
    rng = np.random.default_rng(seed)
    alive = np.ones(k, dtype=bool)
    result = BatchOutcome(
        arrived, time_taken, peak, peak_turn, length, farthest, kept, squares, turn_squares, np.zeros(k)
    )
    for step in range(steps):
        distance = np.linalg.norm(t - batch.t_target, axis=1)
        turn = _angle(batch.R_target, R)
        np.maximum(farthest, distance / np.maximum(first, 1e-9), out=farthest)
        np.minimum(kept, batch.kept(t), out=kept)
        if stop:
            there = alive & (distance <= ARRIVED) & (turn <= TURNED)
            arrived |= there
            time_taken[there] = step * TIME_STEP
            alive &= ~there
        elif step >= steps - round(last / TIME_STEP):
            squares += distance**2
            turn_squares += turn**2
            counted += 1
        u, m = in_camera(*true_lines, R, t)
        m = m * depth
        if noise > 0.0:
            u, m = noisy(u, m, rng.normal(scale=noise, size=(2, *u.shape)))
        rows = np.flatnonzero(alive)
        if len(rows) == 0:
            break
        image, L = seen(u[rows], m[rows], batch.weight[rows])
        target, L_at_target = target_image[rows], target_L[rows]
        feedforward, away = np.zeros((2, len(rows), 6))
        if paths is not None or law.inverse == "guarded":
            known = tuple(each[rows] for each in (*map_lines, batch.weight))
            here = _placed(*known, u[rows], m[rows])
            if scales is not None:
                here = _placed(*known, u[rows], m[rows] / scales.factors(rows, here[0], u[rows], m[rows]))
        if paths is not None:
            target, L_at_target, feedforward, R_asked, t_asked = paths.reference(rows, *here, image)
            away = _displacement(R_asked, t_asked, *here)
        error = ((image - target) * batch.weight[rows, :, np.newaxis]).reshape(len(rows), -1)
        inverted = L_at_target if law.interaction == "target" else L
        if law.interaction == "mean":
            inverted = 0.5 * (L + _turned(L_at_target, target, image))
        parts = np.linalg.svd(inverted.reshape(len(rows), -1, 6), full_matrices=False)
        twist = feedforward + feedback(law, parts, error, reference[rows], away)
        if law.inverse == "guarded":
            point, axis = (each[rows] for each in batch.known_loci)
            loci = point - here[1][:, np.newaxis], axis
            velocity = np.einsum("kij,kj->ki", here[0], twist[:, :3])
            # Whatever is inverted, the present L says how near a singularity is.
            smallest = np.linalg.svd(L.reshape(len(rows), -1, 6), compute_uv=False)[:, -1]
            twist *= guard(law, *loci, velocity, smallest / reference[rows])[:, np.newaxis]
        twist, factor = saturate(twist, law.limits)
        if paths is not None:
            paths.advance(rows, TIME_STEP * factor)
        speed = np.linalg.norm(twist[:, :3], axis=1)
        peak[rows] = np.maximum(peak[rows], speed)
        peak_turn[rows] = np.maximum(peak_turn[rows], np.linalg.norm(twist[:, 3:], axis=1))
        length[rows] += speed * TIME_STEP
        if keep:
            result.position.append(t.copy())
            result.twist.append(np.zeros((k, 6)))
            result.twist[-1][rows] = twist
        v, omega = _carried_out(batch, rows, twist * TIME_STEP)
        t[rows] += np.einsum("kij,kj->ki", R[rows], mean_rotations(omega, v))
        R[rows] = R[rows] @ Rotation.from_rotvec(omega).as_matrix()
    if paths is not None:
        result.plans = paths.plans
    final, final_turn = np.linalg.norm(t - batch.t_target, axis=1), _angle(batch.R_target, R)
    result.final_distance = np.sqrt(squares / counted) if counted else final
    result.final_turn = np.sqrt(turn_squares / counted) if counted else final_turn
    return result


def noisy(u: np.ndarray, m: np.ndarray, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lines, shapes (..., 3), with noise (2, ..., 3) on their coordinates, brought back to lines."""
    u = u + drawn[0]
    u /= np.linalg.norm(u, axis=-1, keepdims=True)
    m = m + drawn[1]
    return u, m - np.einsum("...i,...i->...", m, u)[..., np.newaxis] * u


def _carried_out(batch: Batch, rows: np.ndarray, twist: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return v and omega of the true cameras for twists (k, 6) of the frames that they are told to move."""
    v, omega = batch.speed[rows, np.newaxis] * twist[:, :3], batch.speed[rows, np.newaxis] * twist[:, 3:]
    v = v + np.cross(omega, batch.t_told[rows])
    back = batch.R_told[rows]
    return np.einsum("kji,kj->ki", back, v), np.einsum("kji,kj->ki", back, omega)


def _turned(L: np.ndarray, image: np.ndarray, to: np.ndarray) -> np.ndarray:
    """Return L of image lines with its rows turned, so that angles change where those of other image lines do."""
    across, across_to = (np.stack([-each[..., 1], each[..., 0]], axis=-1) for each in (image, to))
    turned = L.copy()
    turned[:, :, :2] = np.einsum("kni,knj,knjc->knic", across_to, across, L[:, :, :2])
    return turned


def _placed(
    scene_u: np.ndarray, scene_m: np.ndarray, weight: np.ndarray, u: np.ndarray, m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return R and t of the cameras that see 3-D lines (u, m) of a scene: Kabsch's rotation, then least squares."""
    left, _, right = np.linalg.svd(np.einsum("kn,kni,knj->kij", weight, scene_u, u))
    left[:, :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, np.newaxis]
    R = left @ right
    arm = scene_m - m @ np.swapaxes(R, 1, 2)
    outer = np.einsum("kn,kni,knj->kij", weight, scene_u, scene_u)
    normal = weight.sum(axis=1)[:, np.newaxis, np.newaxis] * np.eye(3) - outer
    pull = np.einsum("kn,kni->ki", weight, np.cross(scene_u, arm))
    return R, np.linalg.solve(normal, pull[..., np.newaxis])[..., 0]


def _displacement(R_asked: np.ndarray, t_asked: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the twists that lead from poses asked for to those of the cameras in unit time, in the camera frames."""
    shift = np.einsum("kji,kj->ki", R, t - t_asked)
    return np.concatenate([shift, Rotation.from_matrix(np.swapaxes(R_asked, 1, 2) @ R).as_rotvec()], axis=1)


def _angle(R: np.ndarray, other: np.ndarray) -> np.ndarray:
    chord = np.linalg.norm((R - other).reshape(len(R), 9), axis=1) / np.sqrt(8.0)
    return 2.0 * np.arcsin(np.minimum(chord, 1.0))
