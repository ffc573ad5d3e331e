# SPDX-License-Identifier: Apache-2.0
"""The inverse condition number on planes through a scene, with the singular set drawn in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet
from plsing_ros.planning import path_conditions as path_conditions
from plsing_ros.singularities import SingularSet, Surface

# Loci nearer to a plane than this share of its half size are drawn although they are not in it.
_NEAR = 0.02

# Lower end of the colours, and how many there are: few, so that values can be read and files are small.
_LOWEST, _COLORS = 1e-5, 16

_SURFACE_COLORS = {"quadric": "white", "cubic surface": "deepskyblue"}


@dataclass(frozen=True, eq=False)
class MapPlane:
    """A square of camera centres.

    Attributes:
        title: For the figure.
        center: Shape (3,) [m].
        right: Unit vector along the horizontal axis, shape (3,).
        up: Unit vector along the vertical axis, shape (3,), orthogonal to right.
        half_size: Half the edge [m].
    """

    title: str
    center: Array
    right: Array
    up: Array
    half_size: float

    @classmethod
    def across(cls, title: str, center: npt.ArrayLike, normal: npt.ArrayLike, half_size: float) -> MapPlane:
        """Return the square around a point (3,) [m] across a normal (3,) of any length, z upwards where possible."""
        n = np.asarray(normal, dtype=float)
        n = n / np.linalg.norm(n)
        helper = np.array([0.0, 0.0, 1.0]) if abs(n[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
        right = np.cross(helper, n)
        right /= np.linalg.norm(right)
        return cls(title, np.asarray(center, dtype=float), right, np.cross(n, right), half_size)

    def coordinates(self, points: Array) -> Array:
        """Return (right, up, distance from the plane) of points (k, 3), shape (k, 3) [m]."""
        frame = np.stack([self.right, self.up, np.cross(self.right, self.up)])
        coordinates: Array = (points - self.center) @ frame.T
        return coordinates

    def grid(self, resolution: int) -> Array:
        """Return camera centres on a grid with that many points along each edge, shape (rows, columns, 3) [m]."""
        ticks = np.linspace(-self.half_size, self.half_size, resolution)
        grid: Array = (
            self.center + ticks[np.newaxis, :, np.newaxis] * self.right + ticks[:, np.newaxis, np.newaxis] * self.up
        )
        return grid


def inverse_condition_numbers(lines: LineSet, centers: Array, viewed: npt.ArrayLike) -> Array:
    """Return the inverse condition number of the interaction matrix for many camera centres.

    Args:
        lines: The scene.
        centers: Shape (k, 3) [m].
        viewed: Point that the optical axis goes through, shape (3,) [m]; a camera there gets 0.

    Returns:
        Raw, in [0, 1], shape (k,); 0 where a line has no image, or the optical axis would be vertical.
    """
    # As Pose.look_at, for all cameras at once.
    forward = np.asarray(viewed, dtype=float) - centers
    distance = np.linalg.norm(forward, axis=1)
    z = forward / np.where(distance > 0.0, distance, 1.0)[:, np.newaxis]
    x = np.cross([0.0, 0.0, -1.0], z)
    sideways = np.linalg.norm(x, axis=1)
    usable = (distance > 0.0) & (sideways > 1e-9)
    x /= np.where(usable, sideways, 1.0)[:, np.newaxis]
    rotation = np.stack([x, np.cross(z, x), z], axis=2)
    inverse = np.zeros(len(centers))
    inverse[usable] = path_conditions.inverse_condition_numbers(lines, rotation[usable], centers[usable])
    return inverse


def condition_map(
    singular: SingularSet,
    planes: Sequence[MapPlane],
    surfaces: Sequence[Surface] = (),
    paths: Sequence[tuple[str, str, Array]] = (),
    resolution: int = 120,
) -> Any:
    """Draw the inverse condition number on planes, of cameras that look at the origin.

    Args:
        singular: The singular set of the scene.
        planes: Which ones, side by side.
        surfaces: Surfaces whose cuts with the planes are drawn, such as those of a triplet of the lines.
        paths: Name, colour and camera centres (k, 3) [m] of paths to be projected on the planes.
        resolution: Cameras along each edge.

    Returns:
        The matplotlib figure.
    """
    figure = plt.figure(figsize=(3.6 * len(planes), 3.9), layout="constrained")
    panels = figure.subplots(1, len(planes), squeeze=False)[0]
    grids = [plane.grid(resolution) for plane in planes]
    values = [inverse_condition_numbers(singular.lines, grid.reshape(-1, 3), np.zeros(3)) for grid in grids]
    norm = LogNorm(_LOWEST, max(float(each.max()) for each in values))
    for axes, plane, grid, value in zip(panels, planes, grids, values, strict=True):
        size = plane.half_size
        image = axes.imshow(
            np.maximum(value, _LOWEST).reshape(resolution, resolution),
            origin="lower",
            extent=(-size, size, -size, size),
            norm=norm,
            cmap=plt.get_cmap("viridis", _COLORS),
            interpolation="nearest",
        )
        ticks = np.linspace(-size, size, resolution)
        for surface in surfaces:
            cut = surface.value(grid.reshape(-1, 3)).reshape(resolution, resolution)
            if cut.min() < 0.0 < cut.max():
                axes.contour(ticks, ticks, cut, [0.0], colors=_SURFACE_COLORS[surface.name], linewidths=0.8)
        _draw_straight(axes, plane, singular.lines.point, singular.lines.direction, "black", "-")
        _draw_straight(axes, plane, *singular.transversal_lines, "tab:orange", "--")
        points = plane.coordinates(singular.isolated_points)
        points = points[np.abs(points[:, 2]) <= _NEAR * size]
        axes.plot(points[:, 0], points[:, 1], "o", color="red", markersize=5, markeredgecolor="white")
        for _, color, centers in paths:
            at = plane.coordinates(centers)
            near = np.abs(at[:, 2]) <= size
            axes.plot(*np.where(near[:, np.newaxis], at[:, :2], np.nan).T, color=color, linewidth=1.0)
        axes.set(xlim=(-size, size), ylim=(-size, size), title=plane.title, xlabel="[m]")
        axes.title.set_fontsize("medium")
    figure.colorbar(image, ax=list(panels), label="inverse condition number", location="right", shrink=0.8)
    handles = [
        Line2D([], [], color="black", label="observed line", marker="x"),
        Line2D([], [], color="tab:orange", linestyle="--", label="transversal", marker="x"),
        Line2D([], [], color="red", linestyle="", marker="o", markeredgecolor="white", label="isolated point"),
        *(Line2D([], [], color=_SURFACE_COLORS[each.name], label=each.name) for each in surfaces),
        *(Line2D([], [], color=color, label=name) for name, color, _ in paths),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), facecolor="lightgray")
    return figure


def _draw_straight(axes: Any, plane: MapPlane, points: Array, directions: Array, color: str, style: str) -> None:
    """Draw lines that lie in a plane as lines, and mark where others pass through it."""
    starts = plane.coordinates(points)
    along_lines = plane.coordinates(points + directions) - starts
    for i in range(len(points)):
        start, along = starts[i], along_lines[i]
        if abs(along[2]) < 1e-6:
            if abs(start[2]) <= _NEAR * plane.half_size:
                ends = start[:2] + np.outer([-1e3, 1e3], along[:2])
                axes.plot(ends[:, 0], ends[:, 1], color=color, linestyle=style, linewidth=1.4)
            continue
        crossing = start - along * (start[2] / along[2])
        if np.abs(crossing[:2]).max() <= plane.half_size:
            axes.plot(*crossing[:2], "x", color=color, markersize=8, markeredgewidth=2)
