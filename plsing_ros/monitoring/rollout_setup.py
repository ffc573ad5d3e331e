# SPDX-License-Identifier: Apache-2.0
"""The loop to be rolled out, made from the monitor's parameters and from what the camera sees."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import MonitorParameters
from plsing_ros.parameters.law import POSE_LAWS
from plsing_ros.planning.rollout import (
    Harm,
    LoopModel,
    Outcomes,
    RolloutLaw,
    RolloutTask,
    RunState,
    guard_loci,
    poses_around,
)
from plsing_ros.singularities import SingularSet

# Steps of one answer, all samples together; with more, the roll-out has longer steps.
MAX_STEPS = 30_000
# Of the first answer, which the controller may be waiting for.
FIRST_STEPS = 8_000
# Between two frames as long as it is not known [s].
FRAME_PERIOD = 1.0 / 30.0
# Samples that see too few lines are drawn nearer at most so often.
_HALVINGS = 8


def rollout_task(
    singular: SingularSet,
    target: Pose,
    law: RolloutLaw,
    parameters: MonitorParameters,
    period: float,
    seen: LineObservation | None = None,
    max_steps: int = MAX_STEPS,
    ends: Array | None = None,
) -> RolloutTask:
    """Return the loop of a monitor's parameters with frames of a period [s].

    Where the parameters tell no image noise, the covariances of the lines that are seen stand for it. Where they tell
    no ends of the lines, those that were seen do, shape (n, 2, 3) [m].
    """
    lines: LineSet = singular.lines
    horizon = law.horizon
    linear, angular = parameters.robot_linear_speed or math.inf, parameters.robot_angular_speed or math.inf
    loop = LoopModel(
        period=period,
        # No more steps than an answer may cost, but for the first second, in which the speed may rise and fall.
        later_period=max(period, horizon * parameters.samples / max_steps),
        # What the law looks ahead by itself does not delay it.
        latency=max(round(parameters.frames_late - parameters.latency / period), 0),
        jitter=parameters.jitter,
        lag=parameters.robot_lag,
        robot_linear_speed=linear if parameters.robot_clamps else math.inf,
        robot_angular_speed=angular if parameters.robot_clamps else math.inf,
        demand_linear_speed=linear,
        demand_angular_speed=angular,
        image_noise=parameters.image_noise,
        position_noise=parameters.pose_position_noise,
        rotation_noise=parameters.pose_rotation_noise,
        map_noise=parameters.map_noise,
        focal_error=parameters.focal_error,
        dropped_frames=parameters.dropped_frames,
        half_view=(parameters.half_view[0], parameters.half_view[1]),
        near=parameters.nearest,
        min_length=parameters.shortest_image,
        path_linear_speed=parameters.detour_linear_speed,
        path_angular_speed=parameters.detour_angular_speed,
        horizon=horizon,
        pose_error_lasts=seen is not None and _error_lasts(law, seen),
    )
    if parameters.line_ends:
        ends = np.reshape(parameters.line_ends, (-1, 2, 3))
    covariances = None if parameters.image_noise > 0.0 else scene_covariances(lines, seen)
    return RolloutTask(lines, target, law, loop, ends, guard_loci(singular), covariances)


def _error_lasts(law: RolloutLaw, seen: LineObservation) -> bool:
    """Return whether what a pose is off by stays: of an estimator it does; others are taken as good on the whole.

    What an estimator cannot tell near a singularity it learns as soon as the camera leaves, and the laws that follow
    the pose lead it straight away.
    """
    leaves = seen.verdict is LinesVerdict.POOR and law.law in POSE_LAWS
    return bool(seen.lines_source) and not leaves


def scene_covariances(lines: LineSet, seen: LineObservation | None) -> Array | None:
    """Return the covariance of each line's image as seen, shape (n, 3), or None if none is known.

    A line that is not seen now is as uncertain as the others are in the median.
    """
    if seen is None or seen.usable_covariances is None or not len(seen.usable_ids):
        return None
    known = dict(zip(seen.usable_ids, seen.usable_covariances, strict=True))
    phi, mixed, rho = np.median(seen.usable_covariances, axis=0)
    # Medians of variances and covariance need not fit together.
    most = 0.99 * math.sqrt(phi * rho)
    other = np.array([phi, min(max(mixed, -most), most), rho])
    return np.array([known.get(i, other) for i in lines.ids])


def roll_out_around(
    task: RolloutTask, pose: Pose, covariance: Array | None, count: int, state: RunState, seed: int
) -> Outcomes:
    """Return what comes of samples of where a camera may be, which all see the lines that it sees.

    Near a singularity a covariance reaches to where fewer than three lines would be in view now: what is drawn there is
    drawn again, half as far from the pose, and so on.

    Args:
        task: The loop, of a camera that sees three lines or more.
        pose: T_world_camera.
        covariance: As for poses_around.
        count: Of samples.
        state: How far the run is.
        seed: Of all noise.

    Raises:
        GeometryError: If the numbers do not make a task.
    """
    starts = poses_around(pose, covariance, count, seed)
    found = task.roll_out(starts, state, seed)
    for times in range(1, _HALVINGS + 1):
        unseen = np.flatnonzero((found.kind == Harm.FEW_LINES) & (found.harm_time == 0.0)).tolist()
        if covariance is None or not unseen:
            break
        nearer = poses_around(pose, covariance, count, seed, 0.5**times)
        again = task.roll_out([nearer[i] for i in unseen], state, seed + times)
        found = found.replaced(unseen, again)
    return found
