# SPDX-License-Identifier: Apache-2.0
"""A scene with its singular set, and what is measured of a camera that sees its lines."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import (
    Conditioning,
    LineObservation,
    decompose,
    interaction_conditioning,
    smallest_over_largest,
)
from plsing_ros.features.consistency import ConsistencyCheck, left_out_text
from plsing_ros.features.target import MINIMUM_LINES
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.monitoring.approach import ApproachTable
from plsing_ros.monitoring.measurement import Measurement
from plsing_ros.parameters import MonitorParameters
from plsing_ros.singularities import SingularSet


class MonitoredScene:
    """A scene and the parameters that measurements in it depend on.

    Attributes:
        singular: Its singular set.
        approaches: Closest approaches to that set.
        check: Finds contradictions between features and the scene.
    """

    def __init__(self, singular: SingularSet, parameters: MonitorParameters) -> None:
        self.singular = singular
        # Computed now, not in the first cycle that needs it.
        _ = singular.normal_condition
        self.approaches = ApproachTable(singular)
        self.check = ConsistencyCheck(singular.lines, parameters.tolerances)
        self.use(parameters)

    def use(self, parameters: MonitorParameters) -> None:
        """Measure by other parameters from now on."""
        self._length, self._columns = parameters.characteristic_length, parameters.columns
        self._in_all_directions = len(parameters.columns) == 6
        if parameters.tolerances != self.check.tolerances:
            self.check = ConsistencyCheck(self.singular.lines, parameters.tolerances)
        # Also where the motion that is lost is one that nobody asked for.
        everywhere = self.singular.singular_everywhere and self._in_all_directions
        self.singular_everywhere = self.singular.description if everywhere else ""

    def without_unknown(self, observation: LineObservation) -> tuple[LineObservation, str]:
        """Return an observation without the lines that are not in the scene, and what to say about them."""
        known = self.singular.lines.ids
        if observation.ids == known:
            return observation, ""
        unknown = sorted(set(observation.ids).difference(known))
        if not unknown:
            return observation, ""
        kept = observation.select([row for row, i in enumerate(observation.ids) if i not in unknown])
        return kept, f"; {left_out_text(unknown)}"

    def measure(
        self,
        lines: LineSet,
        pose: Pose | None,
        target_inverse: float | None,
        covariances: Array | None = None,
    ) -> Measurement:
        """Return what is measured of a camera.

        Args:
            lines: That it sees, in its frame.
            pose: T_world_camera, if it is known.
            target_inverse: Inverse condition number of these lines at the target, or None.
            covariances: Of their image lines, as LineObservation has them, or None.
        """
        numbers = interaction_conditioning(lines, self._length)
        ruling = self.ruling(numbers)
        if pose is None:
            return Measurement(numbers, ruling, target_inverse)
        distances = self.singular.distance_arrays(pose)
        near = self.singular.proximity(pose, ids=lines.ids, covariances=covariances)
        return Measurement(numbers, ruling, target_inverse, distances, self.approaches.nearest(distances), near)

    def ruling(self, numbers: Conditioning) -> Conditioning:
        """Return the conditioning of the degrees of freedom in use, by that of all."""
        if self._in_all_directions:
            return numbers
        # The left singular vectors change nothing.
        used = np.zeros(6)
        used[list(self._columns)] = 1.0
        part = decompose(numbers.singular_values[:, np.newaxis] * numbers.right * used)
        values = part.singular_values[: len(self._columns)]
        return numbers._replace(
            singular_values=values, inverse_condition_number=smallest_over_largest(values.tolist()), right=part.right
        )


def usable_lines(observation: LineObservation) -> LineSet:
    """Return the 3-D lines of an observation; ObservationError if it has too few of them."""
    lines = observation.lines_camera
    if lines is None and observation.usable_ids:
        why = observation.verdict_reason or "directions and moments are empty"
        raise ObservationError(f"features have no 3-D lines ({why})")
    if lines is None or len(lines.ids) < MINIMUM_LINES:
        raise ObservationError(
            f"{len(observation.usable_ids)} of {len(observation.ids)} lines are usable "
            f"({list(observation.usable_ids)}); at least {MINIMUM_LINES} are needed"
        )
    return lines
