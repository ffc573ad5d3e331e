# SPDX-License-Identifier: Apache-2.0
"""The figure of the pose filter: errors over the distance to the nearest locus, beside single images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

_EDGES = np.geomspace(2e-3, 0.5, 15)
# A bin with fewer frames says nothing of the 95 %.
_MIN_FRAMES = 20


def draw(records: Mapping[str, Sequence[np.ndarray]], path: str) -> None:
    """Write a PNG.

    Args:
        records: Of each way to find the pose, by its name, for each sequence: distance and error of each frame in the
            first two columns.
        path: Of the file.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7.5, 4.5))
    for name, runs in records.items():
        rows = np.concatenate([run[:, :2] for run in runs])
        # What is nearer than the first edge is in the first bin.
        number = np.digitize(np.clip(rows[:, 0], _EDGES[0], None), _EDGES) - 1
        bins = [i for i in range(len(_EDGES) - 1) if np.sum(number == i) >= _MIN_FRAMES]
        middle = np.sqrt(_EDGES[:-1] * _EDGES[1:])[bins]
        low, median, high = np.array([np.quantile(rows[number == i, 1], [0.05, 0.5, 0.95]) for i in bins]).T
        (line,) = axes.plot(middle, median, label=name, lw=2.0)
        axes.fill_between(middle, low, high, color=line.get_color(), alpha=0.2, lw=0)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="distance to the nearest singular locus [m]",
        ylabel="error of the position [m]",
        title="Median, and 5 % to 95 % of the frames",
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right")
    figure.tight_layout()
    figure.savefig(path, dpi=90)
