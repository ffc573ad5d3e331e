# SPDX-License-Identifier: Apache-2.0
"""What is measured of a camera in one cycle, as a value."""

from __future__ import annotations

from typing import NamedTuple

from plsing_ros.features import Conditioning
from plsing_ros.singularities import DistanceArrays, LocusDistance, Proximity


class Measurement(NamedTuple):
    """What is measured of a camera.

    Attributes:
        conditioning: Of the interaction matrix.
        ruling: Conditioning that levels are judged by: that of the degrees of freedom in use.
        target_inverse: Inverse condition number at the target with the same lines, or None if that is not known.
        distances: From all loci, or None if the camera position is not known.
        nearest: The nearest locus other than the observed lines; None, too, if there is none.
        proximity: To a singular centre, or None if the camera position is not known.
    """

    conditioning: Conditioning
    ruling: Conditioning
    target_inverse: float | None = None
    distances: DistanceArrays | None = None
    nearest: LocusDistance | None = None
    proximity: Proximity | None = None
