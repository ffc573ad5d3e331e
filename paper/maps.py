# SPDX-License-Identifier: Apache-2.0
"""The planes and paths of the maps in docs/results/paper.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from paper.figures import save_figure
from paper.scenes import four_lines, three_lines
from paper.tasks import QUADRIFOLIUM_MIDDLES, STARTS_FOUR
from plsing_ros.figures.condition_map import MapPlane, condition_map
from plsing_ros.simulation.near_transversal import POINT_ON_TRANSVERSAL
from plsing_ros.simulation.run_record import RunRecord
from plsing_ros.singularities import singular_set


def map_planes() -> tuple[MapPlane, ...]:
    """Return the planes of the four-line map."""
    first = singular_set(four_lines()).transversals[0]
    to_second = np.cross(first.direction, [0.0, 0.0, 1.0])
    return (
        MapPlane.across("across L_M at P_M", POINT_ON_TRANSVERSAL, first.direction, 1.0),
        MapPlane.across("along L_M, through P_M", POINT_ON_TRANSVERSAL, to_second, 4.0),
        MapPlane.across("x constant, through P_1", QUADRIFOLIUM_MIDDLES[1], (1.0, 0.0, 0.0), 0.6),
        MapPlane.across("z constant, through P_2", QUADRIFOLIUM_MIDDLES[2], (0.0, 0.0, 1.0), 2.0),
    )


def save_maps(folder: Path, records: Mapping[str, Sequence[RunRecord]]) -> Path:
    """Draw the maps with the paths of Starts 1 and 2, if those are there, and return the PNG file."""
    colors = ("tab:pink", "tab:red")
    runs = records.get(STARTS_FOUR, ())[:2]
    figure = condition_map(
        singular_set(four_lines()),
        map_planes(),
        singular_set(three_lines()).surfaces,
        [(run.name, color, run.position) for run, color in zip(runs, colors, strict=False)],
    )
    return save_figure(figure, folder / "map.png")
