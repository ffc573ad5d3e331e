# SPDX-License-Identifier: Apache-2.0
"""Command survey: how many real isolated singular points random four-line scenes have, and how often.

The output has a header and one line for each finished chunk; running the same command again continues it. Every chunk
has its own random stream, so that the result does not depend on where a run was interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.analysis.checkpoint import Checkpoint
from plsing_ros.analysis.parallel import run_tasks
from plsing_ros.arrays import Array
from plsing_ros.cli.command import add_worker_options
from plsing_ros.errors import ParameterError, PlsingError
from plsing_ros.geometry import LineSet
from plsing_ros.singularities import singular_set
from plsing_ros.singularities.batch import solve_four_line_scenes

_EPILOG = """examples:
  survey                                              a hundred thousand scenes, in half a minute
  survey --scenes 1000000 --output survey.jsonl       can be interrupted and continued
  survey --scenes 100000000 --scheduler tcp://host:8786 --output survey.jsonl"""

_CHUNK = 2000
# Chunks that one task takes, so that it lasts about a second.
_CHUNKS_PER_TASK = 5
_BAR = 50
# What report needs of a chunk.
_COUNTED = {"chunk", "elliptic", "hyperbolic", "max_residual", "solved_again", "unresolved"}


def random_scenes(seed: int, chunk: int, count: int) -> tuple[Array, Array]:
    """Return points and directions of count scenes of four lines, standard normal components, each (count, 4, 3)."""
    rng = np.random.default_rng([seed, chunk])
    points, directions = rng.normal(size=(2, count, 4, 3))
    return points, directions


def survey_chunk(seed: int, chunk: int, count: int) -> dict[str, Any]:
    """Return the counts of one chunk: scenes by number of real points, without and with real transversals.

    A scene the fast solver does not call generic is solved again on its own; one that is still without ten points is
    listed under "unresolved" with its number in the chunk.
    """
    points, directions = random_scenes(seed, chunk, count)
    batch = solve_four_line_scenes(points, directions)
    real = batch.real.sum(axis=1)
    unresolved = []
    for scene in np.flatnonzero(~batch.generic):
        singular = singular_set(LineSet.from_points_directions(points[scene], directions[scene]))
        real[scene] = len(singular.isolated_points)
        if len(singular.isolated_points_complex) != 10:
            unresolved.append(int(scene))
    table = np.zeros((2, 11), dtype=int)
    resolved = np.setdiff1d(np.arange(count), unresolved)
    np.add.at(table, ((batch.discriminant[resolved] > 0.0).astype(int), real[resolved]), 1)
    return {
        "chunk": chunk,
        "elliptic": table[0].tolist(),
        "hyperbolic": table[1].tolist(),
        "max_residual": float(batch.residual[batch.generic].max(initial=0.0)),
        "solved_again": int((~batch.generic).sum()),
        "unresolved": unresolved,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the survey; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="survey", description=__doc__, epilog=_EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=100_000, help="how many (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="of the random scenes (%(default)s)")
    parser.add_argument("--output", type=Path, help="file to write and to continue; nothing is kept without it")
    add_worker_options(parser)
    options = parser.parse_args(arguments)
    try:
        if options.scenes < 1 or options.seed < 0:
            raise ParameterError(f"--scenes {options.scenes} and --seed {options.seed}: need at least 1 and at least 0")
        header = {"survey": "real isolated points of four lines", "seed": options.seed, "scenes_per_chunk": _CHUNK}
        records = list(_run(options, Checkpoint(options.output, header, "chunk")))
    except (PlsingError, OSError) as error:
        print(f"survey: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nsurvey: interrupted; run the same command again to continue", file=sys.stderr)
        return 130
    print(report(records))
    return 0


def _run(options: argparse.Namespace, checkpoint: Checkpoint) -> Iterator[dict[str, Any]]:
    from tqdm import tqdm

    finished = checkpoint.records
    sizes = [_CHUNK] * (options.scenes // _CHUNK) + ([options.scenes % _CHUNK] if options.scenes % _CHUNK else [])
    open_chunks = [(options.seed, i, size) for i, size in enumerate(sizes) if not _is_whole(finished.get(i), size)]
    tasks = [open_chunks[i : i + _CHUNKS_PER_TASK] for i in range(0, len(open_chunks), _CHUNKS_PER_TASK)]
    with tqdm(total=options.scenes, unit="scene", disable=None) as bar:
        bar.update(options.scenes - sum(size for _, _, size in open_chunks))
        for records in run_tasks(_survey_chunks, tasks, options.scheduler, options.processes):
            for record in records:
                checkpoint.add(record)
                bar.update(sizes[record["chunk"]])
    yield from (finished[chunk] for chunk in range(len(sizes)))


def _survey_chunks(chunks: Sequence[tuple[int, int, int]]) -> list[dict[str, Any]]:
    return [survey_chunk(*chunk) for chunk in chunks]


def _is_whole(record: dict[str, Any] | None, size: int) -> bool:
    if record is None or not record.keys() >= _COUNTED:
        return False
    counted: int = sum(record["elliptic"]) + sum(record["hyperbolic"]) + len(record["unresolved"])
    return counted == size


def report(records: Sequence[dict[str, Any]]) -> str:
    """Return the table and histogram of finished chunks as text."""
    elliptic = np.sum([record["elliptic"] for record in records], axis=0)
    hyperbolic = np.sum([record["hyperbolic"] for record in records], axis=0)
    total = int(elliptic.sum() + hyperbolic.sum())
    lines = ["real points   no transversal  two transversals      share"]
    for count in range(11):
        both = int(elliptic[count] + hyperbolic[count])
        share = both / total if total else 0.0
        row = f"{count:11d}  {elliptic[count]:15d}  {hyperbolic[count]:16d}  {share:8.4%}  {'#' * round(_BAR * share)}"
        lines.append(row.rstrip())
    unresolved = sum(len(record["unresolved"]) for record in records)
    again = sum(record["solved_again"] for record in records)
    residual = max((record["max_residual"] for record in records), default=0.0)
    lines.append(
        f"{total} scenes with all ten points, {unresolved} without; {again} solved twice; "
        f"largest residual {residual:.2g}"
    )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
