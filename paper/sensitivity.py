# SPDX-License-Identifier: Apache-2.0
"""What the paper leaves open, decided otherwise than in our plain runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from plsing_ros.simulation.servo_task import ServoTask

# Where runs to a fixed target end here [m].
ARRIVED = 0.01

# Of the paper's four lines, the point nearest to all of them [m].
_MIDDLE_OF_LINES = (0.83, 0.28, 0.09)


# Keys of the choices with noise on the image lines.
IMAGE_NOISE = ("both", "image")


@dataclass(frozen=True)
class Choice:
    """One thing decided otherwise than in our plain runs.

    Attributes:
        key: Short name, for the table's columns.
        description: In words.
        change: Makes the changed task of a plain one.
    """

    key: str
    description: str
    change: Callable[[ServoTask], ServoTask]


def _viewed(**changes: Any) -> Callable[[ServoTask], ServoTask]:
    return lambda task: replace(task, view=replace(task.view, **changes))


def _changed(**changes: Any) -> Callable[[ServoTask], ServoTask]:
    return lambda task: replace(task, **changes)


CHOICES = (
    Choice(
        "view a",
        "the optical axis goes through the origin from everywhere, so that the camera turns",
        _viewed(seen_from=None),
    ),
    Choice("view b", "it goes through the middle of the lines and not the origin", _viewed(viewed=_MIDDLE_OF_LINES)),
    Choice("view c", "the camera is rolled by 90°", _viewed(roll=np.pi / 2)),
    Choice("view d", "it is tilted by 20°", _viewed(tilt=np.deg2rad(20.0))),
    Choice("20 ms", "time step 0.02 s in the place of 0.04 s", _changed(time_step=0.02)),
    Choice("80 ms", "time step 0.08 s", _changed(time_step=0.08)),
    Choice(
        "both",
        "the noise is on the image lines as well, which are those of the noisy 3-D lines",
        _changed(noise_on="both"),
    ),
    Choice("image", "the noise is on the image lines only", _changed(noise_on="image")),
    Choice("seed 1", "other noise", _changed(seed=1)),
    Choice("seed 2", "other noise", _changed(seed=2)),
)


def shortened(task: ServoTask) -> ServoTask:
    """Return a run to a fixed target that ends earlier: the last decade of an exponential decay shows nothing new."""
    return replace(task, arrived=ARRIVED) if task.arrived else task
