# SPDX-License-Identifier: Apache-2.0
"""Lines that are seen together, with everything about them that does not depend on the image."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet
from plsing_ros.parameters.pose_estimator import EstimationParameters
from plsing_ros.pose.candidates import SceneTriplets
from plsing_ros.pose.residuals import known_lines
from plsing_ros.singularities import SingularSet, singular_set

# Poses further from the lines than this, in sizes of the scene, are no poses.
_FURTHEST = 1e6
# Triplets that are tried first: enough if all lines agree.
_FEW = 10


class VisibleLines:
    """At least three lines in the world frame, prepared for estimates.

    Args:
        lines: The lines.
        settings: Backend and number of triplets.

    Attributes:
        lines: The lines.
        known: What residuals need of them, see known_lines, shape (n, 11).
        triplets: The few that are tried first.

    Raises:
        ParameterError: If the backend is not installed.
    """

    def __init__(self, lines: LineSet, settings: EstimationParameters) -> None:
        self.lines = lines
        self._settings = settings
        self.known: Array = known_lines(lines)
        self.triplets = SceneTriplets(lines, min(_FEW, settings.max_triplets), settings.backend)
        offset = lines.point - self.triplets.center
        self._furthest = _FURTHEST * max(1.0, float(np.abs(offset).max()))

    @cached_property
    def all_triplets(self) -> SceneTriplets:
        """As many triplets as the settings allow: among them are some without wrong matches."""
        return SceneTriplets(self.lines, self._settings.max_triplets, self._settings.backend)

    @cached_property
    def singular(self) -> SingularSet:
        """The singular set of these lines."""
        return singular_set(self.lines)

    def near(self, center: Array) -> bool:
        """Whether a camera centre (3,) in the world is where a camera could see the lines."""
        x, y, z = (center - self.triplets.center).tolist()
        return bool(max(abs(x), abs(y), abs(z)) <= self._furthest)
