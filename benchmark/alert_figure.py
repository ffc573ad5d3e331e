# SPDX-License-Identifier: Apache-2.0
"""The figure of the alerts: ROC of all detectors, and how far the risk that is said is the share that comes to harm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmark.alert_report import bins_of, detectors, said_and_came, scores_of, wilson
from benchmark.alert_runs import Record


def draw(records: Mapping[str, Sequence[Record]], path: str) -> None:
    """Write a PNG with one column for each condition."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, len(records), figsize=(4.5 * len(records), 8.0), squeeze=False)
    for column, (condition, runs) in enumerate(records.items()):
        roc, reliability = axes[0][column], axes[1][column]
        for name in detectors(runs):
            harmful, harmless = scores_of(runs, name)
            if len(harmful) and len(harmless):
                steps = np.concatenate([[np.inf], np.sort(np.concatenate([harmful, harmless]))[::-1], [-np.inf]])
                false, recall = ([np.mean(group > step) for step in steps] for group in (harmless, harmful))
                roc.plot([*false, 1.0], [*recall, 1.0], label=name, lw=2.5 if name == "risk" else 1.2)
        roc.axvline(0.05, color="0.8", lw=0.8, zorder=0)
        roc.set(
            title=condition,
            xlabel="share of harmless runs that alert",
            ylabel="share of harmful runs announced",
            xlim=(-0.02, 1.02),
            ylim=(-0.02, 1.02),
        )
        roc.legend(fontsize="small", loc="lower right")
        reliability.plot([0.0, 1.0], [0.0, 1.0], "k:", lw=0.8)
        for once, label, marker in ((True, "first answer", "o"), (False, "once a second", "s")):
            bins = bins_of(*said_and_came(runs, once))
            said = np.array([mean for mean, _, _ in bins])
            share = np.array([harmed / total for _, harmed, total in bins])
            bounds = np.array([wilson(harmed, total) for _, harmed, total in bins])
            error = np.abs(bounds.T - share)
            reliability.errorbar(said, share, error, fmt=marker, capsize=3, ms=5, label=label)
        reliability.set(
            xlabel="risk said", ylabel="share of the runs that came to harm", xlim=(-0.03, 1.03), ylim=(-0.03, 1.03)
        )
        reliability.legend(fontsize="small", loc="upper left")
    figure.tight_layout()
    figure.savefig(path, dpi=90)
