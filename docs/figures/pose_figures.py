# SPDX-License-Identifier: Apache-2.0
"""Draw the figures of docs/pose.md: python docs/figures/pose_figures.py, and print the errors of all seeds.

pose_consistency.png comes from python3 -m benchmark.pose_quality --figure docs/figures/pose_consistency.png.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from paper.pose_quadrifolium import EXPERIMENTS, run, save_figure
from plsing_ros.pose import Verdict

HERE = Path(__file__).parent
NAMES = ("away", "isolated_point", "transversal", "five_lines", "five_lines_away")


def main() -> None:
    """Run the five experiments, draw the first seed and print the quantiles of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="of the noise, 1 to this (default: 5)")
    options = parser.parse_args()
    print("| experiment | estimate | translation: median / 95 % / max [m] | rotation [rad] | samples |")
    print("|---|---|---|---|---|")
    for name, experiment in zip(NAMES, EXPERIMENTS, strict=True):
        results = run(experiment, tuple(range(1, options.seeds + 1)))
        save_figure(results, HERE / f"pose_{name}.png")
        ok = results.verdict == Verdict.OK.value
        for label, shift, turn, chosen in (
            ("first", results.first_translation, results.first_rotation, np.ones_like(ok)),
            ("refined", results.refined_translation, results.refined_rotation, np.ones_like(ok)),
            ("refined, OK", results.refined_translation, results.refined_rotation, ok),
        ):
            numbers = [" / ".join(f"{v:.2g}" for v in results.summary(each, chosen)) or "-" for each in (shift, turn)]
            print(f"| {experiment.name} | {label} | {numbers[0]} | {numbers[1]} | {chosen.mean():.0%} |", flush=True)


if __name__ == "__main__":
    main()
