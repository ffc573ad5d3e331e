# SPDX-License-Identifier: Apache-2.0
"""What is evaluated: a task with its parameters, and the ways in which reality may differ from them."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.rotations import exponential
from plsing_ros.parameters import ControllerParameters, MonitorParameters, PoseEstimatorParameters
from plsing_ros.parameters.law import LawParameters
from plsing_ros.simulation.segment_camera import SegmentCamera
from plsing_ros.singularities import SingularSet, singular_set

# How runs begin: as the user's do, and so that something goes wrong often enough to test the alerts.
YOURS, HARD = "yours", "hard"
# A locus farther from the target than this, in distances of start and target, is not crossed on purpose.
_FAR_LOCUS = 1.5
_TRIES = 20


@dataclass(frozen=True)
class Setup:
    """A task and its loop.

    Attributes:
        controller: Its scene is the map; its target is the task's.
        monitor: With the law and target of the controller.
        estimator: Where poses and 3-D lines come from.
        start: T_world_camera at the start.
        period: Between two frames [s].
        noise: Standard deviation of the angle [rad] and of the offset of an image line.
        spread: Standard deviation of the start's position, each axis [m].
        turn: Likewise of its orientation [rad].
        seed: Of everything that is drawn.
    """

    controller: ControllerParameters
    monitor: MonitorParameters
    estimator: PoseEstimatorParameters
    start: Pose
    period: float
    noise: float
    spread: float = 0.02
    turn: float = math.radians(1.0)
    seed: int = 0

    @classmethod
    def of_parameters(
        cls,
        controller: ControllerParameters,
        monitor: MonitorParameters,
        estimator: PoseEstimatorParameters,
        start: Pose,
        period: float,
        noise: float | None = None,
        **options: Any,
    ) -> Setup:
        """Return a setup whose nodes know of each other's parameters, as they do when they run.

        Args:
            noise: None: the estimator's noise.image.
            options: spread, turn and seed.
        """
        law = {each.name: getattr(controller, each.name) for each in dataclasses.fields(LawParameters)}
        noise = estimator.noise_image if noise is None else noise
        monitor = dataclasses.replace(monitor, **law, target_known=True)
        estimator = dataclasses.replace(estimator, noise_image=noise)
        return cls(controller, monitor, estimator, start, period, noise, **options)

    def with_law(self, law: str) -> Setup:
        """Return the same with another control law."""
        return dataclasses.replace(
            self,
            controller=dataclasses.replace(self.controller, law=law),
            monitor=dataclasses.replace(self.monitor, law=law),
        )

    @cached_property
    def map(self) -> LineSet:
        """The lines as they are known, with their tolerances."""
        return self.controller.lines()

    @cached_property
    def singular(self) -> SingularSet:
        """The singular set of the map."""
        return singular_set(self.map)

    @property
    def target(self) -> Pose:
        """T_world_camera at the target."""
        return self.controller.target_pose()

    @property
    def distance(self) -> float:
        """From start to target [m]."""
        return float(np.linalg.norm(self.start.translation - self.target.translation))

    def generator(self, *what: int) -> np.random.Generator:
        """Return the generator of one thing that is drawn: the same numbers on every machine."""
        return np.random.default_rng([self.seed, *what])

    def true_lines(self, generator: np.random.Generator) -> LineSet:
        """Return lines as they may be in reality: the map, off by its tolerances."""
        lines = self.map
        shift = lines.position_std[:, np.newaxis] * generator.normal(size=(len(lines), 3))
        turn = lines.direction_std[:, np.newaxis] * generator.normal(size=(len(lines), 3))
        shift -= (shift * lines.direction).sum(axis=1, keepdims=True) * lines.direction
        return LineSet.from_points_directions(
            lines.pivot + shift, lines.direction + cross(turn, lines.direction), lines.frame, lines.ids
        )

    def camera(self, true: LineSet) -> SegmentCamera:
        """Return the camera that sees true lines; ends of segments move with them by less than is seen."""
        monitor = self.monitor
        ends = np.reshape(monitor.line_ends, (-1, 2, 3)) if monitor.line_ends else None
        half_view = (monitor.half_view[0], monitor.half_view[1])
        return SegmentCamera(
            true, ends, self.noise, half_view, monitor.nearest, monitor.shortest_image, self.controller.camera_frame
        )

    def start_of(self, kind: str, generator: np.random.Generator) -> Pose:
        """Return where a run begins: near the task's start, or, of the kind HARD, where it will be difficult."""
        start = self.start if kind == YOURS else self._hard_start(generator)
        turned = start.rotation @ exponential(self.turn * generator.normal(size=3))[0]
        return Pose(turned, start.translation + self.spread * generator.normal(size=3))

    def _hard_start(self, generator: np.random.Generator) -> Pose:
        """Return a start on the other side of a locus, as far away as the task's, or one that is turned about its axis.

        Where no locus is near, a large turn about the optical axis is what laws on the image do worst.
        """
        target, distance, camera = self.target, self.distance, self.camera(self.map)
        for _ in range(_TRIES):
            place = target.translation + distance * generator.normal(size=3) / math.sqrt(3.0)
            near = self.singular.nearest_locus(place)
            if near is None:
                break
            across = near.closest_point - target.translation
            if not 0.05 * distance < np.linalg.norm(across) < _FAR_LOCUS * distance:
                continue
            center = target.translation + across * generator.uniform(1.3, 2.0)
            turned = self._facing(center)
            if np.count_nonzero(camera.visible(turned)) >= min(4, len(self.map)):
                return turned
        angle = generator.choice([-1.0, 1.0]) * generator.uniform(math.radians(90.0), math.radians(150.0))
        return Pose(self.start.rotation @ exponential(np.array([0.0, 0.0, angle]))[0], self.start.translation)

    def _facing(self, center: Array) -> Pose:
        """Return a camera that looks at what the target looks at, the same way up."""
        target = self.target
        depth = max(float((self.map.pivot.mean(axis=0) - target.translation) @ target.rotation[:, 2]), 0.1)
        return Pose.look_at(center, target.translation + depth * target.rotation[:, 2], down=target.rotation[:, 1])
