# SPDX-License-Identifier: Apache-2.0
"""What a replay shows: levels, conditioning, distance and speeds over time, as a figure and a page."""

from __future__ import annotations

import html
import io
from itertools import pairwise
from pathlib import Path

import numpy as np

from plsing_ros.analysis.replay import ReplayedRun
from plsing_ros.figures.report_page import image_element, table_element, write_page
from plsing_ros.levels import Level

_COLORS = {Level.OK: "tab:green", Level.WARN: "tab:orange", Level.CRITICAL: "tab:red"}


def draw_replay(run: ReplayedRun) -> bytes:
    """Return a PNG of what monitor and controller said over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 8), layout="constrained")
    rows = figure.subplots(4, 1, sharex=True, height_ratios=[1, 3, 3, 3])
    levels, condition, distance, speed = rows
    edges = np.append(run.time, run.time[-1] + (run.time[-1] - run.time[0]) / max(len(run.time) - 1, 1))
    starts = [0, *(i for i in range(1, len(run.level)) if run.level[i] is not run.level[i - 1]), len(run.level)]
    for begin, end in pairwise(starts):
        level = run.level[begin]
        levels.axvspan(edges[begin], edges[end], color=_COLORS.get(level, "tab:gray"), label=level.name)
    handles = dict(zip(*reversed(levels.get_legend_handles_labels()), strict=True))
    levels.legend(handles.values(), handles.keys(), loc="center left", bbox_to_anchor=(1.0, 0.5))
    levels.set(yticks=[], title="level")
    condition.semilogy(run.time, run.inverse_condition_number)
    condition.set_ylabel("inverse condition number")
    distance.plot(run.time, run.nearest_distance)
    if not np.isfinite(run.nearest_distance).any():
        distance.text(0.5, 0.5, "no locus, or no pose", ha="center", va="center", transform=distance.transAxes)
        distance.set_yticks([])
    distance.set_ylabel("distance to the\nnearest locus [m]")
    speed.plot(run.time, run.recorded_speed, label="recorded")
    if np.isfinite(run.replayed_speed).any():
        speed.plot(run.time, run.replayed_speed, "--", label="with these parameters")
    speed.set(xlabel="time [s]", ylabel="|v| [m/s]")
    speed.legend(loc="upper right")
    for axes in rows[1:]:
        for alert in run.recorded_alerts:
            axes.axvline(alert.time, color=_COLORS.get(alert.level, "tab:gray"), linewidth=0.8, linestyle=":")
    stream = io.BytesIO()
    figure.savefig(stream, dpi=110)
    return stream.getvalue()


def save_replay_report(run: ReplayedRun, title: str, folder: Path) -> list[Path]:
    """Write the figure and a page with it and the alerts; return both files."""
    picture = draw_replay(run)
    files = [folder / "replay.png", folder / "report.html"]
    files[0].write_bytes(picture)
    rows = [
        (which, f"{alert.time:.2f} s", alert.level.name, alert.text)
        for which, alerts in (("now", run.alerts), ("recorded", run.recorded_alerts))
        for alert in alerts
    ]
    page = [
        "<p>Dotted lines are the recorded changes of level.</p>",
        image_element(picture, "levels, conditioning, distance and speed over time"),
        "<h2>Changes of level</h2>",
        table_element(("", "time", "level", "why"), rows),
        f"<h2>Summary</h2><pre>{html.escape(str(run))}</pre>",
    ]
    write_page(files[1], title, page)
    return files
