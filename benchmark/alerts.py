# SPDX-License-Identifier: Apache-2.0
"""Harm and demand announced by the monitor: recall, false alarms, calibration and ROC beside simpler detectors.

Conditions, harm, demand and arrival are those of docs/monitor.md; tasks, gains, frame rates, laws and chains are drawn
at random. Every rate comes with its 95 % interval (Wilson), the comparison with six roll-outs in the true conditions is
paired: both judge the same runs.

    python3 -m benchmark alerts --quick
    python3 -m benchmark.alerts --quick --figure alerts.png
    python3 -m benchmark.alerts --condition nominal --harmless 100 --harmful 30
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import math
import pickle
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmark.alert_runs import Record, draw_setting, run
from plsing_ros.monitoring.rollout import Harm

CONDITIONS = ("lab", "nominal", "harsh")
# Thresholds were set on the first seed only.
SEED = 11
HARMLESS, HARMFUL = 1000, 300
_FALSE = 0.05
_BINS = np.array([0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0])
_SMALLEST_BIN = 50


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
    save: str = "",
) -> None:
    """Make runs of each condition until there are enough of both kinds, and print the tables."""
    records = {}
    for condition in conditions:
        records[condition] = _records(condition, seed, harmless, harmful, workers)
        print(report(condition, records[condition]), flush=True)
    if save:
        Path(save).write_bytes(pickle.dumps(records))
    if figure:
        from benchmark.alert_figure import draw

        draw(records, figure)


def _records(condition: str, seed: int, harmless: int, harmful: int, workers: int) -> list[Record]:
    records: list[Record] = []
    with ProcessPoolExecutor(workers, initializer=os.nice, initargs=(5,)) as pool:
        numbers = count()
        with tqdm(total=harmless + harmful, desc=condition, leave=False, file=sys.stderr) as bar:
            while True:
                bad = sum(each.harm is not Harm.NONE for each in records)
                good = len(records) - bad
                bar.n = min(good, harmless) + min(bad, harmful)
                bar.refresh()
                if good >= harmless and bad >= harmful:
                    return records
                batch = [next(numbers) for _ in range(16 * workers)]
                records += pool.map(partial(_numbered, condition, seed), batch)


def _numbered(condition: str, seed: int, number: int) -> Record:
    return run(draw_setting(condition, seed, number))


def lead_of(record: Record) -> float:
    """Return how long before harm it must be announced [s]."""
    return min(0.5, 0.3 / record.gain)


def is_announced(alert: float | None, event: float, lead: float) -> bool:
    """Return whether an alert came early enough; what happens at once may be announced at the first features."""
    return alert is not None and alert <= max(event - lead, 0.0) + 1e-9


def interval(hits: int, total: int) -> str:
    """Return a rate with its 95 % interval (Wilson)."""
    if total == 0:
        return "none"
    z, p = 1.96, hits / total
    middle, half = p + z * z / (2 * total), z * math.sqrt(p * (1 - p) / total + z * z / (4 * total * total))
    low, high = (middle - half) / (1 + z * z / total), (middle + half) / (1 + z * z / total)
    return f"{hits} of {total}, {100 * p:.1f} % ({100 * max(low, 0):.1f} to {100 * min(high, 1):.1f})"


def score_before(record: Record, name: str, until: float) -> float:
    """Return the largest score of a detector up to a time [s]."""
    scores = [score for time, score in record.scores.get(name, []) if time <= until + 1e-9]
    return max(scores, default=-math.inf)


def scores_of(records: Sequence[Record], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return scores of harmful runs, early enough, and of harmless ones, over the whole run."""
    harmful = [score_before(each, name, max(each.harm_time - lead_of(each), 0.0)) for each in records if each.harm]
    harmless = [score_before(each, name, math.inf) for each in records if is_harmless(each)]
    return np.array(harmful), np.array(harmless)


def is_harmless(record: Record) -> bool:
    """Return whether neither harm nor a demand came."""
    return record.harm is Harm.NONE and record.demand_time is None


def conformal_threshold(harmless: np.ndarray, share: float) -> float:
    """Return the threshold that at most this share of further harmless runs exceeds, in the mean over such samples.

    Source: split conformal prediction; the k-th smallest of n scores, k = ceil((n + 1) (1 - share)).
    """
    k = math.ceil((len(harmless) + 1) * (1.0 - share))
    return math.inf if k > len(harmless) else float(np.sort(harmless)[k - 1])


def report(condition: str, records: list[Record]) -> str:
    """Return the tables of one condition."""
    harmful = [each for each in records if each.harm]
    harmless = [each for each in records if is_harmless(each)]
    demanding = [each for each in records if each.demand_time is not None]
    hits = [is_announced(each.first_alert, each.harm_time, lead_of(each)) for each in harmful]
    lines = [f"{condition}: {len(records)} runs, {len(harmful)} harmful, {len(demanding)} demanding"]
    lines.append(f"  harm announced early enough   {interval(sum(hits), len(hits))}")
    for kind in Harm:
        of_kind = [hit for hit, each in zip(hits, harmful, strict=True) if each.harm is kind]
        if of_kind:
            lines.append(f"    {kind.name.lower():27} {interval(sum(of_kind), len(of_kind))}")
    announced = [is_announced(each.first_alert, each.demand_time or 0.0, lead_of(each)) for each in demanding]
    lines.append(f"  demand announced early enough {interval(sum(announced), len(announced))}")
    false = [each.first_alert is not None for each in harmless]
    lines.append(f"  false alarms, runs            {interval(sum(false), len(false))}")
    for name, chosen in (
        ("soft start", [each for each in harmless if each.soft]),
        *((law, [each for each in harmless if each.law == law]) for law in sorted({each.law for each in records})),
        ("with pose_estimator", [each for each in harmless if each.chain]),
    ):
        if chosen:
            alarms = sum(each.first_alert is not None for each in chosen)
            time = sum(each.share * each.frames for each in chosen) / max(sum(each.frames for each in chosen), 1)
            lines.append(f"    {name:27} {interval(alarms, len(chosen))}, {100 * time:.2f} % of the time")
    lines += _calibration(records)
    lines += _detectors(records)
    return "\n".join(lines)


def _calibration(records: Sequence[Record]) -> list[str]:
    """Return said and true shares at the first answer, and once a second."""
    lines = []
    for title, chosen in (
        ("first answer", [(each.answers[:1], bool(each.harm)) for each in records]),
        ("once a second", [(each.answers, bool(each.harm)) for each in records]),
    ):
        said, came, runs = [], [], []
        for number, (answers, harm) in enumerate(chosen):
            for _, probability in answers:
                said.append(probability)
                came.append(harm)
                runs.append(number)
        if not said:
            continue
        p, y, which = np.array(said), np.array(came, dtype=float), np.array(runs)
        lines.append(f"  calibration, {title}: Brier score {np.mean((p - y) ** 2):.3f}")
        rows = np.clip(np.digitize(p, _BINS, right=True) - 1, 0, len(_BINS) - 2)
        for row in range(len(_BINS) - 1):
            inside = rows == row
            count_runs = len(set(which[inside].tolist()))
            if count_runs == 0:
                continue
            harmed = len(set(which[inside & (y > 0)].tolist()))
            small = "" if count_runs >= _SMALLEST_BIN else "  (fewer than 50 runs)"
            lines.append(f"    said {p[inside].mean():.2f}: harm in {interval(harmed, count_runs)} of the runs{small}")
    return lines


def _detectors(records: Sequence[Record]) -> list[str]:
    """Return recall at 5 % false alarms, and with a conformal threshold, of each detector."""
    lines = ["  recall of harm at 5 % false alarms of harmless runs (threshold on these runs; conformal, other half)"]
    names = sorted({name for each in records for name in each.scores})
    for name in names:
        harmful, harmless = scores_of(records, name)
        if not len(harmful) or not len(harmless):
            continue
        threshold = float(np.quantile(harmless, 1.0 - _FALSE, method="higher"))
        hits = int(np.sum(harmful > threshold))
        half = conformal_threshold(harmless[::2], _FALSE)
        conformal, alarms = int(np.sum(harmful > half)), int(np.sum(harmless[1::2] > half))
        lines.append(
            f"    {name:24} > {threshold:<9.3g} {interval(hits, len(harmful))}; conformal > {half:.3g}: "
            f"{interval(conformal, len(harmful))}, false {interval(alarms, len(harmless[1::2]))}"
        )
    return lines + _paired(records)


def _paired(records: Sequence[Record]) -> list[str]:
    """Return the recall of risk minus that of true roll-outs at the same false rate, by a paired bootstrap."""
    ours, others = scores_of(records, "risk"), scores_of(records, "true roll-outs")
    if not len(ours[0]) or not len(ours[1]):
        return []
    generator = np.random.default_rng(0)
    differences = []
    for _ in range(1000):
        rows = generator.integers(len(ours[0]), size=len(ours[0]))
        columns = generator.integers(len(ours[1]), size=len(ours[1]))
        recalls = []
        for harmful, harmless in (ours, others):
            threshold = np.quantile(harmless[columns], 1.0 - _FALSE, method="higher")
            recalls.append(np.mean(harmful[rows] > threshold))
        differences.append(recalls[0] - recalls[1])
    low, middle, high = 100.0 * np.quantile(differences, [0.025, 0.5, 0.975])
    return [f"    risk minus true roll-outs, paired: {middle:+.1f} points ({low:+.1f} to {high:+.1f})"]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--quick", action="store_true", help="a fifth of the runs")
    parser.add_argument("--harmless", type=int, default=HARMLESS, help="runs without harm, of each condition")
    parser.add_argument("--harmful", type=int, default=HARMFUL, help="runs with harm, of each condition")
    parser.add_argument("--condition", choices=CONDITIONS, action="append", help="default: all")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--figure", default="", help="PNG of ROC and reliability")
    parser.add_argument("--save", default="", help="records for other evaluations (pickle)")
    options = parser.parse_args()
    part = 5 if options.quick else 1
    study(
        options.seed,
        options.harmless // part,
        options.harmful // part,
        options.condition or CONDITIONS,
        options.workers,
        options.figure,
        options.save,
    )
