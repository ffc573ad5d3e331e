# SPDX-License-Identifier: Apache-2.0
"""The figures of docs/results/paper.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from paper.tasks import QUADRIFOLIA, STARTS_FIVE, STARTS_FOUR, TRAJECTORIES
from plsing_ros.arrays import Array
from plsing_ros.figures.servo_runs import RUN_COLORS, draw_lines, draw_over_time, draw_trajectories
from plsing_ros.simulation.near_transversal import GAIN
from plsing_ros.simulation.run_record import RunRecord
from plsing_ros.simulation.servo_task import LOST
from plsing_ros.singularities import SingularSet

_DPI = 95

# How much of a run to a fixed target is drawn [s]; the rest is an exponential decay.
_SHOWN = 40.0


def save_paper_figures(
    records: Mapping[str, Sequence[RunRecord]], singular: Mapping[str, SingularSet], folder: Path
) -> dict[str, list[Path]]:
    """Draw the figures of all groups of runs that are there.

    Args:
        records: By group.
        singular: The singular set of each group's scene.
        folder: Where to write the PNG files; it must exist.

    Returns:
        The files of each group, in order.
    """
    drawings: dict[str, dict[str, Callable[[Any, Sequence[RunRecord], SingularSet], None]]] = {
        STARTS_FOUR: {"p4l_starts_paths": draw_trajectories, "p4l_starts": _starts},
        TRAJECTORIES: {"p4l_trajectories": _trajectories},
        QUADRIFOLIA: {"p4l_quadrifolia": _quadrifolia},
        STARTS_FIVE: {"p5l_starts_paths": draw_trajectories, "p5l_starts": _starts},
    }
    files: dict[str, list[Path]] = {}
    for group, of_group in drawings.items():
        for name, draw in of_group.items() if group in records else ():
            figure = plt.figure(figsize=(10, 5), layout="constrained")
            draw(figure, records[group], singular[group])
            files.setdefault(group, []).append(save_figure(figure, folder / f"{name}.png"))
    return files


def save_law_figures(by_law: Mapping[str, Mapping[str, Sequence[RunRecord]]], folder: Path) -> dict[str, list[Path]]:
    """Draw one run to a moving target of each group that has such runs, with all laws.

    Args:
        by_law: Records by law and group.
        folder: Where to write the PNG files; it must exist.

    Returns:
        The files of each group.
    """
    files = {}
    for group, number, name in ((TRAJECTORIES, 0, "p4l_trajectories_laws"), (QUADRIFOLIA, 4, "p4l_quadrifolia_laws")):
        runs = [replace(of[group][number], name=law) for law, of in by_law.items() if group in of]
        if runs:
            figure = plt.figure(figsize=(10, 3.5), layout="constrained")
            figure.suptitle(next(iter(by_law.values()))[group][number].name)
            _laws(figure, runs)
            files[group] = [save_figure(figure, folder / f"{name}.png")]
    return files


def save_figure(figure: Any, file: Path) -> Path:
    """Write a figure as PNG, close it, and return the file."""
    # Nothing in the file that changes from run to run.
    figure.savefig(file, dpi=_DPI, metadata={"Software": None})
    plt.close(figure)
    return file


def _starts(figure: Any, runs: Sequence[RunRecord], singular: SingularSet) -> None:  # noqa: ARG001
    panels = figure.subplots(2, 2, sharex=True)
    drawings: tuple[tuple[str, Callable[[RunRecord], Array]], ...] = (
        ("inverse condition number", lambda run: run.inverse_condition_number),
        ("error norm |s - s*|", lambda run: run.error_norm),
        ("|v| [m/s]", lambda run: run.linear_speed),
        ("distance to target [m]", lambda run: run.distance),
    )
    for axes, (label, values) in zip(panels.flat, drawings, strict=True):
        draw_over_time(axes, runs, label, values)
        axes.set_yscale("log")
        axes.set_xlim(0.0, _SHOWN)
        shown = np.concatenate([values(run)[run.time <= _SHOWN] for run in runs])
        axes.set_ylim(0.7 * shown[shown > 0.0].min(), 1.4 * shown.max())
        if axes is not panels[0, 0]:
            axes.get_legend().remove()
    start = max(run.error_norm[0] for run in runs)
    time = np.array([0.0, _SHOWN])
    panels[0, 1].plot(time, start * np.exp(-GAIN * time), color="black", linestyle=":", linewidth=1.0)
    for axes in panels[0]:
        axes.set_xlabel("")


def _trajectories(figure: Any, runs: Sequence[RunRecord], singular: SingularSet) -> None:
    left, right = figure.subfigures(1, 2, width_ratios=(1.1, 1.0))
    axes = left.add_subplot(projection="3d")
    middle = np.mean([run.target.mean(axis=0) for run in runs], axis=0)
    radius = 1.5
    draw_lines(
        axes,
        *singular.transversal_lines,
        middle,
        1.6 * radius,
        color="tab:orange",
        linestyle="--",
        label="transversal L_N",
    )
    for run, color in zip(runs, RUN_COLORS, strict=False):
        axes.plot(*run.target.T, color="black", linestyle=":", linewidth=1.0)
        inside = np.abs(run.position - middle).max(axis=1, keepdims=True) <= 1.3 * radius
        axes.plot(*np.where(inside, run.position, np.nan).T, color=color, label=run.name, linewidth=1.3)
    limits = np.stack([middle - 1.2 * radius, middle + 1.2 * radius], axis=1)
    axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2], xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.set_box_aspect((1, 1, 1), zoom=0.85)
    left.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=3)
    panels = right.subplots(2, 1, sharex=True)
    draw_over_time(panels[0], runs, "|v| [m/s]", lambda run: run.linear_speed)
    draw_over_time(panels[1], runs, "tracking error [m]", lambda run: run.distance)
    for each in panels:
        each.set_yscale("log")
        each.set_ylim(0.01, None)
        each.axvline(25.0, color="tab:orange", linestyle="--", linewidth=1.0)
    panels[0].set_xlabel("")
    panels[1].get_legend().remove()


def _laws(figure: Any, runs: Sequence[RunRecord]) -> None:
    drawings: tuple[tuple[str, Callable[[RunRecord], Array]], ...] = (
        ("tracking error [m]", lambda run: run.distance),
        ("|v| [m/s]", lambda run: run.linear_speed),
        ("inverse condition number", lambda run: run.inverse_condition_number),
    )
    panels = figure.subplots(1, len(drawings))
    for axes, (label, values) in zip(panels, drawings, strict=True):
        draw_over_time(axes, runs, label, values)
        axes.set_yscale("log")
        axes.get_legend().remove()
    for axes in panels[:2]:
        axes.set_ylim(0.005, None)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(runs))


def _quadrifolia(figure: Any, runs: Sequence[RunRecord], singular: SingularSet) -> None:  # noqa: ARG001
    panels = figure.subplots(1, 3, width_ratios=(1.0, 1.1, 1.1))
    zero, one = runs[0], runs[1]
    axes = panels[0]
    axes.plot(one.target[:, 1], one.target[:, 2], color="tab:red", linewidth=1.0, label="wanted")
    axes.plot(one.position[:, 1], one.position[:, 2], color="black", linewidth=1.0, label="camera")
    axes.set(xlabel="y [m]", ylabel="z [m]", title=one.name, aspect="equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2, frameon=False)
    draw_over_time(panels[1], (zero, one), "translation error [m]", lambda run: run.distance)
    panels[1].set_ylim(0.0, None)
    for crossing in np.arange(4) * 5.0 + 2.5:
        panels[1].axvline(crossing, color="tab:orange", linestyle="--", linewidth=1.0)
    places = np.arange(len(runs))
    axes = panels[2]
    axes.bar(places - 0.2, [run.distance.max() for run in runs], 0.4, color="tab:red", label="largest")
    axes.bar(places + 0.2, [np.median(run.distance) for run in runs], 0.4, color="tab:blue", label="median")
    axes.set_yscale("log")
    # A camera that is lost can be any distance away.
    axes.set_ylim(0.01, LOST)
    axes.set_xticks(places, [run.name for run in runs], fontsize="small")
    axes.set_ylabel("translation error [m]")
    axes.grid(alpha=0.3, axis="y")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.07), ncols=2, frameon=False)
