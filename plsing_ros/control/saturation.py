# SPDX-License-Identifier: Apache-2.0
"""Speed limits that keep the direction of a motion."""

from __future__ import annotations

import math

from plsing_ros.arrays import Array


def saturate(twist: Array, linear: float, angular: float) -> tuple[Array, float]:
    """Return a twist within speed limits, and the factor in (0, 1] that it was scaled by.

    One factor for the whole twist: axis and pitch of the screw stay what they are, where two factors would bend it.

    Args:
        twist: (v, omega), shape (6,), finite.
        linear: Limit of |v| [m/s], > 0; may be infinite.
        angular: Limit of |omega| [rad/s], likewise.
    """
    if linear == math.inf == angular:
        return twist, 1.0
    factor = 1.0
    for part, limit in ((twist[:3], linear), (twist[3:], angular)):
        # hypot does not overflow for large components.
        speed = math.hypot(*part.tolist())
        if speed > limit:
            factor = min(factor, limit / speed)
    return (twist, 1.0) if factor == 1.0 else (twist * factor, factor)
