# SPDX-License-Identifier: Apache-2.0
"""The motion that the image does not show, in words."""

from __future__ import annotations

import math

from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.singularities import LocusDistance, SingularSet

# A rotation of less than this much for each metre is a translation to a reader [rad/m].
_TRANSLATION = 0.1
# About 8 degrees: near a transversal the least observable direction is along it only to first order.
_ALONG = 0.99
_AXES, _ORIGIN = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (0.0, 0.0, 0.0)


def unobservable_motion_text(
    weakest: Array, pose: Pose | None, singular: SingularSet, nearest: LocusDistance | None
) -> str:
    """Return the least observable direction in words: a translation, along a transversal if it is one, or a screw.

    Args:
        weakest: Twist (v, omega) in the optical frame, shape (6,) [m/s, rad/s], of any size but zero.
        pose: T_world_camera, or None if it is not known; the words are then in the camera's frame.
        singular: The singular set, for the transversals.
        nearest: The nearest locus; its transversal is named first.
    """
    # Plain numbers: numpy takes many times as long for three of them, and near a singularity every cycle comes here.
    rows, (x, y, z) = (_AXES, _ORIGIN) if pose is None else (pose.rotation.tolist(), pose.translation.tolist())
    where = " in the camera frame" if pose is None else ""
    vx, vy, vz, wx, wy, wz = weakest.tolist()
    vx, vy, vz = [a * vx + b * vy + c * vz for a, b, c in rows]
    wx, wy, wz = [a * wx + b * wy + c * wz for a, b, c in rows]
    speed, turn = math.hypot(vx, vy, vz), math.hypot(wx, wy, wz)
    if turn <= _TRANSLATION * speed:
        if pose is not None:
            transversals = sorted(singular.transversals, key=lambda each: nearest is None or each.name != nearest.name)
            for transversal in transversals:
                if abs(float(transversal.direction @ (vx, vy, vz))) >= _ALONG * speed:
                    return f"translation along {transversal.name}"
        return f"translation along {_text(vx / speed, vy / speed, vz / speed)}{where}"
    square = turn * turn
    x, y, z = x + (wy * vz - wz * vy) / square, y + (wz * vx - wx * vz) / square, z + (wx * vy - wy * vx) / square
    pitch = (vx * wx + vy * wy + vz * wz) / square
    return (
        f"screw about the axis through {_text(x, y, z)} along {_text(wx / turn, wy / turn, wz / turn)}{where}, "
        f"pitch {pitch:.3g} m/rad"
    )


def _text(x: float, y: float, z: float) -> str:
    return f"({x:.3g}, {y:.3g}, {z:.3g})"
