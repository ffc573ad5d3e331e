# SPDX-License-Identifier: Apache-2.0
"""Whether to go straight, across singularities, or round them: by the risk that roll-outs predict of both."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.geometry.rotations import turned_covariance
from plsing_ros.parameters import ControllerParameters
from plsing_ros.planning.camera_path import CameraPath, even_progress
from plsing_ros.planning.detour import Decision, DetourOptions, Plan, plan_path, target_refusal
from plsing_ros.planning.path_conditions import lines_in_view
from plsing_ros.planning.rollout import LoopModel, RolloutLaw, RolloutTask, RunState, poses_around
from plsing_ros.singularities import SingularSet

# Roll-outs of each way, their noise, and the poses by which a path is given to them.
_SAMPLES, _SEED = 20, 0
_PATH_POSES = 100
# Lines that fix a pose, with none to spare for one that is wrong.
_OF_A_POSE = 4
# Of a pose: position and rotation.
_PARTS = slice(0, 3), slice(3, 6)


@dataclass(frozen=True, eq=False)
class KnownPose:
    """How well the camera's pose is known beside what the image says of it, and the law that may go by it.

    Attributes:
        law: With its gain and limits.
        covariance: Of the pose in the camera's axes, (position [m], rotation [rad]), shape (6, 6).
        lasts: Whether its error stays, as that of a filter; else each frame has its own.
    """

    law: RolloutLaw
    covariance: Array
    lasts: bool

    @classmethod
    def of_parameters(cls, parameters: ControllerParameters, covariance: Array, lasts: bool) -> KnownPose:
        """Return that of a controller with these parameters."""
        return cls(RolloutLaw.of_parameters(parameters), covariance, lasts)


def plan_by_risk(
    singular: SingularSet, start: Pose, target: Pose, options: DetourOptions, known: KnownPose | None
) -> Plan:
    """Return the straight way where its predicted risk is hardly higher than that of the way round, else as plan_path.

    A pose that is known carries the camera across a singularity, where the image does not tell of one motion. What may
    speak against it are lines that leave the view, and errors of the pose. The straight way is gone by the pose
    (Plan.by_pose), with the law `fused`.

    Args:
        singular: The singular set of the observed lines.
        start: T_world_camera at the start.
        target: T_world_camera at the target.
        options: How to plan; risk_margin is by how much the risk of the straight way may be higher.
        known: How well the pose is known; None: not beside the image, and a way round is planned.

    Raises:
        GeometryError: If the numbers make no task.

    Source: new, docs/laws.md section "Detour".
    """
    if known is None or options.risk_margin == 0.0 or target_refusal(singular, target, options) is not None:
        return plan_path(singular, start, target, options)
    straight = CameraPath(start, target, options.limits)
    keeps_view = _keeps_view(singular, straight, options)
    risk = _risk(singular, start, target, options, dataclasses.replace(known.law, law="position"), known, ())
    if keeps_view and risk <= options.risk_margin:
        return Plan(Decision.STRAIGHT, f"straight by the pose: predicted risk {risk:.0%}", straight, by_pose=True)
    plan = plan_path(singular, start, target, options)
    if plan.path is None:
        why = f"straight by the pose, predicted risk {risk:.0%}, for {plan.reason}"
        return Plan(Decision.STRAIGHT, why, straight, by_pose=True)
    path = tuple(plan.path.sampled(_PATH_POSES))
    law = dataclasses.replace(known.law, law="detour")
    other = _risk(singular, start, target, options, law, known, path)
    risks = f"predicted risk {other:.0%}, straight by the pose {risk:.0%}"
    if not keeps_view and _keeps_view(singular, plan.path, options):
        return dataclasses.replace(plan, reason=f"{plan.reason}; {risks}, and lines would leave the view")
    if risk > other + options.risk_margin:
        return dataclasses.replace(plan, reason=f"{plan.reason}; {risks}")
    why = f"straight by the pose: predicted risk {risk:.0%}, round {other:.0%}"
    return Plan(Decision.STRAIGHT, why, straight, by_pose=True)


def _risk(
    singular: SingularSet,
    start: Pose,
    target: Pose,
    options: DetourOptions,
    law: RolloutLaw,
    known: KnownPose,
    path: tuple[Pose, ...],
) -> float:
    """Return the share of roll-outs from a start to a target that come to harm."""
    position, rotation = (math.sqrt(float(np.trace(known.covariance[of, of])) / 3.0) for of in _PARTS)
    # A way round takes longer, and has longer.
    deadline = dataclasses.replace(known.law, law="detour").deadline
    loop = LoopModel(
        position_noise=0.0 if known.lasts else position,
        rotation_noise=0.0 if known.lasts else rotation,
        half_view=options.half_view,
        path_linear_speed=options.limits.linear,
        path_angular_speed=options.limits.angular,
        horizon=deadline,
        pose_error_lasts=known.lasts,
    )
    task = RolloutTask(singular.lines, target, law, loop, T_world_camera=start, path=path)
    covariance = turned_covariance(known.covariance, start.rotation) if known.lasts else None
    starts = poses_around(start, covariance, _SAMPLES, _SEED)
    distance = float(np.linalg.norm(start.translation - target.translation))
    return task.roll_out(starts, RunState(deadline, distance), _SEED).risk


def _keeps_view(singular: SingularSet, path: CameraPath, options: DetourOptions) -> bool:
    """Return whether enough lines for a pose are in view all along a path, or as many as at the end that sees fewer."""
    if not all(options.half_view):
        return True
    in_view = lines_in_view(singular.lines, *path.poses(even_progress(_PATH_POSES)), options.half_view)
    return bool(in_view.min() >= min(_OF_A_POSE, in_view[0], in_view[-1]))
