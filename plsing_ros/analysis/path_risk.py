# SPDX-License-Identifier: Apache-2.0
"""What a run would come to from each pose of a path: the probability of harm, and the speed that is demanded."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.monitoring.rollout_setup import FRAME_PERIOD, rollout_task
from plsing_ros.parameters import MonitorParameters
from plsing_ros.planning.rollout import Harm, RolloutLaw, RunState
from plsing_ros.singularities import SingularSet

SAMPLES = 16
HARM_TEXT = {
    Harm.NONE: "arrives",
    Harm.AWAY: "leaves the neighbourhood of its path",
    Harm.FEW_LINES: "loses sight of the lines",
    Harm.LATE: "does not arrive in time",
}


@dataclass(frozen=True, eq=False)
class PathRisk:
    """A row for each pose that a run to the target may start from.

    Attributes:
        law: That is rolled out.
        probability: Share of the samples that come to harm, shape (k,).
        demand: Largest commanded speed over the robot's limit, or over 1.5 times the first one if that is more, as a
            quarter of the samples reaches it, shape (k,).
        harm: The most frequent kind of each.
    """

    law: str
    probability: Array
    demand: Array
    harm: tuple[Harm, ...]


def path_risk(
    singular: SingularSet,
    poses: Sequence[Pose],
    target: Pose,
    parameters: MonitorParameters,
    image_std: float,
    max_angle: float,
    samples: int = SAMPLES,
) -> PathRisk:
    """Return what runs from poses to a target would come to.

    Args:
        singular: The scene; its tolerances are how far off the true lines are, where the parameters do not say.
        poses: T_world_camera of each.
        target: T_world_camera.
        parameters: Law, robot, camera and noise.
        image_std: Standard deviation of the angle [rad] and of the offset of an image line.
        max_angle: Half the field of view [rad], where camera.half_view does not say.
        samples: Of each pose, with other noise and another map.

    Raises:
        GeometryError: If the numbers make no task.

    Source: roll-outs, docs/monitor.md.
    """
    lines, law = singular.lines, RolloutLaw.of_parameters(parameters)
    task = rollout_task(singular, target, law, dataclasses.replace(parameters, samples=1), FRAME_PERIOD)
    half = math.tan(min(max_angle, 1.5))
    loop = dataclasses.replace(
        task.loop,
        horizon=law.deadline,
        map_noise=parameters.map_noise or _map_noise(lines, task.ends),
        half_view=task.loop.half_view if any(task.loop.half_view) else (half, half),
    )
    variance = image_std**2
    covariances = np.tile([variance, 0.0, variance], (len(lines), 1)) if image_std > 0.0 else None
    task = dataclasses.replace(task, loop=loop, covariances=covariances)
    probability, demand, harm = [], [], []
    for number, pose in enumerate(poses):
        state = RunState(law.deadline, float(np.linalg.norm(pose.translation - target.translation)))
        outcomes = task.roll_out([pose] * samples, state, number)
        probability.append(outcomes.risk)
        demand.append(outcomes.demanded)
        harm.append(outcomes.harm)
    return PathRisk(law.law, np.array(probability), np.array(demand), tuple(harm))


def _map_noise(lines: LineSet, ends: Array | None) -> float:
    """Return how far the ends of a segment may be off, so that neither its position nor its direction is by more."""
    if ends is None:
        return float(np.median(lines.position_std))
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return float(np.median(np.minimum(lines.position_std, lines.direction_std * length / math.sqrt(2.0))))
