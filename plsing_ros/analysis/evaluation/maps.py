# SPDX-License-Identifier: Apache-2.0
"""How far the singular set of a measured map can be trusted: held against maps as they may be in reality."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from plsing_ros.analysis.evaluation.setup import Setup
from plsing_ros.singularities import singular_set

_STREAM = 100
# Points of the straight path, and of each true locus.
_STEPS, _ON_A_LOCUS = 50, 4
# A true singular centre is announced within so many half widths of a reported locus, or below this z.
_WIDTHS, _MAY_BE_SINGULAR = 3.0, 3.0


@dataclass
class MapResult:
    """What one map as it may be says of the reported one; plain numbers.

    Attributes:
        number: Of the map.
        nearest: Distance of the straight path from its nearest true locus [m], or None if there is none.
        name: Of that locus.
        everywhere: Whether every centre is singular with these lines.
        on_loci: True singular centres that were looked at.
        covered: Of those, within 3 half widths of a reported locus, or with z below 3.
        closest_point: Of the nearest locus to the path, (3,) [m]; empty if there is none.
    """

    number: int
    nearest: float | None = None
    name: str = ""
    everywhere: bool = False
    on_loci: int = 0
    covered: int = 0
    closest_point: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class MapTask:
    """Maps to be drawn, by number."""

    setup: Setup
    numbers: tuple[int, ...]


def check_maps(task: MapTask) -> list[dict[str, Any]]:
    """Return a MapResult as a dictionary for each number."""
    return [vars(_check_map(task.setup, number)) for number in task.numbers]


def _check_map(setup: Setup, number: int) -> MapResult:
    generator = setup.generator(_STREAM, number)
    true, reported, result = singular_set(setup.true_lines(generator)), setup.singular, MapResult(number)
    if true.singular_everywhere:
        result.everywhere, result.nearest, result.name = True, 0.0, "every camera centre"
        return result
    start, target = setup.start.translation, setup.target.translation
    path = start + np.linspace(0.0, 1.0, _STEPS)[:, np.newaxis] * (target - start)
    for center in path:
        nearest = true.nearest_locus(center)
        if nearest is not None and (result.nearest is None or nearest.distance < result.nearest):
            result.nearest, result.name = nearest.distance, nearest.name
            result.closest_point = nearest.closest_point.tolist()
    for locus in true.loci:
        rows = generator.permutation(len(locus.samples))[:_ON_A_LOCUS]
        for center in locus.samples[rows]:
            result.on_loci += 1
            z = reported.proximity(center).z
            near = any(each.distance(center) <= _WIDTHS * each.half_width for each in reported.loci)
            result.covered += near or (z is not None and z < _MAY_BE_SINGULAR)
    return result


def map_tasks_of(setup: Setup, maps: int, at_once: int = 5) -> dict[str, MapTask]:
    """Return the maps to be drawn, some in each task; one if the lines are known exactly."""
    count = 1 if setup.map.exact else maps
    numbers = [tuple(range(begin, min(begin + at_once, count))) for begin in range(0, count, at_once)]
    return {f"maps {each[0]} to {each[-1]}": MapTask(setup, each) for each in numbers}
