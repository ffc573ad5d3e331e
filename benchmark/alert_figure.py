# SPDX-License-Identifier: Apache-2.0
"""The figure of the alerts: ROC of all detectors, and how far the said risk is what came."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmark.alert_runs import Record
from benchmark.alerts import scores_of


def draw(records: Mapping[str, Sequence[Record]], path: str) -> None:
    """Write a PNG with one column for each condition."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, len(records), figsize=(4.5 * len(records), 8.0), squeeze=False)
    for column, (condition, runs) in enumerate(records.items()):
        roc, reliability = axes[0][column], axes[1][column]
        for name in sorted({name for each in runs for name in each.scores}):
            harmful, harmless = scores_of(runs, name)
            if len(harmful) and len(harmless):
                steps = np.sort(np.concatenate([harmful, harmless, [-np.inf]]))[::-1]
                false, recall = ([np.mean(group > step) for step in steps] for group in (harmless, harmful))
                roc.plot(false, recall, label=name)
        roc.set(title=condition, xlabel="false alarms, share of runs", ylabel="recall of harm", xlim=(-0.02, 1.02))
        roc.legend(fontsize="small")
        first = [(each.answers[0][1], bool(each.harm)) for each in runs if each.answers]
        said, came = (np.array(values, dtype=float) for values in zip(*first, strict=True))
        levels = np.unique(said)
        shares = [came[said == level].mean() for level in levels]
        sizes = [8.0 + 60.0 * np.sqrt(np.mean(said == level)) for level in levels]
        reliability.plot([0.0, 1.0], [0.0, 1.0], "k:")
        reliability.scatter(levels, shares, sizes)
        reliability.set(xlabel="risk said at the first answer", ylabel="share that came to harm")
    figure.tight_layout()
    figure.savefig(path, dpi=90)
