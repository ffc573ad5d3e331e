# SPDX-License-Identifier: Apache-2.0
"""Image lines completed with their 3-D lines, from a pose that is known or that they show themselves."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation, LinesVerdict, degenerate_projections
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.pose.estimate import PoseEstimate
from plsing_ros.pose.estimator import PoseEstimator


def lift_lines_at(lines_world: LineSet, T_world_camera: Pose, observation: LineObservation) -> LineObservation:
    """Return image lines completed with their 3-D lines in the camera frame, at a pose that is known.

    Args:
        lines_world: The scene.
        T_world_camera: The camera's pose.
        observation: Image lines; those that are not in the scene, or have no image at the pose, become unusable.
    """
    row_of = {i: row for row, i in enumerate(lines_world.ids)}
    T_camera_world = T_world_camera.inverse()
    rows = [row_of[i] for i in observation.usable_ids if i in row_of]
    seen = lines_world.select(rows).transformed(T_camera_world, "camera") if rows else None
    if seen is not None:
        kept = np.flatnonzero(~degenerate_projections(seen))
        seen = seen.select(kept) if len(kept) else None
    known = () if seen is None else seen.ids
    usable = np.array([use and i in known for i, use in zip(observation.ids, observation.usable, strict=True)], bool)
    covariances, ends = observation.covariances, observation.ends
    return LineObservation(observation.ids, observation.image_lines, usable, seen, covariances=covariances, ends=ends)


def lift_lines(lines_world: LineSet, estimate: PoseEstimate, observation: LineObservation) -> LineObservation:
    """Return image lines completed with their 3-D lines in the camera frame, at an estimated pose.

    Args:
        lines_world: The scene.
        estimate: Of this observation.
        observation: Image lines.

    Returns:
        Usable are the lines that the estimate rests on, which may be none of this image's; those seen against their
        direction are turned round.

    Raises:
        ObservationError: If the estimate has no pose.
    """
    if estimate.T_world_camera is None:
        raise ObservationError(f"features cannot be completed without a pose: {estimate.reason}")
    usable = np.array([i in estimate.used_ids for i in observation.ids], dtype=bool)
    sign = np.array([-1.0 if i in estimate.reversed_ids else 1.0 for i in observation.ids])
    row_of = {i: row for row, i in enumerate(lines_world.ids)}
    rows = [row_of[i] for i in observation.ids if i in estimate.used_ids]
    T_camera_world = estimate.T_world_camera.inverse()
    covariances = observation.covariances
    if covariances is not None:
        # A line that is turned round has the other offset, and an angle with the same error.
        covariances = covariances * np.stack([np.ones(len(sign)), sign, np.ones(len(sign))], axis=1)
    return LineObservation(
        observation.ids,
        observation.image_lines * sign[:, np.newaxis],
        usable,
        lines_world.select(rows).transformed(T_camera_world, "camera") if rows else None,
        covariances=covariances,
        ends=observation.ends,
    )


class LineLifter:
    """Completes observations of one scene.

    Args:
        lines_world: The scene, or None if it is not known.
    """

    def __init__(self, lines_world: LineSet | None) -> None:
        self._lines = lines_world

    @cached_property
    def _estimator(self) -> PoseEstimator:
        assert self._lines is not None
        return PoseEstimator(self._lines)

    def lift(self, observation: LineObservation, T_world_camera: Pose | None) -> LineObservation:
        """Return an observation with 3-D lines in the camera frame: as it is if it has some.

        Args:
            observation: What the camera sees.
            T_world_camera: Where it is; None: the pose that the lines show, whose verdict the observation gets.

        Raises:
            ObservationError: If the scene is not known, or the lines show no pose.
        """
        if observation.lines_camera is not None or not observation.usable_ids:
            return observation
        if self._lines is None:
            raise ObservationError("image lines without 3-D lines need the scene (argument lines), which is not given")
        if T_world_camera is not None:
            return lift_lines_at(self._lines, T_world_camera, observation)
        estimate = self._estimator.estimate(observation)
        verdict = LinesVerdict[estimate.verdict.name] if estimate.T_world_camera is not None else LinesVerdict.GIVEN
        return replace(
            lift_lines(self._lines, estimate, observation),
            verdict=verdict,
            verdict_reason=estimate.reason,
            lines_source=estimate.source,
        )
