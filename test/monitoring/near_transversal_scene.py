# SPDX-License-Identifier: Apache-2.0
"""The paper's four lines and its task near the transversal L_M, in numbers of their own."""

import numpy as np

from plsing_ros.geometry import LineSet, Pose

SCENE = LineSet.from_points_directions(
    [[0, 0, 0], [0, 0, 2], [3, 5, 0], [0, 1, 7]], [[1, 0, 0], [4, -5, 0], [3, 7, 3], [-2, 1, 13]]
)
ON_TRANSVERSAL = np.array([0.3962, -4.337, 7.50])
LOOK = Pose.look_at(ON_TRANSVERSAL, [0.0, 0.0, 0.0]).rotation
# Start 2 of the paper, whose speed explodes after 6 s, and its target.
START_2, TARGET = Pose(LOOK, ON_TRANSVERSAL + [-0.3, 0.3, -0.3]), Pose(LOOK, ON_TRANSVERSAL + [0.3, -0.3, 0.3])
SECOND = 10**9

# What alerts, and all of it switched off.
FALLING = (
    "inverse_condition_number",
    "relative_inverse_condition_number",
    "smallest_singular_value",
    "z",
    "distance",
    "transversal_distance",
    "isolated_point_distance",
    "surface_distance",
)
JUDGED = (*FALLING, "position_std", "rotation_std", "speed_growth")
OFF = {f"{level}.{name}": 0.0 for level in ("warn", "critical") for name in JUDGED}
