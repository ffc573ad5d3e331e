# SPDX-License-Identifier: Apache-2.0
"""Parameters of the feature simulator."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.stepping import SteppingParameters


@dataclass(frozen=True)
class SimulatorParameters(SteppingParameters):
    """What the simulated camera sees of the lines."""

    noise: float = parameter(
        0.0,
        "noise",
        "Standard deviation of the Gaussian noise on each Plücker coordinate of the lines in the camera frame "
        "(directions without unit, moments in m)",
        minimum=0.0,
        maximum=1.0,
    )
    noise_on: str = parameter(
        "both",
        "noise_on",
        "What has the noise: lines (the 3-D lines only, as a badly known scene), image (the image lines only), or both",
        choices=("both", "lines", "image"),
    )
    image_only: bool = parameter(
        False,
        "image_only",
        "Publish image lines without their 3-D lines, as a tracker without depth does",
    )
    seed: int = parameter(0, "seed", "Seed of the noise", minimum=0, maximum=2**31 - 1, live=False)
