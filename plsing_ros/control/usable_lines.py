# SPDX-License-Identifier: Apache-2.0
"""Which lines of an observation a law acts on, with what is known of their errors."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.pose_laws import PoseErrors
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.features.target import MINIMUM_LINES, Target
from plsing_ros.geometry import LineSet
from plsing_ros.geometry.line_alignment import matched
from plsing_ros.pose.received_poses import ReceivedPose

# 3-D lines that differ less from those at a pose were computed from it [m], [1].
_SAME = 1e-4


def common_lines(observation: LineObservation, target: Target) -> tuple[LineSet, Array]:
    """Return the 3-D lines that are in sight and in the target, and their image lines, shape (3n,).

    Raises:
        ObservationError: If there are fewer than three, or no 3-D lines.
    """
    seen = observation.lines_camera
    if seen is not None and seen.ids == target.ids:
        return seen, observation.usable_image_lines.ravel()
    ids = observation.usable_ids
    if seen is None:
        if ids:
            why = observation.verdict_reason or "directions and moments are empty"
            raise ObservationError(f"features have no 3-D lines ({why}), which the interaction matrix needs")
        raise ObservationError("none of the observed lines is usable")
    rows = [row for row, i in enumerate(ids) if i in target]
    if len(rows) < MINIMUM_LINES:
        raise ObservationError(
            f"only {len(rows)} usable line(s) with a target (usable: {list(ids)}, target: {list(target.ids)}); "
            f"at least {MINIMUM_LINES} are needed"
        )
    return seen.select(rows), observation.usable_image_lines[rows].ravel()


def usable_covariances(observation: LineObservation, ids: tuple[int, ...]) -> Array | None:
    """Return those of the image lines of some usable ids, shape (k, 3), or None if they are not known."""
    known = observation.usable_covariances
    if known is None or ids == observation.usable_ids:
        return known
    row_of = {i: row for row, i in enumerate(observation.usable_ids)}
    chosen: Array = known[[row_of[i] for i in ids]]
    return chosen


def pose_errors(
    observation: LineObservation,
    lines: LineSet,
    scene: LineSet | None,
    told: ReceivedPose | None,
    latest: ReceivedPose | None,
) -> PoseErrors | None:
    """Return how far the pose may be off that 3-D lines were computed from, or None if that is not known.

    Args:
        observation: That they are of.
        lines: In the camera frame.
        scene: The lines in the world frame; None: lines that name no source are not asked about.
        told: The pose received for this observation, or None.
        latest: The pose received last, or None.
    """
    if observation.lines_source:
        # Of the same estimator, whose covariance changes slowly.
        known = told or latest
        covariance = None if known is None else known.covariance_camera()
        return None if covariance is None else PoseErrors(covariance, False, observation.lines_source == "image")
    covariance = None if told is None else told.covariance_camera()
    if told is None or covariance is None or scene is None or not _stand_for(lines, scene, told):
        return None
    return PoseErrors(covariance, True)


def _stand_for(lines: LineSet, scene: LineSet, told: ReceivedPose) -> bool:
    """Return whether 3-D lines are those of the scene as seen from a pose, and so as uncertain as it is."""
    try:
        there = matched(scene, lines).transformed(told.T_world_camera.inverse(), lines.frame)
    except GeometryError:
        return False
    return bool(
        np.abs(there.moment - lines.moment).max() < _SAME and np.abs(there.direction - lines.direction).max() < _SAME
    )
