# SPDX-License-Identifier: Apache-2.0
"""A self-contained page that shows a scene, its singular set and camera paths, to be turned around in a browser."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.analysis.loci_text import scene_in_words
from plsing_ros.arrays import Array
from plsing_ros.errors import PlsingError
from plsing_ros.figures.locus_widths import width_triangles
from plsing_ros.figures.segments import segments_in_ball
from plsing_ros.singularities import Kind, SingularSet, Surface, surface_triangles

_SURFACE_COLORS = {Kind.QUADRIC: "#8fb0d0", Kind.CUBIC: "#d9b38c", Kind.PLANE: "#9ecf9e"}
_WIDTH_COLOR = "#d62728"
# Sentences below the picture; more are left to the command.
_SENTENCES = 10
_PATH_COLORS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf")


def require_plotly() -> Any:
    """Return plotly.graph_objects.

    Raises:
        PlsingError: If plotly is not installed.
    """
    try:
        from plotly import graph_objects
    except ImportError as error:
        raise PlsingError(
            "the interactive page needs plotly, which is not installed (pip install plotly, or Ubuntu's package "
            f"python3-plotly): {error}"
        ) from None
    return graph_objects


def save_scene_page(
    file: Path,
    title: str,
    singular: SingularSet,
    surfaces: Sequence[Surface] = (),
    paths: Sequence[tuple[str, Array]] = (),
    radius: float = 12.0,
    surface_radius: float = 4.0,
) -> Path:
    """Write the page; it needs no network.

    Args:
        file: HTML file to write.
        title: Of the page.
        singular: The singular set of the scene.
        surfaces: Surfaces to draw beside those of the set; a cubic is hidden until it is switched on in the legend.
        paths: Names and camera centres, shape (k, 3) [m].
        radius: How far from the scene's centre lines are drawn, and isolated points and paths kept [m].
        surface_radius: The same for surfaces [m].

    Raises:
        PlsingError: If plotly is not installed, or the file cannot be written.
    """
    graph_objects = require_plotly()
    center = singular.frame.center
    figure = graph_objects.Figure()
    for name, line in zip(
        (f"line {i}" for i in singular.lines.ids),
        _segments(singular.lines.point, singular.lines.direction, center, radius),
        strict=True,
    ):
        figure.add_trace(_curve(graph_objects, name, line, {"color": "black", "width": 5}))
    for transversal in singular.transversals:
        line = _segments(transversal.point[np.newaxis], transversal.direction[np.newaxis], center, radius)[0]
        figure.add_trace(
            _curve(graph_objects, transversal.name, line, {"color": "darkorange", "width": 5, "dash": "dash"})
        )
    names = [f"isolated point {i}" for i in range(1, len(singular.isolated_points) + 1)]
    near = np.linalg.norm(singular.isolated_points - center, axis=1) <= radius
    x, y, z = singular.isolated_points[near].T
    figure.add_trace(
        graph_objects.Scatter3d(
            x=x,
            y=y,
            z=z,
            mode="markers",
            name="isolated points",
            text=[name for name, keep in zip(names, near, strict=True) if keep],
            marker={"color": "red", "size": 5},
        )
    )
    for curve in singular.curves:
        points = curve.polyline(center, radius)
        figure.add_trace(_curve(graph_objects, curve.name, points, {"color": "red", "width": 5}))
    for surface in (*singular.surfaces, *surfaces):
        triangles = surface_triangles(surface, center, surface_radius, 36)
        look = {"color": _SURFACE_COLORS[surface.kind], "opacity": 0.4}
        shown = surface.kind is not Kind.CUBIC
        figure.add_trace(_mesh(graph_objects, surface.name, triangles, look, shown))
    # Bands are of interest where the map is measured: there, everything in them may be singular.
    for locus in singular.loci:
        triangles = width_triangles(locus, center, radius, surface_radius)
        if len(triangles):
            name = f"within {locus.half_width:.2g} m of {locus.name}"
            look = {"color": _WIDTH_COLOR, "opacity": 0.12}
            figure.add_trace(_mesh(graph_objects, name, triangles, look, not singular.lines.exact))
    for number, (name, centers) in enumerate(paths):
        inside = np.linalg.norm(centers - center, axis=1, keepdims=True) <= radius
        kept = np.where(inside, centers, np.nan)
        figure.add_trace(
            _curve(graph_objects, name, kept, {"color": _PATH_COLORS[number % len(_PATH_COLORS)], "width": 4})
        )
    axis = {"showspikes": False}
    words = [html.escape(each) for each in scene_in_words(singular)]
    if len(words) > _SENTENCES + 2:
        words[_SENTENCES + 2 :] = [f"and {len(words) - _SENTENCES - 2} more"]
    figure.update_layout(
        title=title,
        scene={
            "aspectmode": "data",
            "xaxis": {**axis, "title": {"text": "x [m]"}},
            "yaxis": {**axis, "title": {"text": "y [m]"}},
            "zaxis": {**axis, "title": {"text": "z [m]"}},
        },
        legend={"itemsizing": "constant"},
        margin={"l": 0, "r": 0, "t": 50, "b": 30 + 18 * len(words)},
    )
    text = "<br>".join(words)
    below = {"xref": "paper", "yref": "paper", "x": 0.01, "y": 0.0, "xanchor": "left", "yanchor": "top"}
    figure.add_annotation(text=text, showarrow=False, align="left", font={"size": 12}, **below)
    try:
        figure.write_html(file, include_plotlyjs=True, full_html=True)
    except OSError as error:
        raise PlsingError(f"cannot write the page {file}: {error}") from None
    return file


def _segments(points: Array, directions: Array, center: Array, radius: float) -> list[Array]:
    """Return the parts of lines in a ball, each shape (2, 3); a line that misses it has no points."""
    found = [segments_in_ball(points[[i]], directions[[i]], center, radius) for i in range(len(points))]
    return [each[0] if len(each) else np.full((2, 3), np.nan) for each in found]


def _curve(graph_objects: Any, name: str, points: Array, line: dict[str, Any]) -> Any:
    # Five digits are a hundredth of a millimetre here, and half the page.
    x, y, z = np.round(points, 5).T
    return graph_objects.Scatter3d(x=x, y=y, z=z, mode="lines", name=name, line=line)


def _mesh(graph_objects: Any, name: str, triangles: Array, look: dict[str, Any], shown: bool) -> Any:
    # Shared corners once, so that the page is small and the shading smooth.
    points, index = np.unique(np.round(triangles.reshape(-1, 3), 4), axis=0, return_inverse=True)
    x, y, z = points.T
    i, j, k = index.reshape(-1, 3).T
    return graph_objects.Mesh3d(
        x=x,
        y=y,
        z=z,
        i=i,
        j=j,
        k=k,
        name=name,
        showlegend=True,
        visible=True if shown else "legendonly",
        hovertext=name,
        **look,
    )
