# SPDX-License-Identifier: Apache-2.0
"""Figures of servo runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")  # files only, so that it works without a screen

import matplotlib.pyplot as plt
from matplotlib.ticker import MaxNLocator

from plsing_ros.arrays import Array
from plsing_ros.figures.segments import segments_in_ball
from plsing_ros.levels import Level
from plsing_ros.simulation.run_record import RunRecord
from plsing_ros.singularities import SingularSet

ALERT_MARKS = {Level.WARN: ("^", "tab:orange"), Level.CRITICAL: ("v", "tab:red")}
RUN_COLORS = ("tab:blue", "tab:red", "tab:green", "tab:purple")


def save_figures(records: Sequence[RunRecord], singular: SingularSet, folder: Path) -> list[Path]:
    """Draw all figures of a set of runs to one target.

    Args:
        records: The runs.
        singular: The singular set of the scene.
        folder: Where to write the PNG files; it must exist.

    Returns:
        The files, in order.
    """
    files = []
    drawings: dict[str, Callable[[Any], None]] = {
        "trajectories": lambda figure: draw_trajectories(figure, records, singular),
        "inverse_condition_number": lambda figure: _draw_condition(figure, records),
        "error_norm": lambda figure: _draw_errors(figure, records),
        "twists": lambda figure: _draw_twists(figure, records),
        "distance_to_target": lambda figure: _draw_distances(figure, records),
    }
    for name, draw in drawings.items():
        figure = plt.figure(figsize=(11, 5.5), layout="constrained")
        draw(figure)
        files.append(folder / f"{name}.png")
        figure.savefig(files[-1], dpi=110)
        plt.close(figure)
    return files


def draw_trajectories(figure: Any, records: Sequence[RunRecord], singular: SingularSet) -> None:
    """Draw runs to one target in two views: with the whole scene, and near the target."""
    target = np.atleast_2d(records[0].target)[-1]
    everything = np.vstack([record.position for record in records])
    scene = np.vstack([singular.lines.point, everything])
    close = np.vstack([[record.position[0] for record in records], target[np.newaxis]])
    views = (
        ("the scene", scene.mean(axis=0), np.abs(scene - scene.mean(axis=0)).max() * 1.1),
        ("near the target", close.mean(axis=0), np.abs(close - close.mean(axis=0)).max() * 1.6),
    )
    for column, (title, center, radius) in enumerate(views):
        axes = figure.add_subplot(1, 2, column + 1, projection="3d")
        draw_lines(
            axes, singular.lines.point, singular.lines.direction, center, radius, color="black", label="observed lines"
        )
        points, directions = singular.transversal_lines
        draw_lines(axes, points, directions, center, radius, color="tab:orange", linestyle="--", label="transversals")
        for record, color in zip(records, RUN_COLORS * len(records), strict=False):
            path = np.where(
                np.abs(record.position - center).max(axis=1, keepdims=True) <= radius, record.position, np.nan
            )
            axes.plot(*path.T, color=color, label=record.name, linewidth=1.5)
            axes.plot(*path[0], "o", color=color, markersize=4)
        axes.plot(*target, "*", color="black", markersize=10, label="target")
        axes.set_xlim(center[0] - radius, center[0] + radius)
        axes.set_ylim(center[1] - radius, center[1] + radius)
        axes.set_zlim(center[2] - radius, center[2] + radius)
        axes.set_box_aspect((1, 1, 1), zoom=0.95)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_major_locator(MaxNLocator(5))
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
        axes.set_zlabel("z [m]")
        axes.set_title(title)
    # The left view has the observed lines as well.
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))


def draw_lines(axes: Any, points: Array, directions: Array, center: Array, radius: float, **style: Any) -> None:
    """Draw the parts of lines that are in a ball; style is that of plot, with a label."""
    label = style.pop("label")
    for segment in segments_in_ball(points, directions, center, radius):
        axes.plot(*segment.T, linewidth=1.2, label=label, **style)
        label = None


def _draw_condition(figure: Any, records: Sequence[RunRecord]) -> None:
    axes = figure.subplots()
    axes.set_yscale("log")
    for record, color in zip(records, RUN_COLORS * len(records), strict=False):
        for alert in record.alerts:
            if alert.level in ALERT_MARKS:
                marker, mark_color = ALERT_MARKS[alert.level]
                value = np.interp(alert.time, record.time, record.inverse_condition_number)
                axes.plot(alert.time, value, marker, color=mark_color, markersize=9, markeredgecolor=color)
    for level, (marker, mark_color) in ALERT_MARKS.items():
        axes.plot([], [], marker, color=mark_color, label=f"alert {level.name}")
    draw_over_time(axes, records, "inverse condition number", lambda record: record.inverse_condition_number)


def _draw_errors(figure: Any, records: Sequence[RunRecord]) -> None:
    axes = figure.subplots()
    axes.set_yscale("log")
    draw_over_time(axes, records, "error norm |s - s*|", lambda record: record.error_norm)


def _draw_distances(figure: Any, records: Sequence[RunRecord]) -> None:
    draw_over_time(figure.subplots(), records, "distance to target [m]", lambda record: record.distance)


def draw_over_time(axes: Any, records: Sequence[RunRecord], label: str, values: Callable[[RunRecord], Array]) -> None:
    """Draw a number of each run over time."""
    for record, color in zip(records, RUN_COLORS * len(records), strict=False):
        axes.plot(record.time, values(record), color=color, label=record.name)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    axes.legend()


def _draw_twists(figure: Any, records: Sequence[RunRecord]) -> None:
    panels = figure.subplots(2, len(records), squeeze=False, sharex="col")
    for column, record in enumerate(records):
        # What is interesting is over when the transient is; the rest is an exponential decay.
        shown = record.time <= min(20.0, record.time[-1])
        for row, (first, letter, unit) in enumerate(((0, "v", "m/s"), (3, "ω", "rad/s"))):
            axes = panels[row, column]
            for axis, name in enumerate("xyz"):
                axes.plot(record.time[shown], record.twist[shown, first + axis], label=f"{letter}_{name}")
            axes.grid(alpha=0.3)
            if column == 0:
                axes.set_ylabel(f"{letter} [{unit}]")
            if column == len(records) - 1:
                axes.legend(loc="right", fontsize="small")
        panels[0, column].set_title(record.name)
        panels[1, column].set_xlabel("time [s]")
