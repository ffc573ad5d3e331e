# SPDX-License-Identifier: Apache-2.0
"""The page of an evaluation: the verdict first, then a table and a figure of each suite."""

from __future__ import annotations

import html
import io
import math
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.analysis.accuracy import Camera, line_information, position_deviations
from plsing_ros.analysis.evaluation.evaluation import HARM_TEXT, Evaluation, Safety
from plsing_ros.analysis.evaluation.setup import HARD, YOURS
from plsing_ros.analysis.rates import Rate
from plsing_ros.figures.report_page import image_element, list_element, table_element, write_page
from plsing_ros.planning.rollout import Harm

_COLORS = {Safety.SAFE: "#2a7", Safety.CARE: "#c90", Safety.UNKNOWN: "#888", Safety.UNSAFE: "#c33"}
# Intervals of time over which poses are gathered, and the share of runs between the lines.
_BINS, _MOST = 24, 0.95


def save_evaluation_page(found: Evaluation, title: str, file: Path) -> Path:
    """Write the page; return the file."""
    color = _COLORS[found.safety]
    page = [f"<p class=verdict style='border-color:{color}'>{html.escape(found.verdict)}</p>"]
    if found.concerns:
        page += ["<p>What speaks against it:</p>", list_element(found.concerns)]
    if found.advice:
        page += ["<p>What to do next:</p>", list_element(found.advice)]
    page.append(f"<p>{html.escape(_conditions(found))} Rates come with their 95 % intervals (Wilson) in brackets.</p>")
    page += ["<h2>Laws</h2>", _LAWS_TEXT, _laws_table(found), _image(_draw_laws(found), "harm and paths by law")]
    page += ["<h2>Alerts</h2>", _ALERTS_TEXT, _alerts_table(found)]
    page.append(_image(_draw_alerts(found), "when alerts came, and when harm"))
    page += ["<h2>Singularities of the map</h2>", _MAPS_TEXT, _maps_table(found)]
    page.append(_image(_draw_maps(found), "distance of the path to singular centres, over the maps"))
    page += ["<h2>Pose</h2>", _POSE_TEXT, _pose_table(found)]
    page.append(_image(_draw_poses(found), "error of the pose over time"))
    return write_page(file, title, page)


_LAWS_TEXT = (
    "<p>Each law from the same starts, with the same noise, with the same true lines. A run comes to harm if the "
    "camera gets farther from the target than 1.5 times the start, sees fewer than three lines, or is not within 5 cm "
    "and 2 degrees in time. The first law is yours.</p>"
)
_ALERTS_TEXT = (
    "<p>Your law with the monitor watching, from your starts and from hard ones (across the nearest singularity, or "
    "turned about the optical axis), so that something goes wrong. Dots: the first alert; crosses: harm.</p>"
)
_MAPS_TEXT = (
    "<p>Lines are drawn again and again within their tolerances, as they may be in reality. The nearest point at which "
    "the camera would lose a motion is compared with the straight path, and with what the map alone reports.</p>"
)
_POSE_TEXT = (
    "<p>The pose that the estimator says in the runs of your law, against the true one. Its square is over "
    "the covariance that comes with the pose: 6 if it is right, more if poses are less exact than said.</p>"
)


def _conditions(found: Evaluation) -> str:
    setup, monitor = found.setup, found.setup.monitor
    lines = setup.map
    return (
        f"{len(lines)} lines known to {1e3 * lines.position_std.max():.3g} mm and "
        f"{1e3 * lines.direction_std.max():.3g} mrad; image lines to {setup.noise:g}; {1.0 / setup.period:.3g} frames "
        f"a second; twists carried out {monitor.frames_late} frames late with a lag of {monitor.robot_lag:g} s, up to "
        f"{monitor.robot_linear_speed:g} m/s and {monitor.robot_angular_speed:g} rad/s; starts within "
        f"{setup.spread:g} m and {math.degrees(setup.turn):.2g} degrees (one standard deviation) of the given one; "
        f"gain {setup.controller.gain:g} 1/s."
    )


def _laws_table(found: Evaluation) -> str:
    rows = []
    for law in found.laws:
        runs = found.of_law(law)
        there = [run for run in runs if not run.harm]
        kinds = Counter(HARM_TEXT[Harm(run.harm)] for run in runs if run.harm)
        halted = Counter(run.late for run in runs if run.harm and run.late).most_common(1)
        rows.append(
            (
                law,
                str(found.harm(law)),
                "; ".join(f"{text}: {count}" for text, count in kinds.items())
                + (f" ({halted[0][0]})" if halted else ""),
                f"{np.median([run.time for run in there]):.1f} s" if there else "",
                f"{1e3 * found.end_error_of(law):.2f} mm" if there else "",
                f"{np.median([run.path for run in there]):.2f}" if there else "",
                f"{max(run.demand for run in runs):.2f}",
            )
        )
    head = ("law", "comes to harm", "how", "time", "95 % end within", "path / straight", "largest speed / limit")
    return table_element(head, rows)


def _alerts_table(found: Evaluation) -> str:
    rows = [
        ("harm announced early enough", str(found.announced)),
        ("runs without harm, with an alert", str(found.false_alarms)),
    ]
    for kind, name in ((YOURS, "your starts"), (HARD, "hard starts")):
        runs = found.of_law(found.law, kind)
        rows.append((f"harm from {name}", str(Rate(sum(run.harm > 0 for run in runs), len(runs)))))
    for harmful, name in ((True, "harmful"), (False, "other")):
        said = [run.risk for run in found.watched if run.risk is not None and (run.harm > 0) == harmful]
        if said:
            text = f"{np.mean(said):.0%} on average of {len(said)} runs"
            rows.append((f"probability of harm that the roll-outs said at the start of {name} runs", text))
    alerts = Counter(_kind_of(run.alert) for run in found.watched if run.alert)
    rows += [(f"first alert: {text}", str(count)) for text, count in alerts.most_common(4)]
    return table_element(("", ""), rows)


def _kind_of(alert: str) -> str:
    """Return what an alert is about: its words without the numbers."""
    return " ".join(word for word in alert.split(";")[0].split() if word.strip("(),").isalpha())[:80]


def _maps_table(found: Evaluation) -> str:
    distances = [each.nearest for each in found.maps if each.nearest is not None]
    rows = [(f"path nearer than {found.clearance:g} m to a singular centre", str(found.near_maps))]
    if distances:
        names = Counter(each.name for each in found.maps if each.name)
        rows.append(("nearest one, over all maps", f"{min(distances):.3g} m"))
        rows.append(("which it is", ", ".join(f"{name} ({count})" for name, count in names.most_common(4))))
    rows.append(("true singular centres that the report covers", str(found.covered)))
    rows.append(("maps", f"{len(found.maps)}" + (" (lines are known exactly)" if found.setup.map.exact else "")))
    return table_element(("", ""), rows)


def _pose_table(found: Evaluation) -> str:
    runs = found.of_law(found.law)
    errors = np.array([row[4] for run in runs for row in run.trace], dtype=float)
    known = errors[np.isfinite(errors)]
    quantiles = np.quantile(known, [0.5, 0.95, 1.0]) if len(known) else [math.nan] * 3
    rows = [
        ("frames with a pose", str(Rate(sum(run.poses for run in runs), sum(run.frames for run in runs)))),
        ("error of the position: median, 95 %, most", ", ".join(f"{1e3 * each:.3g} mm" for each in quantiles)),
        ("squared error over covariance, mean", f"{found.nees:.2f} (6 is right)"),
        ("runs with a wrong pose that was not said to be", str(found.wrong_poses)),
        ("what a single image at start and target tells of the position, standard deviation", _single_images(found)),
    ]
    return table_element(("", ""), rows)


def _single_images(found: Evaluation) -> str:
    setup = found.setup
    information = line_information(
        setup.map, [setup.start, setup.target], Camera(max(setup.noise, 1e-9), 0.5 * math.pi)
    )
    deviations = position_deviations(information.matrices.sum(axis=1), information.visible.sum(axis=1))
    return " and ".join(f"{1e3 * each:.3g} mm" if math.isfinite(each) else "nothing" for each in deviations)


def _figure(columns: int) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    return figure, figure.subplots(1, columns)


def _image(figure: Any, what: str) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, dpi=110, format="png")
    return image_element(stream.getvalue(), what)


def _draw_laws(found: Evaluation) -> Any:
    figure, (harm, paths) = _figure(2)
    for row, law in enumerate(found.laws):
        rate = found.harm(law)
        low, high = rate.interval
        color = "tab:red" if low > found.max_harm else "tab:green" if high <= found.max_harm else "tab:gray"
        harm.errorbar(
            rate.share, row, xerr=[[max(rate.share - low, 0.0)], [max(high - rate.share, 0.0)]], fmt="o", color=color
        )
    harm.axvline(found.max_harm, color="black", linewidth=0.8, linestyle=":", label="allowed")
    harm.set(xlim=(-0.03, 1.03), xlabel="share of runs that come to harm", yticks=range(len(found.laws)))
    harm.set_yticklabels([f"{law} (yours)" if law == found.law else law for law in found.laws])
    harm.invert_yaxis()
    harm.legend()
    target = found.setup.target.translation
    for law in found.laws:
        for number, run in enumerate(found.of_law(law)[:5]):
            rows = np.array(run.trace)
            if len(rows):
                distance = np.linalg.norm(rows[:, 1:4] - target, axis=1)
                color = f"C{found.laws.index(law)}"
                paths.plot(rows[:, 0], distance, color=color, linewidth=0.8, label=law if number == 0 else None)
    paths.set(xlabel="time [s]", ylabel="distance to the target [m]", title="five runs of each law")
    paths.legend(fontsize="small")
    return figure


def _draw_alerts(found: Evaluation) -> Any:
    figure, (times, rates) = _figure(2)
    runs = sorted(found.watched, key=lambda run: (run.kind, run.harm, run.time))
    for row, run in enumerate(runs):
        color = "tab:red" if run.harm else "tab:green"
        times.plot([0.0, run.time], [row, row], color=color, linewidth=0.8)
        if run.harm:
            times.plot(run.time, row, "x", color="tab:red", markersize=5)
        if run.first_alert is not None:
            times.plot(run.first_alert, row, ".", color="black", markersize=5)
    hard = sum(run.kind == HARD for run in runs)
    times.axhline(hard - 0.5, color="gray", linewidth=0.8, linestyle=":")
    times.yaxis.get_major_locator().set_params(integer=True)
    times.set(xlabel="time [s]", ylabel="run", title="below the dotted line: hard starts")
    for row, (name, rate) in enumerate(
        (("harm announced", found.announced), ("calm run, alert all the same", found.false_alarms))
    ):
        if rate.total:
            low, high = rate.interval
            rates.errorbar(rate.share, row, xerr=[[max(rate.share - low, 0.0)], [max(high - rate.share, 0.0)]], fmt="o")
        else:
            rates.text(0.5, row, "no such run", ha="center", va="center")
        rates.text(0.0, row - 0.15, name)
    rates.set(xlim=(-0.03, 1.03), ylim=(1.6, -0.4), yticks=[], xlabel="share of runs")
    return figure


def _draw_maps(found: Evaluation) -> Any:
    figure, axes = _figure(1)
    distances = [each.nearest for each in found.maps if each.nearest is not None]
    if distances:
        share = np.arange(1, len(distances) + 1) / len(found.maps)
        axes.step(np.sort(distances), share, "o-", where="post", markersize=3, label="maps")
        low, high = found.near_maps.interval
        axes.errorbar(
            found.clearance,
            found.near_maps.share,
            yerr=[[max(found.near_maps.share - low, 0.0)], [max(high - found.near_maps.share, 0.0)]],
            fmt="s",
            color="tab:red",
            label="nearer than asked for",
        )
        axes.set(xlim=(0.0, 1.1 * max(found.clearance, *distances)), ylim=(-0.03, 1.03))
        axes.legend()
    else:
        axes.text(0.5, 0.5, "none of the maps has a singular point, line or surface", ha="center", va="center")
    axes.set(
        xlabel="distance of the straight path from the nearest singular centre [m]", ylabel="share of maps, up to it"
    )
    return figure


def _draw_poses(found: Evaluation) -> Any:
    figure, axes = _figure(1)
    rows = np.array([row for run in found.of_law(found.law) for row in run.trace if math.isfinite(row[4])])
    if len(rows):
        edges = np.linspace(0.0, max(float(rows[:, 0].max()), 1e-9), _BINS + 1)
        at, median, high, said = [], [], [], []
        for low_edge, high_edge in pairwise(edges):
            inside = rows[(rows[:, 0] >= low_edge) & (rows[:, 0] <= high_edge)]
            if len(inside):
                at.append(0.5 * (low_edge + high_edge))
                median.append(1e3 * np.median(inside[:, 4]))
                high.append(1e3 * np.quantile(inside[:, 4], _MOST))
                said.append(1e3 * np.median(inside[:, 5]))
        axes.semilogy(at, median, ".-", label="median error")
        axes.fill_between(at, median, high, alpha=0.3, label="up to 95 %")
        axes.semilogy(at, said, "k--", label="said: standard deviation, worst direction")
        axes.legend()
    axes.set(xlabel="time [s]", ylabel="error of the position [mm]")
    return figure
