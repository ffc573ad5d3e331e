# SPDX-License-Identifier: Apache-2.0
"""The paper's Starts 1 to 4 by every control law, side by side, with the package's own controller.

python3 -m benchmark law_starts
python3 -m benchmark.law_starts --figure docs/figures/law_starts.png
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from tqdm import tqdm

from benchmark.law_variants import LAWS
from paper.tasks import STARTS_FOUR, paper_tasks
from plsing_ros.simulation.run_record import RunRecord
from plsing_ros.simulation.servo_run import run_in_core
from plsing_ros.singularities import singular_set

# Of Start 1 by the plain law: what the laws that guard or plan are held against.
_PLAIN_PEAK, _PLAIN_STEPS = 3.0, 1.5


def main() -> None:
    """Run and print."""
    compare()


def compare(figure: Path | None = None) -> None:
    """Run and print, and draw if a file is given."""
    tasks = paper_tasks()[STARTS_FOUR]
    jobs = [(law, task) for law in LAWS for task in tasks]
    records = [
        run_in_core(replace(task, law={name: value for name, value in law.parameters.items() if name != "gain"}))
        for law, task in tqdm(jobs, desc="runs", leave=False)
    ]
    rows = {law.name: records[len(tasks) * i : len(tasks) * (i + 1)] for i, law in enumerate(LAWS)}
    print(_table(rows))
    first = rows["pinv"][0]
    print(
        f"\nthree times the peak of Start 1 by pinv: {_PLAIN_PEAK * first.linear_speed.max():.3g} m/s; "
        f"one and a half times its iterations: {_PLAIN_STEPS * len(first.time):.0f}"
    )
    if figure is not None:
        _draw(rows, figure)
        print(f"figure: {figure}")


def _table(rows: dict[str, list[RunRecord]]) -> str:
    """Return a table in Markdown: iterations, peak speed, longest distance over that of the start."""
    headings = ["law", *(record.name for record in rows["pinv"])]
    lines = [f"| {' | '.join(headings)} |", "|" + "---|" * len(headings)]
    for name, records in rows.items():
        lines.append(f"| {name} | {' | '.join(_cell(record) for record in records)} |")
    return "\n".join(lines)


def _cell(record: RunRecord) -> str:
    arrived = f"{len(record.time)}" if record.arrived else f"not: {record.distance[-1]:.2g} m left"
    monotone = "monotone" if record.distance_is_monotone else f"{record.distance.max() / record.distance[0]:.2f} d"
    return f"{arrived}; {record.linear_speed.max():.3g} m/s; {monotone}"


def _draw(rows: dict[str, list[RunRecord]], file: Path) -> None:
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 4, figsize=(15, 11), layout="constrained")
    scene = paper_tasks()[STARTS_FOUR][0].lines
    transversal = singular_set(scene).transversals[0]
    # Two directions across the transversal, which is then seen as a point.
    across = np.linalg.svd(transversal.direction[np.newaxis])[2][1:]
    colors = dict(zip(rows, plt.get_cmap("tab10").colors, strict=True))  # type: ignore[attr-defined]
    for name, records in rows.items():
        for column, record in enumerate(records):
            style: dict[str, Any] = {"color": colors[name], "label": name, "linewidth": 1.2}
            if name in ("guarded", "detour"):
                style["linewidth"] = 2.4
            axes[0, column].plot(record.time, record.distance, **style)
            axes[1, column].plot(record.time, np.maximum(record.linear_speed, 1e-6), **style)
            seen = (record.position - transversal.point) @ across.T
            axes[2, column].plot(*seen.T, **style)
            axes[2, column].plot(*seen[0], "o", color="black", markersize=4)
            target = (np.reshape(record.target, (-1, 3))[-1] - transversal.point) @ across.T
            axes[2, column].plot(*target, "*", color="black", markersize=9)
            axes[0, column].set_title(record.name)
            axes[1, column].set_xlabel("time [s]")
    axes[0, 0].set_ylabel("distance to the target [m]")
    axes[1, 0].set_ylabel("|v| [m/s]")
    for axis in axes[:2].ravel():
        axis.set_yscale("log")
    for axis in axes.ravel():
        axis.grid(alpha=0.3)
    for axis in axes[0]:
        axis.set_ylim(5e-4, 10.0)
    for axis in axes[1]:
        axis.set_ylim(1e-5, 50.0)
    for axis in axes[2]:
        axis.plot(0.0, 0.0, "x", color="tab:red", markersize=10, markeredgewidth=2)
        axis.set_xlim(-0.6, 0.6)
        axis.set_ylim(-0.6, 0.6)
        axis.set_aspect("equal")
        axis.set_xlabel("[m], seen along L_M (x)")
    axes[2, 0].set_ylabel("[m]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    figure.savefig(file, dpi=100)
    plt.close(figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figure", type=Path, help="write a figure to this PNG file")
    compare(parser.parse_args().figure)
