# SPDX-License-Identifier: Apache-2.0
"""Tables of the study of alerts: recall, false alarms, calibration, and detectors beside each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import beta

from benchmark.alert_runs import Record
from plsing_ros.planning.rollout import Harm

# The share of harmless runs that may alert.
FALSE = 0.05
# Where bins of what was said end; neighbours are merged until each has so many runs.
_EDGES = np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0])
_BIN_RUNS = 50
_ROLL_OUTS = {"risk": 2, "demand": 3}
_TRUE = "six true runs"


def lead_of(record: Record) -> float:
    """Return how long before harm it must be announced [s]."""
    return min(0.5, 0.3 / record.gain)


def latest_of(record: Record, event: float) -> float:
    """Return when an event must be announced at the latest [s]: what comes at once, with the first command."""
    return max(event - lead_of(record), record.first_command)


def is_announced(record: Record, event: float) -> bool:
    """Return whether an alert came early enough before an event [s]."""
    return record.first_alert is not None and record.first_alert <= latest_of(record, event) + 1e-9


def is_harmless(record: Record) -> bool:
    """Return whether neither harm nor a demand came."""
    return not record.harm and record.demand_time is None


def wilson(hits: int, total: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate."""
    z, p = 1.96, hits / total
    middle, half = p + z * z / (2 * total), z * math.sqrt(p * (1 - p) / total + z * z / (4 * total * total))
    return max((middle - half) / (1 + z * z / total), 0.0), min((middle + half) / (1 + z * z / total), 1.0)


def interval(hits: int, total: int) -> str:
    """Return a rate with its 95 % interval (Wilson), in words."""
    if total == 0:
        return "none"
    low, high = wilson(hits, total)
    return f"{hits} of {total}, {100 * hits / total:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def conformal_threshold(harmless: np.ndarray, share: float) -> float:
    """Return the threshold that at most this share of further harmless runs exceeds, in the mean over such samples.

    Source: split conformal prediction; the k-th smallest of n scores, k = ceil((n + 1) (1 - share)).
    """
    k = math.ceil((len(harmless) + 1) * (1.0 - share))
    return math.inf if k > len(harmless) else float(np.sort(harmless)[k - 1])


def exceeded(count: int, share: float) -> float:
    """Return the share of harmless runs that exceeds a conformal threshold at most, in 95 of 100 calibration sets.

    Source: the k-th smallest of n scores leaves a share of Beta(n + 1 - k, k) above it.
    """
    k = math.ceil((count + 1) * (1.0 - share))
    return float(beta.ppf(0.95, count + 1 - k, k)) if k <= count else 0.0


def detectors(records: Sequence[Record]) -> list[str]:
    """Return the names of all that can be compared."""
    known = any(each.true_share is not None for each in records)
    return [*_ROLL_OUTS, *sorted({name for each in records for name in each.scores}), *([_TRUE] * known)]


def score_before(record: Record, name: str, until: float) -> float:
    """Return the largest score of a detector up to a time [s]."""
    if name == _TRUE:
        return -math.inf if record.true_share is None else record.true_share
    if name in _ROLL_OUTS:
        scores = [(answer[0], answer[_ROLL_OUTS[name]]) for answer in record.answers]
    else:
        scores = [(time, score) for time, score in record.scores.get(name, [])]
    return max((score for time, score in scores if time <= until + 1e-9), default=-math.inf)


def scores_of(records: Sequence[Record], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return scores of harmful runs, early enough, and of harmless ones, over the whole run."""
    if name == _TRUE:
        records = [each for each in records if each.true_share is not None]
    harmful = [score_before(each, name, latest_of(each, each.harm_time)) for each in records if each.harm]
    harmless = [score_before(each, name, math.inf) for each in records if is_harmless(each)]
    return np.array(harmful), np.array(harmless)


def report(condition: str, records: Sequence[Record]) -> str:
    """Return the tables of one condition."""
    lines = _announced(condition, records) + _false_alarms(records)
    for title, once in (("first answer", True), ("once a second", False)):
        lines += _calibration(records, title, once)
    return "\n".join(lines + _detectors(records) + _paired(records))


def _announced(condition: str, records: Sequence[Record]) -> list[str]:
    harmful = [each for each in records if each.harm]
    demanding = [each for each in records if each.demand_time is not None]
    lines = [f"{condition}: {len(records)} runs, {len(harmful)} harmful, {len(demanding)} demanding"]
    hits = [is_announced(each, each.harm_time) for each in harmful]
    lines.append(f"  harm announced early enough   {interval(sum(hits), len(hits))}")
    for kind in Harm:
        chosen = [hit for hit, each in zip(hits, harmful, strict=True) if each.harm == kind]
        if chosen:
            lines.append(f"    {kind.name.lower():27} {interval(sum(chosen), len(chosen))}")
    said = [is_announced(each, each.demand_time or 0.0) for each in demanding]
    lines.append(f"  demand announced early enough {interval(sum(said), len(said))}")
    return lines


def _false_alarms(records: Sequence[Record]) -> list[str]:
    harmless = [each for each in records if is_harmless(each)]
    groups = {
        "all": harmless,
        "soft start": [each for each in harmless if each.soft],
        **{law: [each for each in harmless if each.law == law] for law in sorted({each.law for each in harmless})},
        "with pose_estimator": [each for each in harmless if each.chain],
        "without": [each for each in harmless if not each.chain],
    }
    lines = ["  false alarms of harmless runs"]
    for name, chosen in groups.items():
        if chosen:
            alarms = sum(each.first_alert is not None for each in chosen)
            time = sum(each.alert_share * each.frames for each in chosen) / max(sum(e.frames for e in chosen), 1)
            lines.append(f"    {name:27} {interval(alarms, len(chosen))}, {100 * time:.2f} % of the time")
    minutes = sum(each.frames / each.rate for each in harmless) / 60.0
    changes = sum(each.changes for each in harmless)
    if minutes > 0.0:
        lines.append(f"  changes of the level of harmless runs: {changes / minutes:.2f} a minute")
    return lines


def said_and_came(records: Sequence[Record], once: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the risk said, whether harm came, and the run, of the first answers or of those once a second."""
    said, came, runs = [], [], []
    for number, each in enumerate(records):
        last = -math.inf
        for time, _, probability, _ in each.answers[:1] if once else each.answers:
            if time - last >= 1.0:
                last = time
                said.append(probability)
                came.append(float(bool(each.harm)))
                runs.append(number)
    return np.array(said), np.array(came), np.array(runs)


def bins_of(said: np.ndarray, came: np.ndarray, runs: np.ndarray) -> list[tuple[float, int, int]]:
    """Return (mean said, runs that came to harm, runs) of bins of at least 50 runs; a run counts once in a bin."""
    found = []
    low = 0
    for high in range(1, len(_EDGES)):
        inside = (said >= _EDGES[low]) & ((said < _EDGES[high]) | (high == len(_EDGES) - 1))
        rest = len(set(runs[said >= _EDGES[high]].tolist())) if high < len(_EDGES) - 1 else _BIN_RUNS
        members = sorted(set(runs[inside].tolist()))
        if (len(members) < _BIN_RUNS and high < len(_EDGES) - 1) or rest < _BIN_RUNS or not members:
            continue
        means = [float(said[inside & (runs == run)].mean()) for run in members]
        harmed = sum(bool(came[runs == run].any()) for run in members)
        found.append((float(np.mean(means)), harmed, len(members)))
        low = high
    return found


def _calibration(records: Sequence[Record], title: str, once: bool) -> list[str]:
    said, came, runs = said_and_came(records, once)
    if not len(said):
        return []
    lines = [f"  calibration, {title}: Brier score {np.mean((said - came) ** 2):.4f}"]
    for mean, harmed, total in bins_of(said, came, runs):
        low, high = wilson(harmed, total)
        off = max(low - mean, mean - high, 0.0)
        lines.append(
            f"    said {mean:.3f}: harm in {interval(harmed, total)} of the runs; "
            f"{100 * off:.1f} points beyond the interval{'' if off <= 0.1 else ': TOO MUCH'}"
        )
    return lines


def _detectors(records: Sequence[Record]) -> list[str]:
    """Return recall at 5 % false alarms, and with a conformal threshold, of each detector."""
    lines = ["  recall of harm at 5 % false alarms of these harmless runs; conformal: from half of them for the others"]
    for name in detectors(records):
        harmful, harmless = scores_of(records, name)
        if not len(harmful) or len(harmless) < 2:
            continue
        threshold = float(np.quantile(harmless, 1.0 - FALSE, method="higher"))
        half = conformal_threshold(harmless[::2], FALSE)
        lines.append(
            f"    {name:24} > {threshold:<9.3g} {interval(int(np.sum(harmful > threshold)), len(harmful))}; "
            f"conformal > {half:.3g}: {interval(int(np.sum(harmful > half)), len(harmful))}, "
            f"false {interval(int(np.sum(harmless[1::2] > half)), len(harmless[1::2]))}"
        )
    return lines


def _paired(records: Sequence[Record]) -> list[str]:
    """Return the recall of risk and of six true runs at each false rate that six runs can have."""
    records = [each for each in records if each.true_share is not None]
    if not records:
        return []
    (ours, calm), (true, true_calm) = scores_of(records, "risk"), scores_of(records, _TRUE)
    lines = [f"  risk and six true runs at the same false rate, {len(records)} runs"]
    if not len(ours) or not len(calm):
        return []
    for level in sorted(set(true_calm.tolist()) | {0.0}):
        rate, recall = float(np.mean(true_calm > level)), float(np.mean(true > level))
        threshold = np.sort(calm)[::-1][min(int(rate * len(calm)), len(calm) - 1)]
        mine = float(np.mean(ours > threshold))
        ratio = f"{mine / recall:.2f}" if recall else "-"
        lines.append(
            f"    share > {level:.2f}: false {100 * rate:.1f} %, recall {100 * recall:.1f} %; "
            f"risk > {threshold:.3f}: {100 * mine:.1f} %, ratio {ratio}"
        )
    return lines
