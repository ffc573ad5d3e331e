# SPDX-License-Identifier: Apache-2.0
"""Whether a camera may stray by what the pose that it follows is off by."""

from __future__ import annotations

from plsing_ros import _core
from plsing_ros.parameters import ControllerParameters

# The camera follows an error of its pose for about so long before the images of its motion correct it [s].
_FOLLOWED = 2.0


def may_stray(deviation: float, gain: float, distance: float) -> bool:
    """Return whether a camera that follows a path by a POOR pose may get farther from its target than is no harm.

    An error of one standard deviation is answered by slow_scale lambda times its size, wherever it points, and near a
    singularity it lasts: neither the covariance nor a roll-out from its samples tells for how long.

    Args:
        deviation: Standard deviation of the position [m].
        gain: lambda [1/s].
        distance: From the target at the start of the run, or now if that is less [m].

    Source: new, docs/concepts/risk.md; the two seconds are those of runs that began at a singularity.
    """
    drift = ControllerParameters.slow_scale * gain * deviation * _FOLLOWED
    # Farther off than this is harm AWAY.
    return drift > max((_core.AWAY_FACTOR - 1.0) * distance, _core.AWAY_MARGIN)
