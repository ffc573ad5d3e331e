# SPDX-License-Identifier: Apache-2.0
"""Random scenes and servo tasks from a seed, and what the plain law makes of all of them at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from plsing_ros.features import image_depth, project_lines
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.singularities import singular_set

GAIN = 0.1  # lambda [1/s]
TIME_STEP = 0.04  # [s]
STEPS = 400
# A run blows up when the speed exceeds this many times its value at the start.
BLOW_UP = 10.0
_MAX_LINES = 8


@dataclass(frozen=True, eq=False)
class Task:
    """A scene and where a camera goes from and to, as T_world_camera."""

    lines: LineSet
    start: Pose
    target: Pose


@dataclass(frozen=True, eq=False)
class Runs:
    """What the law made of k tasks, frame by frame.

    Attributes:
        rotation: Of T_world_camera, shape (steps, k, 3, 3).
        position: Shape (steps, k, 3) [m].
        twist: Commanded (v, omega) in the optical frame, shape (steps, k, 6).
        frames: How many frames each run has: to the blow-up and with it, or to the end, shape (k,).
        blew_up: Which runs exceeded BLOW_UP times their initial speed, shape (k,).
    """

    rotation: np.ndarray
    position: np.ndarray
    twist: np.ndarray
    frames: np.ndarray
    blew_up: np.ndarray


def random_task(seed: int, number: int) -> Task:
    """Return task `number` of a seed: 4 to 8 lines, a start and a target that look at them, in one of three kinds.

    0: any two poses up to 3 m and 90 degrees apart. 1: all lines meet one more line, and the path leads across it,
    with starts and targets up to 0.8 m beside it. 2: four lines, and the path leads past one of their isolated points
    or transversals.
    """
    generator = np.random.default_rng([seed, number])
    kind = number % 3
    while True:
        n = 4 if kind == 2 else int(generator.integers(4, _MAX_LINES + 1))
        lines = LineSet.from_points_directions(generator.normal(size=(n, 3)), generator.normal(size=(n, 3)))
        center = _unit(generator) * generator.uniform(2.0, 5.0)
        if kind == 1:
            across = _unit(generator)
            through = center + np.outer(generator.normal(scale=1.0, size=n) - center @ across, across)
            lines = LineSet.from_points_directions(through, lines.direction)
        if kind == 2:
            closest = singular_set(lines).distance_arrays(center).closest_point[: -len(lines)]
            near = closest[(np.linalg.norm(closest, axis=1) > 1.5) & (np.linalg.norm(closest, axis=1) < 6.0)]
            if len(near) == 0:
                continue
            center = near[generator.integers(len(near))]
        task = _task(generator, lines, center, 1.5 if kind == 0 else 0.4, 45.0 if kind == 0 else 5.0)
        if task is not None:
            return task


def _task(
    generator: np.random.Generator, lines: LineSet, center: np.ndarray, half_way: float, half_turn: float
) -> Task | None:
    """Return a task whose way leads through a centre, or None if a line is badly seen at its ends."""
    looking = Pose.look_at(center, generator.normal(scale=0.3, size=3), down=_unit(generator))
    shift, turn = _unit(generator) * half_way, _unit(generator) * np.radians(half_turn)
    poses = []
    for sign in (-1.0, 1.0):
        rotation = Rotation.from_rotvec(sign * turn * generator.uniform(0.1, 1.0)).as_matrix()
        poses.append(Pose(looking.rotation @ rotation, center + sign * shift * generator.uniform(0.2, 1.0)))
    if all(_well_seen(lines.transformed(pose.inverse(), "camera")) for pose in poses):
        return Task(lines, poses[0], poses[1])
    return None


def run_all(tasks: list[Task], progress: Callable[[], object] = lambda: None) -> Runs:
    """Run the plain law on all tasks, tau = -lambda pinv(L) (s - s*); scenes are filled up with lines of weight zero.

    This is its own implementation of projection, L and motion, so that the study does not rest on the code it judges.
    """
    k = len(tasks)
    direction, moment, weight = np.zeros((k, _MAX_LINES, 3)), np.zeros((k, _MAX_LINES, 3)), np.zeros((k, _MAX_LINES))
    direction[:, :, 0], moment[:, :, 1] = 1.0, 1.0
    target_image = np.zeros((k, _MAX_LINES, 3))
    for i, task in enumerate(tasks):
        n = len(task.lines)
        direction[i, :n], moment[i, :n], weight[i, :n] = task.lines.direction, task.lines.moment, 1.0
        target_image[i, :n] = project_lines(task.lines.transformed(task.target.inverse(), "camera")).reshape(-1, 3)
    R = np.array([task.start.rotation for task in tasks])
    t = np.array([task.start.translation for task in tasks])
    rotation, position = np.zeros((STEPS, k, 3, 3)), np.zeros((STEPS, k, 3))
    twists, frames = np.zeros((STEPS, k, 6)), np.full(k, STEPS)
    alive, blew_up, first = np.ones(k, dtype=bool), np.zeros(k, dtype=bool), np.zeros(k)
    for step in range(STEPS):
        rows = np.flatnonzero(alive)
        twist = _law(R[rows], t[rows], direction[rows], moment[rows], weight[rows], target_image[rows])
        rotation[step, rows], position[step, rows], twists[step, rows] = R[rows], t[rows], twist
        speed = np.linalg.norm(twist[:, :3], axis=1)
        if step == 0:
            first = speed
        over = speed > BLOW_UP * first[rows]
        blew_up[rows[over]], frames[rows[over]], alive[rows[over]] = True, step + 1, False
        t[rows] += np.einsum("kij,kj->ki", R[rows], mean_rotations(twist[:, 3:] * TIME_STEP, twist[:, :3] * TIME_STEP))
        R[rows] = R[rows] @ Rotation.from_rotvec(twist[:, 3:] * TIME_STEP).as_matrix()
        progress()
    return Runs(rotation, position, twists, frames, blew_up)


def _law(
    R: np.ndarray,
    t: np.ndarray,
    direction: np.ndarray,
    moment: np.ndarray,
    weight: np.ndarray,
    target_image: np.ndarray,
) -> np.ndarray:
    image, matrix = seen(*in_camera(direction, moment, R, t), weight)
    error = (image - target_image) * weight[..., np.newaxis]
    k = len(R)
    twist: np.ndarray = -GAIN * np.einsum(
        "kij,kj->ki", np.linalg.pinv(matrix.reshape(k, -1, 6), rcond=1e-12), error.reshape(k, -1)
    )
    return twist


def in_camera(direction: np.ndarray, moment: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lines (k, m, 3) of a scene in frames of cameras, for R (k, 3, 3) and t (k, 3) of T_world_camera."""
    return direction @ R, (moment - np.cross(t[:, np.newaxis], direction)) @ R


def seen(u: np.ndarray, m: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return image lines (k, m, 3) and L (k, m, 3, 6) of lines (u, m) in the camera frame, zero without weight."""
    depth = np.hypot(m[:, :, 0], m[:, :, 1])[..., np.newaxis]
    image = m / depth
    in_plane = image * (1.0, 1.0, 0.0)
    outer = (np.eye(3) - image[..., :, np.newaxis] * in_plane[..., np.newaxis, :]) / depth[..., np.newaxis]
    return image, outer @ np.concatenate([_skew(u), _skew(m)], axis=-1) * weight[..., np.newaxis, np.newaxis]


def mean_rotations(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return how far (k, 3) a shift goes while the frame turns, both as constant rates over one unit of time."""
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    safe = np.maximum(angle, 1e-4)
    first = np.where(angle < 1e-4, 0.5, (1.0 - np.cos(safe)) / safe**2)
    second = np.where(angle < 1e-4, 1.0 / 6.0, (safe - np.sin(safe)) / safe**3)
    across = np.cross(turn, shift)
    moved: np.ndarray = shift + first * across + second * np.cross(turn, across)
    return moved


def _skew(v: np.ndarray) -> np.ndarray:
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*v.shape[:-1], 3, 3)


def _unit(generator: np.random.Generator) -> np.ndarray:
    vector = generator.normal(size=3)
    unit: np.ndarray = vector / np.linalg.norm(vector)
    return unit


def _well_seen(lines_camera: LineSet) -> bool:
    """No line near the camera or its focal plane, none whose image lies beyond 72 degrees off the axis."""
    depth = image_depth(lines_camera)
    return bool(depth.min() > 0.1 and (np.abs(lines_camera.moment[:, 2]) / depth).max() < 3.0)
