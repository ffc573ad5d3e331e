# SPDX-License-Identifier: Apache-2.0
"""From a camera twist to joint speeds within limits, and through the arm's own singularities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.simulation.arm import JOINTS, Arm

# A turn of 1 rad/s counts as much as a speed of this [m/s].
_LENGTH = 0.3
# Singular values of the Jacobian in these units, below which a direction is damped, and the damping at zero.
_ONSET = 0.04
_DAMPING = 0.04
# More that is missed of a twist than this share of it is worth a sentence.
_MISSED = 0.1


@dataclass(frozen=True, eq=False)
class JointMotion:
    """What an arm does about a twist.

    Attributes:
        speeds: Of the joints, shape (6,) [rad/s].
        reason: What keeps it from following the twist, as a sentence; empty if it follows.
    """

    speeds: Array
    reason: str


def follow_twist(arm: Arm, joints: Array, twist: Array, max_speed: float, duration: float) -> JointMotion:
    """Return joint speeds that move the camera by a twist.

    Near a singularity of the arm the direction that it can hardly move in is damped, and no other. Too fast motions are
    slowed down as a whole, so that they keep their direction. In front of a joint's limit the arm stops.

    Args:
        arm: The arm.
        joints: Where it is, shape (6,) [rad].
        twist: Of the camera in its optical frame, (v, omega), shape (6,) [m/s, rad/s].
        max_speed: Of each joint [rad/s].
        duration: For which the speeds will be held [s].

    Source: damping of the weakest directions only, Maciejewski and Klein (1988), Chiaverini (1997).
    """
    weights = np.array([1.0, 1.0, 1.0, _LENGTH, _LENGTH, _LENGTH])
    left, values, right = np.linalg.svd(weights[:, np.newaxis] * arm.jacobian(joints))
    damping = np.where(values < _ONSET, _DAMPING**2 * (1.0 - np.minimum(values / _ONSET, 1.0) ** 2), 0.0)
    amplitudes = left.T @ (weights * twist)
    speeds = right.T @ (values / (values**2 + damping) * amplitudes)
    reasons = []
    missed = damping / (values**2 + damping) * amplitudes
    if float(np.linalg.norm(missed)) > _MISSED * float(np.linalg.norm(amplitudes)):
        reasons.append("the arm is near a singularity of its own and moves less than asked")
    fastest = float(np.abs(speeds).max())
    if fastest > max_speed:
        speeds *= max_speed / fastest
        reasons.append(f"{JOINTS[int(np.abs(speeds).argmax())]} is as fast as it may be")
    room = np.maximum(np.where(speeds > 0.0, arm.limits - joints, arm.limits + joints), 0.0)
    needed = np.abs(speeds) * duration
    share = np.min(room / np.maximum(needed, 1e-12))
    if share < 1.0:
        which = int(np.argmin(room / np.maximum(needed, 1e-12)))
        speeds = speeds * share
        reasons.append(
            f"{JOINTS[which]} is at its limit of {np.copysign(arm.limits[which], joints[which]):.2f} rad: the arm stops"
        )
    return JointMotion(speeds, "; ".join(reasons))
