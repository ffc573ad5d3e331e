# SPDX-License-Identifier: Apache-2.0
"""Servo runs drawn at random for the study of alerts: tasks, laws, gains, frame rates, chains; their parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from benchmark.servo_conditions import (
    CONDITIONS,
    FOCAL_LENGTH,
    HALF_VIEW,
    ROBOT_LIMITS,
    Condition,
    SegmentTask,
    draw_task,
    view_of,
)
from plsing_ros.geometry import Pose
from plsing_ros.parameters import ControllerParameters, MonitorParameters, PoseEstimatorParameters

LAWS = ("pinv", "pinv", "dls", "adaptive_dls", "guarded", "detour", "position", "fused")
KINDS = ("any", "crossing", "any", "crossing", "crossing", "pure rotation", "any", "at a singularity")
_NEAREST, _SHORTEST = 0.1, 20.0 / FOCAL_LENGTH
# What an estimator is told of exact images [px] and of an exact map [m].
_LEAST_PIXELS, _LEAST_SHIFT = 0.1, 1e-3


@dataclass(frozen=True, eq=False)
class Setting:
    """One run to be made.

    Attributes:
        condition: What is wrong.
        task: Scene, start and target.
        kind: "any", "crossing", "at a singularity" (from time 0 on) or "pure rotation".
        law: Of the controller.
        rate: Of the frames [Hz].
        limited: Whether the controller has its limits on.
        soft: Whether its speed rises over the first second.
        chain: Whether 3-D lines and pose come from pose_estimator.
        seed: Of all noise.
        missing: Share of lines that are not detected in a frame.
    """

    condition: Condition
    task: SegmentTask
    kind: str
    law: str
    rate: float
    limited: bool
    soft: bool
    chain: bool
    seed: int
    missing: float = 0.0


def draw_setting(condition: str, seed: int, number: int) -> Setting:
    """Return run `number` of a seed."""
    generator = np.random.default_rng([seed, number])
    found = CONDITIONS[condition]
    if condition == "lab":
        found = replace(found, limited=False)
    kind = KINDS[number % len(KINDS)]
    task = draw_task(generator, found, crossing=kind in ("crossing", "at a singularity"))
    if kind == "pure rotation":
        turn = Rotation.from_rotvec(generator.normal(scale=0.2, size=3)).as_matrix()
        start = Pose(task.target.rotation @ turn, task.target.translation)
        if np.count_nonzero(view_of(task.ends, start)[1]) >= 4:
            task = replace(task, start=start)
    if kind == "at a singularity":
        start = _on_transversal(task)
        if np.count_nonzero(view_of(task.ends, start)[1]) >= 4:
            task = replace(task, start=start)
    law = LAWS[int(generator.integers(len(LAWS)))]
    return Setting(
        found,
        task,
        kind,
        law,
        float(np.exp(generator.uniform(math.log(10.0), math.log(100.0)))),
        bool(generator.random() < 0.5),
        bool(generator.random() < 0.25),
        bool(generator.random() < 0.25),
        int(generator.integers(2**31)),
    )


def with_other_errors(setting: Setting, number: int) -> Setting:
    """Return the same run as its controller knows it, with other errors of the map and the focal length."""
    generator, task, condition = np.random.default_rng([setting.seed, number]), setting.task, setting.condition
    ends = task.map_ends + condition.map_shift * generator.normal(size=task.map_ends.shape)
    factor = condition.focal_length if generator.random() < 0.5 else 1.0 / condition.focal_length
    return replace(setting, task=replace(task, ends=ends, focal_factor=factor))


def _on_transversal(task: SegmentTask) -> Pose:
    """Return the start moved onto the line that all observed lines meet, where it is nearest."""
    # All lines meet the axis: its Plücker vector is the null vector of the reciprocal product with them.
    lines = task.map
    null = np.linalg.svd(np.hstack([lines.moment, lines.direction]))[2][-1]
    direction, moment = null[:3], null[3:]
    size = np.linalg.norm(direction)
    direction, point = direction / size, np.cross(direction, moment) / size**2
    offset = task.start.translation - point
    return Pose(task.start.rotation, point + direction * (direction @ offset))


def controller_parameters(setting: Setting) -> ControllerParameters:
    """Return the controller of a run."""
    return ControllerParameters(**_scene(setting), **_law(setting), min_target_condition=0.0)


def estimator_parameters(setting: Setting) -> PoseEstimatorParameters:
    """Return the pose estimator of a run in a chain."""
    scene, condition = _scene(setting), setting.condition
    return PoseEstimatorParameters(
        lines_points=scene["lines_points"],
        lines_directions=scene["lines_directions"],
        noise_image=max(condition.pixels, _LEAST_PIXELS) / FOCAL_LENGTH,
        lines_position_std=(max(condition.map_shift, _LEAST_SHIFT),),
    )


def monitor_parameters(setting: Setting) -> MonitorParameters:
    """Return the monitor of a run, which is told what camera and robot are like."""
    condition = setting.condition
    linear, angular = ROBOT_LIMITS
    return MonitorParameters(
        **_scene(setting),
        **_law(setting),
        target_known=True,
        frames_late=condition.latency,
        jitter=_jitter(condition),
        dropped_frames=condition.dropped,
        robot_lag=condition.lag,
        robot_linear_speed=linear,
        robot_angular_speed=angular,
        robot_clamps=condition.limited,
        image_noise=condition.pixels / FOCAL_LENGTH,
        half_view=(HALF_VIEW, HALF_VIEW),
        nearest=_NEAREST,
        shortest_image=_SHORTEST,
        focal_error=condition.focal_length - 1.0,
        map_noise=condition.map_shift,
        # In a chain the estimator's pose is followed, which jumps less than one without a filter.
        pose_position_noise=0.0 if setting.chain else condition.position,
        pose_rotation_noise=0.0 if setting.chain else condition.rotation,
        line_ends=tuple(setting.task.map_ends.ravel()),
    )


def _scene(setting: Setting) -> dict[str, tuple[float, ...]]:
    lines, target = setting.task.map, setting.task.target
    return {
        "lines_points": tuple(lines.pivot.ravel()),
        "lines_directions": tuple(lines.direction.ravel()),
        "target_position": tuple(target.translation),
        "target_orientation": tuple(target.quaternion_xyzw),
    }


def _law(setting: Setting) -> dict[str, object]:
    linear, angular = ROBOT_LIMITS if setting.limited else (0.0, 0.0)
    return {
        "law": setting.law,
        "gain": setting.task.gain,
        "max_linear_speed": linear,
        "max_angular_speed": angular,
    }


def _jitter(condition: Condition) -> float:
    """Return the standard deviation [frames] of which that share is later by a frame or more."""
    return 0.5 / float(norm.ppf(1.0 - 0.5 * condition.jitter)) if condition.jitter else 0.0
