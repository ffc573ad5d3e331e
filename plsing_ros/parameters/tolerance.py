# SPDX-License-Identifier: Apache-2.0
"""Parameters that say what is still an error of measurement and what is a contradiction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from plsing_ros.features.consistency import Tolerances
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.task import FeatureParameters

_DEFAULT = Tolerances()


@dataclass(frozen=True)
class ToleranceParameters(FeatureParameters):
    """How far features may be off before they are refused as contradictory; docs/refusals.md."""

    tolerance_image: float = parameter(
        _DEFAULT.image,
        "tolerance.image",
        "Angle between the planes of an image line and of its 3-D line, map and pose left out",
        unit="rad",
        minimum=1e-6,
        maximum=1.5,
    )
    tolerance_position: float = parameter(
        _DEFAULT.position,
        "tolerance.position",
        "Of a line in the scene, and of a camera pose",
        unit="m",
        minimum=1e-9,
        maximum=1e6,
    )
    tolerance_rotation: float = parameter(
        _DEFAULT.rotation, "tolerance.rotation", "Of a camera pose", unit="rad", minimum=1e-9, maximum=3.2
    )
    tolerance_direction: float = parameter(
        _DEFAULT.direction,
        "tolerance.direction",
        "Of a 3-D line, at the pose that fits all",
        unit="rad",
        minimum=1e-9,
        maximum=1.5,
    )
    tolerance_distance: float = parameter(
        _DEFAULT.distance,
        "tolerance.distance",
        "Of a 3-D line, as a share of its distance from the camera",
        minimum=0.0,
        maximum=10.0,
    )
    tolerance_scale: float = parameter(
        _DEFAULT.scale,
        "tolerance.scale",
        "Of all 3-D lines together, as a share: a wrong base of a stereo camera",
        minimum=0.0,
        maximum=10.0,
    )

    @cached_property
    def tolerances(self) -> Tolerances:
        """All of them."""
        return Tolerances(
            self.tolerance_image,
            self.tolerance_position,
            self.tolerance_rotation,
            self.tolerance_direction,
            self.tolerance_distance,
            self.tolerance_scale,
        )
