"""Command survey: how many real isolated singular points random four-line scenes have, and how often.

The output has a header and one line for each finished chunk; running the same command again continues it. Every chunk
has its own random stream, so that the result does not depend on where a run was interrupted.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import ParameterError, PlsingError
from plsing_ros.geometry import LineSet
from plsing_ros.singularities import singular_set
from plsing_ros.singularities.batch import solve_four_line_scenes

_EPILOG = """examples:
  survey                                              a hundred thousand scenes, in half a minute
  survey --scenes 1000000 --output survey.jsonl       can be interrupted and continued"""

_CHUNK = 2000
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
    options = parser.parse_args(arguments)
    try:
        if options.scenes < 1 or options.seed < 0:
            raise ParameterError(f"--scenes {options.scenes} and --seed {options.seed}: need at least 1 and at least 0")
        finished = _read(options.output, options.seed)
        records = list(_run(options, finished))
    except (PlsingError, OSError) as error:
        print(f"survey: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nsurvey: interrupted; run the same command again to continue", file=sys.stderr)
        return 130
    print(report(records))
    return 0


def _run(options: argparse.Namespace, finished: dict[int, dict[str, Any]]) -> Iterator[dict[str, Any]]:
    from tqdm import tqdm

    sizes = [_CHUNK] * (options.scenes // _CHUNK) + ([options.scenes % _CHUNK] if options.scenes % _CHUNK else [])
    with tqdm(total=options.scenes, unit="scene", disable=None) as bar:
        for chunk, size in enumerate(sizes):
            record = finished.get(chunk)
            if (
                record is None
                or sum(record["elliptic"]) + sum(record["hyperbolic"]) + len(record["unresolved"]) != size
            ):
                record = survey_chunk(options.seed, chunk, size)
                if options.output is not None:
                    with options.output.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(record) + "\n")
            bar.update(size)
            yield record


def _read(output: Path | None, seed: int) -> dict[int, dict[str, Any]]:
    """Return the finished chunks of an earlier run by number, and write the header of a new one."""
    header = {"survey": "real isolated points of four lines", "seed": seed, "scenes_per_chunk": _CHUNK}
    if output is None:
        return {}
    if not output.exists() or output.stat().st_size == 0:
        output.write_text(json.dumps(header) + "\n", encoding="utf-8")
        return {}
    try:
        first, *lines = output.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise ParameterError(f"{output} is not a survey but a binary file; give another --output") from None
    if _record(first) != header:
        raise ParameterError(
            f"{output} belongs to another survey or is none (it begins with {first[:100]!r}); give another --output "
            "or the same seed"
        )
    # The last line of an interrupted run may be cut off; its chunk is computed again.
    records = [record for record in map(_record, lines) if record.keys() >= _COUNTED]
    return {int(record["chunk"]): record for record in records}


def _record(line: str) -> dict[str, Any]:
    """Return what a line says, or nothing if it is no record."""
    try:
        record = json.loads(line)
    except json.JSONDecodeError:
        return {}
    return record if isinstance(record, dict) else {}


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
