# SPDX-License-Identifier: Apache-2.0
"""Figures of the camera demo: contact sheets with what the tracker saw, and curves of all runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")  # files only, so that it works without a screen

import matplotlib.pyplot as plt

from plsing_ros.arrays import Array
from plsing_ros.figures.servo_runs import ALERT_MARKS, RUN_COLORS, draw_lines
from plsing_ros.simulation.camera_record import CameraRecord
from plsing_ros.singularities import singular_set

_COLUMNS = 6


def save_contact_sheet(record: CameraRecord, look: Callable[[Array], Any], folder: Path) -> Path:
    """Draw some instants of a run: the tracker's overlay, and below it the arm.

    Args:
        record: The run.
        look: Takes joints and returns a picture of the arm, or None.
        folder: Where to write; it must exist.
    """
    rows = np.unique(np.linspace(0, len(record.pictures) - 1, min(_COLUMNS, len(record.pictures))).round().astype(int))
    chosen = [record.pictures[row] for row in rows]
    outside = [look(picture.joints) for picture in chosen]
    heights = 2 if all(each is not None for each in outside) else 1
    figure, axes = plt.subplots(
        heights, len(chosen), figsize=(3.2 * len(chosen), 2.7 * heights), squeeze=False, layout="constrained"
    )
    for column, picture in enumerate(chosen):
        axes[0, column].imshow(picture.pixels)
        axes[0, column].set_title(f"{picture.time:.1f} s", fontsize=10)
        if heights == 2:
            axes[1, column].imshow(outside[column])
    for each in axes.ravel():
        each.set_axis_off()
    figure.suptitle(f"{record.scene.name}: {record.scene.note}", fontsize=11)
    file = folder / f"{record.scene.name}.png"
    figure.savefig(file, dpi=100)
    plt.close(figure)
    return file


def save_curves(records: Sequence[CameraRecord], folder: Path) -> list[Path]:
    """Draw trajectories, distances, conditioning, risk and alerts of all runs."""
    files = []
    for name, draw in (("trajectories", _draw_trajectories), ("risk_and_alerts", _draw_curves)):
        figure = plt.figure(figsize=(12, 7), layout="constrained")
        draw(figure, records)
        files.append(folder / f"{name}.png")
        figure.savefig(files[-1], dpi=100)
        plt.close(figure)
    return files


def _draw_trajectories(figure: Any, records: Sequence[CameraRecord]) -> None:
    axes = figure.add_subplot(projection="3d")
    model = records[0].scene.model()
    paths = [np.array([pose.translation for _, pose, _, _ in record.rows]) for record in records]
    everything = np.vstack([model.vertices, *paths])
    middle = 0.5 * (everything.min(axis=0) + everything.max(axis=0))
    radius = 0.55 * float(np.ptp(everything, axis=0).max())
    # Four lines have transversals; more have none in general.
    few = next((record.scene.lines() for record in records if len(record.scene.ids) == 4), None)
    for ends in model.vertices[model.edges]:
        axes.plot(*ends.T, color="black", linewidth=1.0)
    if few is not None:
        points, directions = singular_set(few).transversal_lines
        draw_lines(axes, points, directions, middle, radius, color="tab:orange", linestyle="--", label="transversals")
    for record, path, color in zip(records, paths, RUN_COLORS, strict=False):
        axes.plot(*path.T, color=color, label=f"{record.scene.name} ({record.scene.law})", linewidth=1.8)
        axes.plot(*path[0], "o", color=color, markersize=5)
        axes.plot(*record.scene.target.translation, "*", color=color, markersize=11)
    for set_limits, center in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, strict=True):
        set_limits(center - radius, center + radius)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_zlabel("z [m]")
    axes.set_title("Camera centre from start (dot) to target (star); the object's edges in black")
    axes.legend(loc="upper left", fontsize=9)


def _draw_curves(figure: Any, records: Sequence[CameraRecord]) -> None:
    distance, speed, condition, risk = figure.subplots(4, 1, sharex=True)
    for record, color in zip(records, RUN_COLORS, strict=False):
        times = [row[0] for row in record.rows]
        distance.semilogy(times, [1e3 * row[2] for row in record.rows], color=color, label=record.scene.name)
        # The twist of a timeout is stamped with its own time, and may come before one that answers an older image.
        moving = sorted((at, float(np.linalg.norm(twist[:3]))) for at, twist in record.twists if at > 0.0)
        if moving:
            speed.plot(*np.array(moving).T, color=color)
        if record.statuses:
            at, inverse, share = np.array(record.statuses).T
            condition.semilogy(at, np.maximum(inverse, 1e-6), color=color)
            risk.plot(at, share, color=color)
        for alert in record.alerts:
            marker, edge = ALERT_MARKS.get(alert.level, ("o", "tab:green"))
            risk.plot(alert.time, 1.05, marker, color=color, markeredgecolor=edge, markersize=8, clip_on=False)
    distance.set_ylabel("distance [mm]")
    distance.legend(fontsize=9)
    speed.set_ylabel("commanded |v| [m/s]")
    condition.set_ylabel("1/cond of L")
    risk.set_ylabel("risk; marks: alerts")
    risk.set_ylim(-0.05, 1.15)
    risk.set_xlabel("time [s]")
    for axes in (distance, speed, condition, risk):
        axes.grid(alpha=0.3)
