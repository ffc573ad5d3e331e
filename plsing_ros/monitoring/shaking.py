# SPDX-License-Identifier: Apache-2.0
"""A target that cannot be held: how far noise drives the camera about it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from plsing_ros.planning.rollout import RolloutTask, RunState

# The law settles in so many of its time constants; a roll-out at the target lasts no longer than that, or this [s].
_TIME_CONSTANTS, _LONGEST = 4.0, 30.0
# Farther off than this the camera has left [m].
_LEFT = 10.0


def expected_shaking(task: RolloutTask, samples: int, seed: int, max_steps: int) -> float:
    """Return how far the camera is from the target, root mean square, when it is there and the law holds it [m].

    Constant errors of the map and the focal length are left out: they move the camera, but do not shake it.

    Args:
        task: The loop with its noise.
        samples: Noise samples.
        seed: Of them.
        max_steps: Of all samples together; with more, the steps get longer.

    Raises:
        GeometryError: If the numbers do not make a task.

    Source: new, docs/concepts/risk.md: a roll-out that begins at the target, second half.
    """
    loop = task.loop
    horizon = min(_TIME_CONSTANTS / task.law.gain, _LONGEST)
    still = dataclasses.replace(
        loop,
        later_period=horizon * samples / max_steps,
        map_noise=0.0,
        focal_error=0.0,
        horizon=horizon,
        stops=False,
    )
    state = RunState(math.inf, _LEFT)
    found = dataclasses.replace(task, loop=still, residuals=None).roll_out([task.T_world_target] * samples, state, seed)
    # A sample that leaves, or loses its lines, is as far as it got.
    square = np.where(found.kind != 0, found.distance**2, found.mean_square_distance)
    return math.sqrt(float(np.median(square)))
