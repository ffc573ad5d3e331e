# SPDX-License-Identifier: Apache-2.0
"""Harm and demand announced by the monitor: recall, false alarms, calibration and ROC beside simpler detectors.

Conditions, harm, demand and arrival are those of docs/concepts/risk.md; tasks, gains, frame rates, laws and chains are
drawn at random. Every rate comes with its 95 % interval (Wilson). Runs are kept in build/alerts as they are made, under
a mark of the code that made them: a study that was interrupted goes on where it was, and conditions can be made by
several processes. In harsh conditions six runs in the true conditions are made beside every second run.

    python3 -m benchmark alerts --quick
    python3 -m benchmark.alerts --quick --figure alerts.png
    python3 -m benchmark.alerts --condition nominal --harmless 100 --harmful 30 --workers 1
    python3 -m benchmark.alerts --calibrate --condition nominal --harmless 200 --harmful 0
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import hashlib
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from tqdm import tqdm

from benchmark.alert_report import FALSE, conformal_threshold, exceeded, is_harmless, report, scores_of
from benchmark.alert_runs import Record, record_of

CONDITIONS = ("lab", "nominal", "harsh")
# Thresholds are set on runs of the first seed, and judged on those of the second.
CALIBRATION_SEED, SEED = 101, 202
HARMLESS, HARMFUL = 1000, 300
TRUE_EVERY = 2
_ROOT = Path(__file__).parents[1]
RESULTS = _ROOT / "build" / "alerts"
# What a run depends on.
_SOURCES = (
    *(f"plsing_ros/{room}" for room in ("_core", "control", "features", "geometry", "monitoring", "parameters")),
    *(f"plsing_ros/{room}" for room in ("planning", "pose", "singularities")),
    *(f"benchmark/{name}.py" for name in ("alert_runs", "alert_settings", "servo_conditions")),
)


def main(quick: bool = False) -> None:
    """Measure and print; quick: a fifth of the runs."""
    part = 5 if quick else 1
    study(SEED, HARMLESS // part, HARMFUL // part, CONDITIONS)


def study(
    seed: int,
    harmless: int,
    harmful: int,
    conditions: Sequence[str],
    workers: int = 2,
    figure: str = "",
    results: Path = RESULTS,
    true_every: int = TRUE_EVERY,
) -> dict[str, list[Record]]:
    """Make runs of each condition until there are enough of both kinds, and print the tables."""
    records = {}
    for condition in conditions:
        records[condition] = records_of(condition, seed, harmless, harmful, workers, results, true_every)
        print(report(condition, records[condition]), flush=True)
    if figure:
        from benchmark.alert_figure import draw

        draw(records, figure)
    return records


def records_of(
    condition: str,
    seed: int,
    harmless: int,
    harmful: int,
    workers: int,
    results: Path = RESULTS,
    true_every: int = TRUE_EVERY,
) -> list[Record]:
    """Return the runs of a seed from the first one on, until there are enough of both; make those missing."""
    folder = results / _mark()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{condition}_{seed}.jsonl"
    # A run that was being written when the study was stopped is made again.
    text = path.read_text() if path.exists() else ""
    lines = [line for line in text.splitlines(keepends=True) if line.endswith("\n")]
    path.write_text("".join(lines))
    made = [Record.from_line(line) for line in lines]
    records: list[Record] = []
    with tqdm(total=harmless + harmful, desc=condition, leave=False, file=sys.stderr) as bar:
        for record in _from(made, partial(record_of, condition, seed, true_every), workers, path):
            records.append(record)
            bad = sum(bool(each.harm) for each in records)
            bar.n = min(len(records) - bad, harmless) + min(bad, harmful)
            bar.refresh()
            if len(records) - bad >= harmless and bad >= harmful:
                break
    return records


def _from(made: Sequence[Record], make: partial[Record], workers: int, path: Path) -> Iterator[Record]:
    """Yield the runs that are made, and then one after the other, each written to a file when it is made."""
    yield from made
    number = len(made)
    with path.open("a") as file:

        def keep(record: Record) -> Record:
            file.write(record.line() + "\n")
            file.flush()
            return record

        if workers == 1:
            while True:
                yield keep(make(number))
                number += 1
        with ProcessPoolExecutor(workers, initializer=os.nice, initargs=(5,)) as pool:
            while True:
                batch = range(number, number + 16 * workers)
                for record in pool.map(make, batch):
                    yield keep(record)
                number = batch.stop


def _mark() -> str:
    """Return a mark of the code that runs depend on."""
    files = sorted(
        file
        for source in _SOURCES
        for file in ([_ROOT / source] if source.endswith(".py") else (_ROOT / source).rglob("*"))
        if file.suffix in (".py", ".cpp", ".hpp")
    )
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def calibrate(records: Sequence[Record]) -> str:
    """Return the conformal thresholds of risk and demand that harmless runs of a calibration set ask for."""
    count = sum(is_harmless(each) for each in records)
    lines = [f"conformal thresholds by {count} harmless runs, of other seeds than those that are judged"]
    for share in (FALSE, FALSE / 2):
        values = [conformal_threshold(scores_of(records, name)[1], share) for name in ("risk", "demand")]
        lines.append(
            f"  risk > {values[0]:.4f}, demand > {values[1]:.4f}: exceeded by at most {100 * share:g} % of further "
            f"harmless runs like these in the mean over such sets, by at most {100 * exceeded(count, share):.1f} % "
            "in 95 of 100 sets"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--quick", action="store_true", help="a fifth of the runs")
    parser.add_argument("--calibrate", action="store_true", help="runs of the calibration set, and its thresholds")
    parser.add_argument("--harmless", type=int, default=HARMLESS, help="runs without harm, of each condition")
    parser.add_argument("--harmful", type=int, default=HARMFUL, help="runs with harm, of each condition")
    parser.add_argument("--condition", choices=CONDITIONS, action="append", help="default: all")
    parser.add_argument(
        "--true-every",
        type=int,
        default=TRUE_EVERY,
        help="make six true runs of every harsh run whose number this divides; 0: none",
    )
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--figure", default="", help="PNG of ROC and reliability")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder that runs are kept in")
    options = parser.parse_args()
    part = 5 if options.quick else 1
    found = study(
        CALIBRATION_SEED if options.calibrate else options.seed,
        options.harmless // part,
        options.harmful // part,
        options.condition or CONDITIONS,
        options.workers,
        options.figure,
        options.results,
        options.true_every,
    )
    if options.calibrate:
        for condition, records in found.items():
            print(condition, calibrate(records))
