# SPDX-License-Identifier: Apache-2.0
"""What cameras see on paths across singular loci, and what is said about their motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from benchmark.servo_tasks import random_task
from paper.pose_quadrifolium import EXPERIMENTS
from plsing_ros.features import LineObservation, image_depth
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.rotations import rotation_vector
from plsing_ros.singularities import SingularSet, singular_set

RATE = 25.0  # [Hz]
SPEED = 0.1  # [m/s]
NOISE = 1e-3
TWIST_NOISE = 0.05
# Position [m] and orientation [rad] of a start are off by so much, as standard deviations of each component.
STARTS = {
    "known to 1 cm, 0.2 deg": (0.01, np.radians(0.2)),
    "off by 20 cm, 6 deg": (0.2 / 3**0.5, np.radians(6.0) / 3**0.5),
}
_MIN_DEPTH = 0.05
_MAX_FRAMES = 400


@dataclass(frozen=True, eq=False)
class Sequence:
    """What a camera sees on a path, and what is said about its motion.

    Attributes:
        lines: The scene.
        poses: T_world_camera of each frame, the true ones.
        images: Of each frame.
        twists: Given for the time between one frame and the next, one fewer.
        distance: To the nearest locus in each frame [m].
    """

    lines: LineSet
    poses: list[Pose]
    images: list[LineObservation]
    twists: list[np.ndarray]
    distance: np.ndarray


def sequences(seed: int, numbers: range) -> Iterator[tuple[Sequence, np.random.Generator]]:
    """Yield sequences of random scenes, every tenth one of the paper's scene instead, by their numbers from 0 on."""
    number = made = 0
    while made < numbers.stop:
        number += 1
        generator = np.random.default_rng([seed, number, 77])
        if number % 10 == 0:
            experiment = EXPERIMENTS[1 + number // 10 % 4]
            lines, poses = experiment.scene, experiment.poses(_MAX_FRAMES)
        else:
            task = random_task(seed, 3 * (number // 2) + 1 + number % 2)
            lines, poses = task.lines, straight(task.start, task.target)
        if all(image_depth(lines.transformed(pose.inverse(), "camera")).min() > _MIN_DEPTH for pose in poses):
            made += 1
            if made - 1 in numbers:
                yield sequence(lines, poses, generator), generator


def straight(start: Pose, goal: Pose) -> list[Pose]:
    """Return the poses of a camera that goes straight, and turns evenly, from a start to a goal."""
    frames = int(np.linalg.norm(goal.translation - start.translation) / SPEED * RATE) + 2
    share = np.linspace(0.0, 1.0, min(frames, _MAX_FRAMES))
    rotation = Slerp([0.0, 1.0], Rotation.from_matrix([start.rotation, goal.rotation]))(share).as_matrix()
    center = start.translation + share[:, np.newaxis] * (goal.translation - start.translation)
    return [Pose(*each) for each in zip(rotation, center, strict=True)]


def sequence(lines: LineSet, poses: list[Pose], generator: np.random.Generator, wrong: float = TWIST_NOISE) -> Sequence:
    """Return noisy images along a path, and twists that are wrong by a share of their size."""
    images = [noisy_image(lines, pose, generator) for pose in poses]
    true = [motion(*pair) * RATE for pair in pairwise(poses)]
    twists = [each + wrong * size_of(each) * generator.normal(size=6) for each in true]
    centers = np.array([pose.translation for pose in poses])
    return Sequence(lines, poses, images, twists, locus_distance(singular_set(lines), centers))


def locus_distance(singular: SingularSet, centers: np.ndarray) -> np.ndarray:
    """Return how far camera centres (m, 3) are from the nearest locus that is no observed line, shape (m,) [m]."""
    found = [singular.nearest_locus(center) for center in centers]
    return np.array([np.inf if each is None else each.distance for each in found])


def motion(first: Pose, second: Pose) -> np.ndarray:
    """Return the constant twist (v, omega), in the camera's frame, that leads from one pose to another in 1 s."""
    relative = first.inverse() @ second
    turn = rotation_vector(relative.rotation)
    # Inverse of the left Jacobian of SO(3), by its series; turns between frames are small.
    skew = np.cross(np.eye(3), -turn)
    return np.concatenate([(np.eye(3) - 0.5 * skew + skew @ skew / 12.0) @ relative.translation, turn])


def size_of(twist: np.ndarray) -> np.ndarray:
    return np.repeat([np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])], 3)


def noisy_image(
    lines: LineSet, pose: Pose, generator: np.random.Generator, covariances: np.ndarray | None = None
) -> LineObservation:
    """Return the image of a scene with noise on angle and offset of each line, by its covariance if there is one."""
    exact = LineObservation.of_lines(lines.transformed(pose.inverse(), "camera"))
    error = generator.normal(size=(len(lines), 2))
    if covariances is None:
        error *= NOISE
    else:
        matrices = covariances[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        error = np.einsum("nij,nj->ni", np.linalg.cholesky(matrices), error)
    angle = np.arctan2(exact.image_lines[:, 1], exact.image_lines[:, 0]) + error[:, 0]
    image = np.stack([np.cos(angle), np.sin(angle), exact.image_lines[:, 2] + error[:, 1]], axis=1)
    return LineObservation(lines.ids, image, exact.usable, None, covariances=covariances)


def off_start(pose: Pose, size: tuple[float, float], generator: np.random.Generator) -> tuple[Pose, np.ndarray]:
    """Return a pose that is off by a Gaussian error of position [m] and orientation [rad], and its covariance."""
    turn = Rotation.from_rotvec(size[1] * generator.normal(size=3)).as_matrix()
    start = Pose(turn @ pose.rotation, pose.translation + size[0] * generator.normal(size=3))
    return start, np.diag([size[0] ** 2] * 3 + [size[1] ** 2] * 3)


def error_of(true: Pose, pose: Pose) -> np.ndarray:
    """Return position and rotation by which a pose is off, in the world's axes, shape (6,) [m, rad]."""
    return np.concatenate([true.translation - pose.translation, rotation_vector(true.rotation @ pose.rotation.T)])


def squared(error: np.ndarray, covariance: np.ndarray) -> tuple[float, float, float]:
    """Return the normalised squares of an error of a pose: of all, of the position, of the orientation."""
    parts = (slice(0, 6), slice(0, 3), slice(3, 6))
    return tuple(float(error[p] @ np.linalg.solve(covariance[p, p], error[p])) for p in parts)


def linearised(lines: LineSet, pose: Pose, image: LineObservation) -> tuple[np.ndarray, np.ndarray]:
    """Return angle and offset minus the observed ones, and their derivative by the camera's twist, numerically."""

    def residual(at: Pose) -> np.ndarray:
        there = LineObservation.of_lines(lines.transformed(at.inverse(), "camera")).image_lines
        there = there * np.sign(np.einsum("ni,ni->n", there[:, :2], image.image_lines[:, :2]))[:, np.newaxis]
        seen = image.image_lines
        cross = seen[:, 0] * there[:, 1] - seen[:, 1] * there[:, 0]
        angle = np.arctan2(cross, np.einsum("ni,ni->n", seen[:, :2], there[:, :2]))
        return np.stack([angle, there[:, 2] - seen[:, 2]], axis=1).ravel()

    step = 1e-6
    columns = [
        (residual(pose.integrate(step * axis, 1.0)) - residual(pose.integrate(-step * axis, 1.0))) / (2.0 * step)
        for axis in np.eye(6)
    ]
    return residual(pose), np.stack(columns, axis=1)
