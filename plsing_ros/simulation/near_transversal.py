# SPDX-License-Identifier: Apache-2.0
"""Section "VS towards a desired pose near singularity line L_M": four starts, one target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose

# A point on the transversal L_M (the paper's P_M) [m].
POINT_ON_TRANSVERSAL = np.array([0.3962, -4.337, 7.50])

GAIN = 0.1  # [1/s]

# Where a run counts as arrived, and where it is given up.
ARRIVED = 1e-3  # [m]
MAX_STEPS = 4000


@dataclass(frozen=True)
class Start:
    """A row of table simulation_points.

    Attributes:
        name: As in the paper.
        offset: From POINT_ON_TRANSVERSAL [m].
        note: The paper's comment.
    """

    name: str
    offset: tuple[float, float, float]
    note: str

    @property
    def position(self) -> Array:
        """Camera centre at the start, shape (3,) [m]."""
        return POINT_ON_TRANSVERSAL + self.offset


STARTS = (
    Start("Start 1", (0.20, 0.30, 0.0), "near to singularity"),
    Start("Start 2", (-0.30, 0.30, -0.30), "opposed to desired"),
    Start("Start 3", (0.0, 0.30, 0.40), "near to singularity"),
    Start("Start 4", (0.10, -0.60, 0.10), "away from singularity"),
)

TARGET_POSITION = POINT_ON_TRANSVERSAL + (0.30, -0.30, 0.30)

# The paper says only that the four lines are visible; here the optical axis goes from P_M to the origin, for all poses.
ORIENTATION = Pose.look_at(POINT_ON_TRANSVERSAL, (0.0, 0.0, 0.0)).quaternion_xyzw
