# SPDX-License-Identifier: Apache-2.0
"""The figure of the textured cube: what points painted on it say of poses, image by image."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np


def draw(
    off: Mapping[str, tuple[np.ndarray, np.ndarray]], turns: Mapping[str, tuple[Sequence[int], Sequence[float]]]
) -> None:
    """Write the PNG that PLSING_CUBE_FIGURE names.

    Args:
        off: Image and distance of points from where they should be [px], by whose poses are used.
        turns: Image, and turn from the last ones [degrees], by whose poses they are.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10.0, 3.8))
    for name, (images, pixels) in off.items():
        numbers = np.unique(images)
        left.plot(numbers, [np.median(pixels[images == k]) for k in numbers], label=name)
    left.set(yscale="log", xlabel="image", ylabel="points painted on the cube, off [px]", title="Median of the points")
    for name, (numbers, degrees) in list(turns.items())[:-1]:
        right.plot(numbers, degrees, label=name)
    right.set(xlabel="image", ylabel="turn [degrees]", title="From the board row by row, place of the still images")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    left.set_ylim(0.1, 200.0)
    right.set_ylim(0.0, 4.5)
    figure.tight_layout()
    figure.savefig(os.environ["PLSING_CUBE_FIGURE"], dpi=80)
