"""Image lines completed with their 3-D lines, from an estimated pose."""

from __future__ import annotations

import numpy as np

from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet
from plsing_ros.pose.estimate import PoseEstimate


def lift_lines(lines_world: LineSet, estimate: PoseEstimate, observation: LineObservation) -> LineObservation:
    """Return image lines completed with their 3-D lines in the camera frame, at an estimated pose.

    Args:
        lines_world: The scene.
        estimate: Of this observation.
        observation: Image lines.

    Returns:
        Usable are the lines that the estimate rests on; those seen against their direction are turned round.

    Raises:
        ObservationError: If the estimate has no pose.
    """
    if estimate.T_world_camera is None:
        raise ObservationError(f"features cannot be completed without a pose: {estimate.reason}")
    usable = np.array([i in estimate.used_ids for i in observation.ids], dtype=bool)
    sign = np.array([-1.0 if i in estimate.reversed_ids else 1.0 for i in observation.ids])
    row_of = {i: row for row, i in enumerate(lines_world.ids)}
    seen = lines_world.select([row_of[i] for i in observation.ids if i in estimate.used_ids])
    return LineObservation(
        observation.ids,
        observation.image_lines * sign[:, np.newaxis],
        usable,
        seen.transformed(estimate.T_world_camera.inverse(), "camera"),
    )
