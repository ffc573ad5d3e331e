# SPDX-License-Identifier: Apache-2.0
"""How fast the camera may go with singular loci ahead."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.inverses import smooth_step

# Within this share of the margin the direction to a locus turns quickly, and says little.
_CORE = 0.03
_AT_REST = 1e-12  # [m/s]


def guarded_scale(offsets: Array | None, velocity: Array, health: float, margin: float, floor: float) -> float:
    """Return the share of the speed that is left, in [floor, 1].

    For a locus at distance d in the direction o / d it is 1 - a^2 (1 - floor) n, with
    a = (1 + (o . v) / (|v| sqrt(d^2 + core^2))) / 2 for approaching, from 0 (straight away) to 1 (straight towards it),
    and n = (1 - step(d / margin)) (1 - step(health)) for being near; the least over the loci counts. So nothing is
    slowed down farther away than the margin or where L is healthy for this target, and leaving is not slowed down. It
    is continuous in position and motion, also on a locus and where approaching turns into leaving.

    Args:
        offsets: From the camera centre to the closest point of each locus, shape (k, 3) [m]; None if not known, and
            then health alone counts, as if straight towards a locus.
        velocity: Of the camera centre in the same frame, shape (3,) [m/s].
        health: Smallest singular value over where it is taken as nearly unobservable.
        margin: [m].
        floor: In (0, 1].

    Source: new, docs/controller.md.
    """
    ill = 1.0 - float(smooth_step(np.array(health)))
    if ill == 0.0:
        return 1.0
    if offsets is None:
        return 1.0 - (1.0 - floor) * ill
    if len(offsets) == 0:
        return 1.0
    square = np.einsum("ij,ij->i", offsets, offsets)
    speed = max(float(np.linalg.norm(velocity)), _AT_REST)
    cosine = (offsets @ velocity) / (speed * np.sqrt(square + (_CORE * margin) ** 2))
    near = 1.0 - smooth_step(np.sqrt(square) / margin)
    approaching = np.square(0.5 + 0.5 * cosine)
    return 1.0 - (1.0 - floor) * ill * float((approaching * near).max())
