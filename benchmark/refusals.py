# SPDX-License-Identifier: Apache-2.0
"""How often consistent frames are refused, and contradictory ones are not: frames of the conditions of the laws.

python3 -m benchmark refusals
python3 -m benchmark refusals --quick
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.servo_conditions import (
    CONDITIONS,
    FOCAL_LENGTH,
    Condition,
    DisturbedCamera,
    SegmentTask,
    draw_task,
    image_lines,
    line_covariances,
    view_of,
)
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.features import LineObservation
from plsing_ros.features.consistency import ConsistencyCheck, Tolerances
from plsing_ros.geometry import LineSet, Pose

SEED = 5
_FRAMES_PER_TASK = 40
# What the tolerances are for: a map with ends of segments so far off, each coordinate, and seen from no nearer [m].
_MAP_DEVIATION, _NEAREST = 0.005, 0.1
# Image lines that are exchanged contradict if they are so many standard deviations apart.
_CLEAR = 5.0
_ROWS = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def main(quick: bool = False) -> None:
    """Print both tables."""
    consistent(100 if quick else 2500)
    contradictory(40 if quick else 800)


def consistent(tasks: int) -> None:
    """Print how many frames of runs from start to target are refused."""
    print("| condition | frames | refused | us a frame |\n|---|---|---|---|")
    for condition in CONDITIONS.values():
        rng = np.random.default_rng([SEED, 1])
        frames = refused = 0
        spent = 0.0
        for number in range(tasks):
            task = draw_task(rng, condition, number % 3 != 2)
            camera, check = DisturbedCamera(task, condition, rng), ConsistencyCheck(task.map)
            for share in rng.uniform(-0.1, 1.1, _FRAMES_PER_TASK):
                frame = camera.frame(_between(task, share))
                before = time.perf_counter()
                refused += check.contradiction(frame.observation, frame.T_world_camera) is not None
                spent += time.perf_counter() - before
                frames += 1
        print(f"| {condition.name} | {frames} | {refused} | {1e6 * spent / frames:.0f} |", flush=True)


def contradictory(tasks: int) -> None:
    """Print how many contradictory frames pass, and how many of these are not harmless.

    Harmless is a frame whose twists, by every law that is tried, differ from those of the right frame by no more than
    lambda times the tolerances of a pose: as if the camera were known as well as it has to be.
    """
    cases = (("nominal", True, tasks), ("lab", False, tasks), ("nominal", False, tasks))
    for name, known, count in cases:
        condition, rng = CONDITIONS[name], np.random.default_rng([SEED, 2])
        tried, passed, harmful = Counter[str](), Counter[str](), Counter[str]()
        for number in range(count):
            task = draw_task(rng, condition, number % 3 != 2)
            camera, check = DisturbedCamera(task, condition, rng), ConsistencyCheck(task.map)
            frame = camera.frame(task.start)
            right = frame.observation if known else replace(frame.observation, covariances=None)
            alike = _exchangeable(task, condition, right)
            for kind, observation, pose in spoilt(right, frame.T_world_camera, rng, alike):
                passes = check.contradiction(observation, pose) is None
                tried[kind] += 1
                passed[kind] += passes
                if passes:
                    harmful[kind] += _leads_astray(task, right, observation)
        print(f"\n{name}, {'with' if known else 'without'} covariances")
        print("\n| kind | frames | not noticed | of these, not harmless |\n|---|---|---|---|")
        for kind, frames in tried.items():
            print(f"| {kind} | {frames} | {passed[kind]} | {harmful[kind]} |")
        print(f"| all | {tried.total()} | {passed.total()} | {harmful.total()} |", flush=True)


def _exchangeable(task: SegmentTask, condition: Condition, right: LineObservation) -> np.ndarray:
    """Return which usable image lines, if they are exchanged, contradict: shape (n, n).

    Those that are farther from each other, in angle and offset, than five standard deviations of what noise of the
    condition and a map that is wrong by what the tolerances are for (docs/refusals.md) may do to their difference.
    """
    points, _ = view_of(task.ends, task.start)
    depth = ((task.ends - task.start.translation) @ task.start.rotation)[:, :, 2].min(axis=1)
    deviation = np.hypot(condition.pixels / FOCAL_LENGTH, _MAP_DEVIATION / np.maximum(depth, _NEAREST))
    unit = line_covariances(points, 1.0)
    rows = [task.map.ids.index(i) for i in right.usable_ids]
    image = image_lines(points)[rows]
    own = (unit * np.square(deviation)[:, np.newaxis])[rows]
    x, y, z = image.T
    turn = np.arctan2(np.outer(x, y) - np.outer(y, x), np.outer(x, x) + np.outer(y, y))
    apart = np.stack([turn, z - z[:, np.newaxis]], axis=-1)
    a, b, c = np.moveaxis(own[:, np.newaxis] + own, -1, 0)
    square = (c * apart[..., 0] ** 2 - 2.0 * b * apart[..., 0] * apart[..., 1] + a * apart[..., 1] ** 2) / (
        a * c - b**2
    )
    clear: np.ndarray = square > _CLEAR**2
    return clear


def _leads_astray(task: SegmentTask, right: LineObservation, wrong: LineObservation) -> bool:
    """Return whether a law moves by a wrong frame farther off than by a pose within tolerance."""
    tolerances, there = Tolerances(), task.map.transformed(task.target.inverse(), "camera")
    for law in ("position", "fused"):
        twists = []
        for seen in (right, wrong):
            servo = ServoController(task.map, LineObservation.of_lines(there), law=law, gain=task.gain)
            command = servo.step(seen, 0.0)
            twists.append(command.twist if command.mode.moves else np.zeros(6))
        v, omega = np.linalg.norm((twists[1] - twists[0]).reshape(2, 3), axis=1) / task.gain
        if command.mode.moves and (v > tolerances.position or omega > tolerances.rotation):
            return True
    return False


def spoilt(
    right: LineObservation, pose: Pose, rng: np.random.Generator, clear: np.ndarray
) -> Iterator[tuple[str, LineObservation, Pose | None]]:
    """Return contradictory versions of an observation, with the pose that is told along, if one is.

    Args:
        right: Without contradictions.
        pose: That is right.
        rng: Of the choices.
        clear: Which image lines are apart enough to be exchanged, shape (n, n).
    """
    lines, image, ids = right.lines_camera, right.usable_image_lines, right.usable_ids
    covariances = right.usable_covariances
    n = len(ids)
    if lines is None or n < 3:
        return

    def made(
        s: np.ndarray = image,
        space: np.ndarray | float = 1.0,
        named: tuple[int, ...] = ids,
        own: np.ndarray | None = covariances,
    ) -> LineObservation:
        changed = LineSet(lines.direction * space, lines.moment * space, "camera", named)
        return LineObservation(named, s, np.ones(n, dtype=bool), changed, covariances=own)

    one, some, positive = np.ones((n, 1)), rng.choice([-1.0, 1.0], (n, 1)), np.where(image[:, 2:] < 0.0, -1.0, 1.0)
    one[rng.integers(n)] = -1.0
    yield "offsets in pixels", made(image * [1.0, 1.0, rng.uniform(50.0, 1000.0)]), None
    yield "one image line negated", made(image * one), None
    yield "one line reversed", made(image * one, one), None
    if abs(some.sum()) < n:
        yield "some image lines negated", made(image * some), None
        yield "some lines reversed", made(image * some, some), None
    if (positive < 0.0).any():
        yield "positive offsets", made(image * positive), None
        if (positive > 0.0).any():
            yield "positive offsets, 3-D lines as well", made(image * positive, positive), None
    first, second = rng.choice(n, 2, replace=False)
    order = np.arange(n)
    order[[first, second]] = second, first
    yield "two ids exchanged", made(named=tuple(ids[row] for row in order)), None
    pairs = np.argwhere(np.triu(clear, 1))
    if len(pairs):
        order = np.arange(n)
        first, second = rng.choice(pairs)
        order[[first, second]] = second, first
        own = None if covariances is None else covariances[order]
        yield "two image lines exchanged", made(image[order], own=own), None
    mixed = rng.permutation(n)
    if (mixed != np.arange(n)).any():
        yield "ids mixed", made(named=tuple(ids[row] for row in mixed)), None
    factor = rng.choice([0.001, 0.2, 2.0, 5.0, 1000.0])
    scaled = LineSet(lines.direction, lines.moment * factor, "camera", ids)
    yield "wrong scale", LineObservation(ids, image, np.ones(n, dtype=bool), scaled, covariances=covariances), None
    shift = rng.normal(size=3)
    shift *= rng.choice([0.05, 0.2, 1.0, 5.0]) / np.linalg.norm(shift)
    yield "pose off by 0.05 to 5 m", made(), Pose(pose.rotation, pose.translation + shift)
    yield "pose inverted", made(), pose.inverse()
    yield "pose turned by 90 degrees", made(), Pose(pose.rotation @ _ROWS, pose.translation)


def _between(task: SegmentTask, share: float) -> Pose:
    turn = Rotation.from_matrix(task.start.rotation.T @ task.target.rotation).as_rotvec()
    rotation = task.start.rotation @ Rotation.from_rotvec(share * turn).as_matrix()
    return Pose(rotation, (1.0 - share) * task.start.translation + share * task.target.translation)
