# SPDX-License-Identifier: Apache-2.0
"""Every control law of the package beside rivals from the literature, in tasks that are as wrong as real ones.

Segments of 0.2 to 5 m, 30 Hz, lambda 0.5 to 2, the conditions of servo_conditions.py and those below. Two thirds of the
tasks lead across a line that all observed lines meet. All laws have the same tasks, errors in every frame, poses,
filter, limits and latency to look ahead by; rivals are in rivals.py. Results are kept in a file, so that a study can be
ended and gone on with.

    python3 -m benchmark laws
    python3 -m benchmark laws --quick
    python3 -m benchmark.laws --tasks 30 --conditions harsh shown --laws fused position
    python3 -m benchmark.laws --tables --results FILE
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmark.four_motions import MOTIONS, draw_motion
from benchmark.rivals import RIVALS
from benchmark.servo_conditions import CONDITIONS, HALF_VIEW, NOMINAL, Condition, SegmentTask, draw_task
from benchmark.servo_loop import Contender, RunOutcome, run

SEED = 1
TASKS = 340
_QUICK = 9
# Slower runs take minutes each and show the same [1/s].
_GAINS = (0.5, 2.0)
RECOMMENDED = "fused"
RESULTS = Path("build/benchmark/laws.jsonl")
_MOTIONS = "motions"
LAW_CONDITIONS: dict[str, Condition] = {
    **CONDITIONS,
    "chain": replace(NOMINAL, name="chain", chain=True),
    "chain, shown": replace(CONDITIONS["shown"], name="chain, shown", chain=True),
    "wrong pose": replace(NOMINAL, name="wrong pose", wrong_pose=1.0),
    _MOTIONS: replace(NOMINAL, name=_MOTIONS),
}
CONTENDERS = {
    "pinv": Contender("pinv"),
    "pinv, MEAN": Contender("pinv", {"interaction": "mean"}),
    "pinv, DESIRED": Contender("pinv", {"interaction": "target"}),
    "pinv, adaptive gain, threshold": Contender("pinv", {"pinv_threshold": 1e-3}),
    "dls": Contender("dls"),
    "guarded": Contender("guarded"),
    "detour": Contender("detour", {"camera.half_view": [HALF_VIEW, HALF_VIEW]}),
    "position": Contender("position"),
    "fused": Contender("fused"),
    **{name: Contender(name) for name in RIVALS},
}
# The textbook's position-based law gives what `position` gives.
STUDIED = tuple(name for name in CONTENDERS if name != "position-based")

Runs = dict[str, dict[int, dict[str, RunOutcome]]]


def main(quick: bool = False) -> None:
    """Print the tables, with what a study before has left undone."""
    file = None if quick else RESULTS
    print_tables(study(tuple(LAW_CONDITIONS), STUDIED, range(_QUICK if quick else TASKS), SEED, file), STUDIED)


def study(conditions: Sequence[str], laws: Sequence[str], tasks: Iterable[int], seed: int, file: Path | None) -> Runs:
    """Run what is missing, a task of each condition after the other, and return all that there is."""
    runs = load(file, seed)
    for number in tasks:
        for name in conditions:
            missing = [law for law in laws if law not in runs.get(name, {}).get(number, {})]
            if not missing:
                continue
            task = task_of(name, seed, number)
            outcomes = run(task, LAW_CONDITIONS[name], {law: _contender(law, task) for law in missing}, number)
            runs.setdefault(name, {}).setdefault(number, {}).update(outcomes)
            if file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                with file.open("a") as stream:
                    for law, outcome in outcomes.items():
                        values = [seed, name, number, law, dataclasses.asdict(outcome)]
                        stream.write(json.dumps(values) + "\n")
    return runs


def load(file: Path | None, seed: int) -> Runs:
    """Return what a file has of a seed; of a law that was run twice, the later."""
    runs: Runs = {}
    if file is not None and file.exists():
        for line in file.read_text().splitlines():
            of_seed, name, number, law, outcome = json.loads(line)
            if of_seed == seed:
                runs.setdefault(name, {}).setdefault(number, {})[law] = RunOutcome(**outcome)
    return runs


def task_of(condition: str, seed: int, number: int) -> SegmentTask:
    """Return a task of a condition, always the same."""
    rng, chosen = np.random.default_rng([seed, number]), LAW_CONDITIONS[condition]
    motion = condition == _MOTIONS
    crossing = is_crossing(condition, number)
    task = draw_motion(rng, chosen, number % len(MOTIONS)) if motion else draw_task(rng, chosen, crossing)
    return replace(task, gain=float(np.exp(rng.uniform(*np.log(_GAINS)))))


def is_crossing(condition: str, number: int) -> bool:
    """Return whether a task leads across a line that all observed lines meet: two of three do, but for motions."""
    return condition != _MOTIONS and number % 3 != 2


def _contender(law: str, task: SegmentTask) -> Contender:
    chosen = CONTENDERS[law]
    if "adaptive gain" in law:
        # As ViSP's examples have it: four times the gain near the target.
        gains = {"gain": 2.0 * task.gain, "gain_at_infinity": 0.5 * task.gain, "gain_slope": 10.0 * task.gain}
        chosen = Contender(chosen.law, {**chosen.options, **gains})
    return chosen


def print_tables(runs: Runs, laws: Sequence[str]) -> None:
    """Print a table for each condition; a law is compared on the tasks that it and the recommended one have done."""
    for name, by_number in runs.items():
        there = [law for law in laws if any(law in outcomes for outcomes in by_number.values())]
        if there:
            _print(
                name, {law: {k: by_number[k][law] for k in sorted(by_number) if law in by_number[k]} for law in there}
            )
            if name == _MOTIONS:
                _print_motions(by_number, there)


def _print(condition: str, runs: dict[str, dict[int, RunOutcome]]) -> None:
    print(
        f"\n**{condition}**\n\n| law | tasks | arrived | across a line, others | {RECOMMENDED} arrives more often by | "
        "farther than 1.5 d0 | ends farther than d0 | lines lost | path / straight | s | ends off [mm] | "
        "of that of position | farthest / d0 | speed / limit | refused frames | step [us] |\n" + 16 * "|---" + "|"
    )
    for law, by_number in runs.items():
        outcomes = list(by_number.values())
        arrived = [each.arrived for each in outcomes]
        crossing = [each.arrived for number, each in by_number.items() if is_crossing(condition, number)]
        against = ""
        if law != RECOMMENDED and RECOMMENDED in runs:
            against = "{:+.1f} % ({:+.1f} to {:+.1f})".format(*paired(*_both(runs[RECOMMENDED], by_number)))
        errors, ratio = np.array([each.error for each in outcomes]), ""
        if "position" in runs and law != "position":
            ratio = "{:.2f} ({:.2f} to {:.2f})".format(*median_ratio(*_both(runs["position"], by_number)))
        there = [each for each in outcomes if each.arrived] or outcomes
        cells = (
            str(len(outcomes)),
            f"{np.mean(arrived):.1%}",
            f"{sum(crossing)} of {len(crossing)}, {sum(arrived) - sum(crossing)} of {len(arrived) - len(crossing)}",
            against,
            str(sum(each.away for each in outcomes)),
            str(sum(each.error > max(each.start, 0.05) + 1e-3 for each in outcomes)),
            str(sum(each.lost for each in outcomes)),
            f"{np.median([each.path for each in there]):.2f}",
            f"{np.median([each.seconds for each in there]):.1f}",
            f"{1e3 * np.median(errors):.2f}",
            ratio,
            f"{max(each.farthest for each in outcomes):.2f}",
            f"{max(each.speed for each in outcomes):.4f}",
            f"{sum(each.refused for each in outcomes)} of {sum(each.frames for each in outcomes)}",
            f"{1e6 * np.median([each.step for each in outcomes]):.0f}",
        )
        print(f"| {law} | {' | '.join(cells)} |", flush=True)


def _both(
    ours: Mapping[int, RunOutcome], theirs: Mapping[int, RunOutcome]
) -> tuple[list[RunOutcome], list[RunOutcome]]:
    """Return the outcomes of the tasks that both have done."""
    numbers = [number for number in theirs if number in ours]
    return [ours[number] for number in numbers], [theirs[number] for number in numbers]


def _print_motions(runs: Mapping[int, Mapping[str, RunOutcome]], laws: Sequence[str]) -> None:
    print(f"\n| arrived | {' | '.join(MOTIONS)} |\n|---|{'---|' * len(MOTIONS)}")
    for law in laws:
        cells = []
        for kind in range(len(MOTIONS)):
            of_kind = [each for number, each in runs.items() if number % len(MOTIONS) == kind]
            arrived = [outcomes[law].arrived for outcomes in of_kind if law in outcomes]
            cells.append(f"{sum(arrived)} of {len(arrived)}")
        print(f"| {law} | {' | '.join(cells)} |")


def paired(ours: Sequence[RunOutcome], theirs: Sequence[RunOutcome]) -> tuple[float, float, float]:
    """Return by how many per cent of the tasks ours arrive more often, and the 95 % interval of that.

    Source: Agresti and Min, Simple improved confidence intervals for comparing matched proportions (2005).
    """
    n = len(ours)
    more = sum(a.arrived and not b.arrived for a, b in zip(ours, theirs, strict=True))
    fewer = sum(b.arrived and not a.arrived for a, b in zip(ours, theirs, strict=True))
    b, c, m = more + 0.5, fewer + 0.5, n + 2.0
    half = 1.96 * math.sqrt(b + c - (b - c) ** 2 / m) / m
    return 100.0 * (more - fewer) / n, 100.0 * ((b - c) / m - half), 100.0 * ((b - c) / m + half)


def median_ratio(of: Sequence[RunOutcome], others: Sequence[RunOutcome]) -> tuple[float, float, float]:
    """Return the ratio of the others' median error to that of the first, and the 95 % interval over the paired tasks.

    Source: the percentile bootstrap, Efron and Tibshirani (1993).
    """
    errors = np.array([[a.error, b.error] for a, b in zip(of, others, strict=True)])
    drawn = np.random.default_rng(0).integers(len(errors), size=(1000, len(errors)))
    medians = np.median(errors[drawn], axis=1)
    middle = np.median(errors, axis=0)
    low, high = np.quantile(medians[:, 1] / medians[:, 0], (0.025, 0.975))
    return float(middle[1] / middle[0]), float(low), float(high)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--tasks", type=int, default=TASKS, help="for each condition")
    parser.add_argument("--conditions", nargs="+", choices=LAW_CONDITIONS, default=tuple(LAW_CONDITIONS))
    parser.add_argument("--laws", nargs="+", metavar="LAW", choices=CONTENDERS, default=STUDIED)
    parser.add_argument("--results", type=Path, default=RESULTS, help="file to go on with (default: %(default)s)")
    parser.add_argument("--tables", action="store_true", help="only print what the file has")
    options = parser.parse_args()
    if options.tables:
        print_tables(load(options.results, options.seed), options.laws)
    else:
        found = study(options.conditions, options.laws, range(options.tasks), options.seed, options.results)
        print_tables(found, options.laws)
