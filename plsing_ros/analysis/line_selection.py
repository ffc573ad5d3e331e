# SPDX-License-Identifier: Apache-2.0
"""Which k of n candidate lines to servo on: the most exact set along a path that keeps away from singularities."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from plsing_ros.analysis.accuracy import MIN_LINES, Camera
from plsing_ros.analysis.checkpoint import Checkpoint, digest
from plsing_ros.analysis.line_search import (
    CHECKED,
    LociTask,
    Search,
    Sets,
    SetsTask,
    StartsTask,
    deviation_of,
    merged,
    run_search_task,
    sets_tasks,
    starts_tasks,
)
from plsing_ros.analysis.parallel import Workers
from plsing_ros.arrays import checked_array
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet, Pose

# Up to so many sets all are tried.
MAX_EXHAUSTIVE = 400_000
MAX_POSES = 50
_RANDOM = 500
# Sets whose loci one task computes.
_LOCI_A_TASK = 10
# Rows of each kind in a summary.
_SHOWN = 5

_Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class LineSelection:
    """The chosen lines, and what other choices would give. Deviations are standard deviations of the camera's position
    in its worst direction, the largest over the poses [m]; infinite where fewer than three lines are in view.

    Attributes:
        ids: Of the chosen lines, in the order of the candidates.
        deviation: Of the chosen lines.
        clearance: Distance of the poses' centres to the nearest singular locus of the chosen lines [m]; infinite if
            there is none.
        locus: Name of that locus, or "".
        exact: Whether every set was compared; else it is the best of an exchange from several starts.
        dropped: More exact sets that come nearer to a locus than asked: ids, deviation, distance, name of the locus.
        without: For each chosen line, the deviation of the others alone.
        instead: For each line that was not chosen, the best deviation with it in the place of a chosen one.
        random: Median deviation of random sets of as many lines.
        longest: Deviation of the longest lines; None if the lines have no ends.
        everything: Deviation of all lines.
        clearance_asked: What the clearance was to be [m].
    """

    ids: tuple[int, ...]
    deviation: float
    clearance: float
    locus: str
    exact: bool
    dropped: tuple[tuple[tuple[int, ...], float, float, str], ...]
    without: dict[int, float]
    instead: dict[int, float]
    random: float
    longest: float | None
    everything: float
    clearance_asked: float

    @property
    def is_clear(self) -> bool:
        """Whether the poses keep the clearance that was asked for."""
        return self.clearance >= self.clearance_asked

    def table(self) -> list[tuple[str, float]]:
        """Return the rows of a comparison: what is chosen, and its deviation [m]."""
        rows = [("these lines", self.deviation), ("a random choice (median)", self.random)]
        if self.longest is not None:
            rows.append(("the longest lines", self.longest))
        return [*rows, ("all lines", self.everything)]

    def __str__(self) -> str:
        how = "the best of all sets" if self.exact else "the best found by exchange"
        rows = [f"lines {_listed(self.ids)}: {how}", ""]
        rows.append("standard deviation of the position, worst direction, worst pose:")
        rows += [f"  {name:26s} {_mm(value):>12s}" for name, value in self.table()]
        near = f"{self.clearance:.3g} m from {self.locus}" if self.locus else "they have no singular locus"
        rows += [
            "",
            f"nearest to a singularity: {near}{'' if self.is_clear else f'; asked were {self.clearance_asked:g} m'}",
        ]
        rows += ["", "why each:"]
        rows += [f"  line {i}: without it {_mm(value)}" for i, value in self.without.items()]
        ordered = sorted(self.instead.items(), key=lambda item: item[1])
        if ordered:
            rows += ["", "what was left out, and the best it could do in the place of another line:"]
            rows += [f"  line {i}: {_mm(value)}" for i, value in ordered[:_SHOWN]]
        if len(ordered) > _SHOWN:
            rows.append(f"  and {len(ordered) - _SHOWN} more lines, {_mm(ordered[-1][1])} at worst")
        if self.dropped:
            rows += ["", "more exact, but given up for a singularity near the path:"]
            rows += [
                f"  lines {_listed(ids)}: {_mm(value)}, {distance:.2g} m from {name}"
                for ids, value, distance, name in self.dropped[:_SHOWN]
            ]
        if len(self.dropped) > _SHOWN:
            rows.append(f"  and {len(self.dropped) - _SHOWN} more sets")
        return "\n".join(rows)


def select_lines(
    lines: LineSet,
    count: int,
    poses: Sequence[Pose],
    *,
    ends: npt.ArrayLike | None = None,
    image_std: float = 1e-3,
    max_angle: float = math.pi / 3,
    clearance: float = 0.1,
    progress: _Progress = lambda done, total: None,
    processes: int | None = 1,
    scheduler: str | None = None,
    resume: Path | None = None,
) -> LineSelection:
    """Return the lines to servo on: the smallest of the largest position deviation over the poses.

    Up to 400,000 sets are all compared; of more, the best of an exchange of lines from twelve starts is taken. Of the
    best 200 sets the first is chosen whose loci, those that are singular only within the lines' tolerances included,
    keep the clearance from the poses. If none does, it is the one with the largest clearance. The same input gives the
    same answer, to the last digit, whoever does the work.

    Args:
        lines: n candidates in the world frame.
        count: How many to choose, k.
        poses: T_world_camera along a path, or spread over a workspace; of more than 50, 50 are used.
        ends: End points of the segments, shape (n, 2, 3) [m]; None: the lines have no ends.
        image_std: Standard deviation of an image line's angle [rad] and offset.
        max_angle: A line is in view within this angle of the optical axis [rad].
        clearance: Distance from the path to singular loci that is asked for [m].
        progress: Called with what is done and the total, of one stage after the other.
        processes: Of this machine; None: as many as there are cores. More than one needs the caller's main module to
            be importable (`if __name__ == "__main__":`).
        scheduler: Address of a Dask cluster that does the work instead ("tcp://host:8786").
        resume: Folder for a file of what is done, from which the same call goes on after it was stopped.

    Raises:
        GeometryError: If count is not between 3 and n, there is no pose, or ends has another shape.
        ParameterError: If processes is below 1.
        SchedulerError: If the cluster or the processes cannot be used.

    Source: new, docs/results/line_selection.md.
    """
    n = len(lines)
    if not MIN_LINES <= count <= n:
        raise GeometryError(f"count is {count}; it must be between {MIN_LINES} and the number of candidates, {n}")
    segments = None if ends is None else checked_array("ends", np.reshape(ends, (-1, 2, 3)), (n, 2, 3))
    chosen_poses = _thinned(poses)
    search = Search(lines, count, chosen_poses, Camera(image_std, max_angle), segments)
    costs = search.costs
    exact = math.comb(n, count) <= MAX_EXHAUSTIVE
    checkpoint = _checkpoint(resume, search, exact)
    with Workers(scheduler, processes) as workers:
        sets = _best_sets(search, workers, checkpoint, exact, progress)
        kept, dropped = _keep_clear(search, sets, clearance, workers, checkpoint, progress)
    best, value, distance, locus = kept
    rest = [i for i in range(n) if i not in best]
    without = {i: [j for j in best if j != i] for i in best}
    instead = {i: [[i if j == other else j for j in best] for other in best] for i in rest}
    generator = np.random.default_rng(0)
    random = np.array([generator.permutation(n)[:count] for _ in range(_RANDOM)])
    longest = None
    if segments is not None:
        length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
        longest = deviation_of(costs.of_sets(np.argsort(-length, kind="stable")[np.newaxis, :count])[0])
    return LineSelection(
        ids=tuple(lines.ids[i] for i in best),
        deviation=deviation_of(value),
        clearance=distance,
        locus=locus,
        exact=exact,
        dropped=tuple((tuple(lines.ids[i] for i in rows), deviation_of(v), d, name) for rows, v, d, name in dropped),
        without={lines.ids[i]: deviation_of(costs.of_sets(np.array([rows]))[0]) for i, rows in without.items()},
        instead={lines.ids[i]: deviation_of(costs.of_sets(np.array(rows)).min()) for i, rows in instead.items()},
        random=deviation_of(float(np.median(costs.of_sets(random)))),
        longest=longest,
        everything=deviation_of(costs.of_sets(np.arange(n)[np.newaxis])[0]),
        clearance_asked=clearance,
    )


def _thinned(poses: Sequence[Pose]) -> tuple[Pose, ...]:
    rows = np.linspace(0, len(poses) - 1, min(len(poses), MAX_POSES)).round().astype(int)
    return tuple(poses[row] for row in rows)


def _checkpoint(folder: Path | None, search: Search, exact: bool) -> Checkpoint:
    """Return where results are kept: a file for each input."""
    lines, ends = search.lines, search.ends
    arrays = [
        lines.direction,
        lines.pivot,
        lines.position_std,
        lines.direction_std,
        np.zeros(0) if ends is None else ends,
    ]
    arrays += [part for pose in search.poses for part in (pose.rotation, pose.translation)]
    name = digest(*arrays, lines.ids, search.count, search.camera, exact)
    file = None if folder is None else folder / f"select_lines_{name}.jsonl"
    return Checkpoint(file, {"selection": name})


_Kept = tuple[list[int], float, float, str]


def _best_sets(search: Search, workers: Workers, checkpoint: Checkpoint, exact: bool, progress: _Progress) -> Sets:
    """Return the best sets, best first."""
    starts = starts_tasks(search)
    local = merged(_results(starts, workers, checkpoint, progress))
    if not exact:
        return local
    # A set that is worse than so many others is of no interest, whatever its cost is.
    bound = local[-1][1] if len(local) >= CHECKED else math.inf
    return merged([local, *_results(sets_tasks(search, bound), workers, checkpoint, progress)])


def _results(
    tasks: Sequence[StartsTask | SetsTask], workers: Workers, checkpoint: Checkpoint, progress: _Progress
) -> list[Sets]:
    named = {f"{type(task).__name__} {task.begin}": task for task in tasks}
    results = []
    for task, result in zip(tasks, checkpoint.run(workers, run_search_task, named), strict=True):
        results.append(result)
        progress(task.end, tasks[-1].end)
    return results


def _keep_clear(
    search: Search, sets: Sets, clearance: float, workers: Workers, checkpoint: Checkpoint, progress: _Progress
) -> tuple[_Kept, list[_Kept]]:
    """Return the first set that keeps the clearance, and those before it that do not."""
    tasks = {
        f"LociTask {begin}": LociTask(search, [rows for rows, _ in sets[begin : begin + _LOCI_A_TASK]])
        for begin in range(0, len(sets), _LOCI_A_TASK)
    }
    dropped: list[_Kept] = []
    for result in checkpoint.run(workers, run_search_task, tasks):
        for distance, name in result:
            rows, value = sets[len(dropped)]
            if distance >= clearance:
                return (rows, value, distance, name), dropped
            dropped.append((rows, value, distance, name))
        progress(len(dropped), len(sets))
    kept = max(dropped, key=lambda each: each[2])
    return kept, [each for each in dropped if each is not kept]


def _listed(ids: tuple[int, ...]) -> str:
    return ", ".join(map(str, ids))


def _mm(value: float) -> str:
    return "too few in view" if math.isinf(value) else f"{1000.0 * value:.3g} mm"
