# SPDX-License-Identifier: Apache-2.0
"""Distances to singularities and accuracy along a path, as a figure."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plsing_ros.analysis.path_report import PathReport


def save_path_figure(report: PathReport, title: str, file: Path) -> Path:
    """Draw what awaits the camera, pose by pose; return the file."""
    from matplotlib.figure import Figure

    risk = report.risk
    figure = Figure(figsize=(9, 7 if risk is None else 9), layout="constrained")
    rows = figure.subplots(3 if risk is None else 4, 1, sharex=True)
    distance, condition, accuracy = rows[:3]
    number = np.arange(len(report.center))
    distance.semilogy(number, report.nearest_distance, ".-", label="named locus")
    distance.semilogy(number, report.singular_distance, ".--", label="singular centre, to first order")
    distance.axhline(report.clearance, color="tab:red", linewidth=0.8, label="asked for")
    distance.set_ylabel("distance to the\nnearest singularity [m]")
    distance.legend()
    condition.semilogy(number, report.relative_condition, ".-")
    condition.set_ylabel("1/cond, of normal")
    accuracy.semilogy(number, 1000.0 * report.deviation, ".-")
    accuracy.axhline(1000.0 * report.accuracy, color="tab:red", linewidth=0.8)
    accuracy.set(ylabel="standard deviation of\nthe position [mm]")
    if risk is not None:
        rows[3].plot(number, risk.probability, ".-", color="tab:red", label=f"probability of harm, law {risk.law}")
        rows[3].plot(number, risk.demand, ".--", label="largest speed, of the robot's limit")
        rows[3].set_ylabel("run from here")
        rows[3].legend()
    rows[-1].set_xlabel("pose")
    figure.suptitle(f"{title}: {report.verdict.value}")
    figure.savefig(file, dpi=110)
    return file
