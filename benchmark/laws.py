# SPDX-License-Identifier: Apache-2.0
"""Every control law of the package beside rivals from the literature, in tasks that are as wrong as real ones.

Segments of 0.2 to 5 m, 30 Hz, lambda 0.1 to 2, four conditions (servo_conditions.py). Two thirds of the tasks lead
across a line that all observed lines meet. All laws have the same tasks, errors, poses, limits and latency to look
ahead by; rivals are in rivals.py.

    python3 -m benchmark laws
    python3 -m benchmark laws --quick
    python3 -m benchmark.laws --tasks 30 --conditions harsh shown --laws fused position position-based
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmark.rivals import RIVALS
from benchmark.servo_conditions import CONDITIONS, draw_task
from benchmark.servo_loop import Outcome, run

SEED = 1
TASKS = 340
_QUICK = 18
RECOMMENDED = "fused"


@dataclass(frozen=True)
class Contender:
    """A law of the package with options, or a rival."""

    law: str
    options: dict[str, object] = field(default_factory=dict)


CONTENDERS = {
    "pinv": Contender("pinv"),
    "pinv, MEAN": Contender("pinv", {"interaction": "mean"}),
    "dls": Contender("dls"),
    "guarded": Contender("guarded"),
    "position": Contender("position"),
    "fused": Contender("fused"),
    **{name: Contender(name) for name in RIVALS},
}


def main(quick: bool = False) -> None:
    """Print the tables."""
    study(tuple(CONDITIONS), tuple(CONTENDERS), _QUICK if quick else TASKS, SEED)


def study(conditions: Sequence[str], laws: Sequence[str], tasks: int, seed: int) -> None:
    """Print a table for each condition."""
    for condition in conditions:
        jobs = [(condition, tuple(laws), seed, number) for number in range(tasks)]
        with multiprocessing.get_context("spawn").Pool(os.cpu_count()) as pool:
            runs = pool.map(_runs_of_task, jobs, chunksize=1)
        _print(condition, {law: [each[i] for each in runs] for i, law in enumerate(laws)})


def _runs_of_task(job: tuple[str, tuple[str, ...], int, int]) -> list[Outcome]:
    name, laws, seed, number = job
    condition = CONDITIONS[name]
    task = draw_task(np.random.default_rng([seed, number]), condition, number % 3 != 2)
    chosen = [CONTENDERS[law] for law in laws]
    return [run(task, condition, each.law, each.options, number) for each in chosen]


def _print(condition: str, runs: dict[str, list[Outcome]]) -> None:
    count = len(next(iter(runs.values())))
    print(f"\n{condition}, {count} tasks\n")
    print(
        f"| law | arrived | {RECOMMENDED} arrives more often by | farther than 1.5 d0 | lines lost | path / straight | "
        "s | ends off [mm] | farthest / d0 | speed / limit | refused frames | step [us] |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|---|"
    )
    for law, outcomes in runs.items():
        arrived = [each.arrived for each in outcomes]
        against = ""
        if law != RECOMMENDED and RECOMMENDED in runs:
            against = "{:+.1f} % ({:+.1f} to {:+.1f})".format(*paired(runs[RECOMMENDED], outcomes))
        there = [each for each in outcomes if each.arrived] or outcomes
        cells = (
            f"{sum(arrived)} ({np.mean(arrived):.1%})",
            against,
            str(sum(each.away for each in outcomes)),
            str(sum(each.lost for each in outcomes)),
            f"{np.median([each.path for each in there]):.2f}",
            f"{np.median([each.seconds for each in there]):.1f}",
            f"{1e3 * np.median([each.error for each in outcomes]):.2f}",
            f"{max(each.farthest for each in outcomes):.2f}",
            f"{max(each.speed for each in outcomes):.4f}",
            f"{sum(each.refused for each in outcomes)} of {sum(each.frames for each in outcomes)}",
            f"{1e6 * np.median([each.step for each in outcomes]):.0f}",
        )
        print(f"| {law} | {' | '.join(cells)} |", flush=True)


def paired(ours: Sequence[Outcome], theirs: Sequence[Outcome]) -> tuple[float, float, float]:
    """Return by how many per cent of the tasks ours arrive more often, and the 95 % interval of that.

    Source: Agresti and Min, Simple improved confidence intervals for comparing matched proportions (2005).
    """
    n = len(ours)
    more = sum(a.arrived and not b.arrived for a, b in zip(ours, theirs, strict=True))
    fewer = sum(b.arrived and not a.arrived for a, b in zip(ours, theirs, strict=True))
    b, c, m = more + 0.5, fewer + 0.5, n + 2.0
    half = 1.96 * math.sqrt(b + c - (b - c) ** 2 / m) / m
    return 100.0 * (more - fewer) / n, 100.0 * ((b - c) / m - half), 100.0 * ((b - c) / m + half)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--tasks", type=int, default=TASKS, help="for each condition")
    parser.add_argument("--conditions", nargs="+", choices=CONDITIONS, default=tuple(CONDITIONS))
    parser.add_argument("--laws", nargs="+", metavar="LAW", choices=CONTENDERS, default=tuple(CONTENDERS))
    options = parser.parse_args()
    study(options.conditions, options.laws, options.tasks, options.seed)
