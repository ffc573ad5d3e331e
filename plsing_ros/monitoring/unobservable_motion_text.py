# SPDX-License-Identifier: Apache-2.0
"""The motion that the image does not show, in words."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.geometry import Pose
from plsing_ros.singularities import LocusDistance, SingularSet

# A rotation of less than this much for each metre is a translation to a reader [rad/m].
_TRANSLATION = 0.1
# About 8 degrees: near a transversal the least observable direction is along it only to first order.
_ALONG = 0.99


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
    rotation, center = (np.eye(3), np.zeros(3)) if pose is None else (pose.rotation, pose.translation)
    where = " in the camera frame" if pose is None else ""
    linear, angular = rotation @ weakest[:3], rotation @ weakest[3:]
    speed, turn = math.sqrt(float(linear @ linear)), math.sqrt(float(angular @ angular))
    if turn <= _TRANSLATION * speed:
        if pose is not None:
            transversals = sorted(singular.transversals, key=lambda each: nearest is None or each.name != nearest.name)
            for transversal in transversals:
                if abs(float(transversal.direction @ linear)) >= _ALONG * speed:
                    return f"translation along {transversal.name}"
        return f"translation along {_text(linear / speed)}{where}"
    axis, across = angular / turn, cross(angular, linear) / turn**2
    pitch = float(axis @ linear) / turn
    return f"screw about the axis through {_text(center + across)} along {_text(axis)}{where}, pitch {pitch:.3g} m/rad"


def _text(vector: Array) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in vector.tolist()) + ")"
