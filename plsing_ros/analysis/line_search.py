# SPDX-License-Identifier: Apache-2.0
"""The search for the best sets of lines, in tasks that can be done anywhere: exchange from starts, all sets, loci."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, islice

import numpy as np

from plsing_ros.analysis.accuracy import MIN_LINES, Camera, line_information, position_deviations
from plsing_ros.arrays import Array, BoolArray, IntArray
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.singularities import singular_set

# The best sets whose loci are computed.
CHECKED = 200
STARTS = 12
_BATCH = 20_000
# A pose at which a set sees too few lines is worse than any deviation.
_BLIND = 1e9
# z below which the lines' tolerances leave it open whether a camera is singular.
_MAY_BE_SINGULAR = 3.0

Sets = list[tuple[list[int], float]]  # rows of the lines and their cost, best first


@dataclass(frozen=True, eq=False)
class Search:
    """What to choose from and for.

    Attributes:
        lines: n candidates in the world frame.
        count: How many to choose, k.
        poses: T_world_camera of each.
        camera: Noise and field of view.
        ends: Of the segments, shape (n, 2, 3) [m], or None.
    """

    lines: LineSet
    count: int
    poses: tuple[Pose, ...]
    camera: Camera
    ends: Array | None

    @cached_property
    def costs(self) -> SetCosts:
        """What sets are worth."""
        found = line_information(self.lines, self.poses, self.camera, self.ends)
        return SetCosts(found.matrices, found.visible)

    def __getstate__(self) -> dict[str, object]:
        # What can be computed again is not sent along.
        return {name: value for name, value in self.__dict__.items() if name != "costs"}


@dataclass(frozen=True, eq=False)
class StartsTask:
    """Exchange from starts begin to end."""

    search: Search
    begin: int
    end: int

    def run(self) -> Sets:
        """Return the best sets met, those that no exchange of one line improves among them."""
        search = self.search
        met: dict[tuple[int, ...], float] = {}
        for start in _starts(search)[self.begin : self.end]:
            _exchange(search, start, met)
        return _best(met)


@dataclass(frozen=True, eq=False)
class SetsTask:
    """Sets begin to end of all, in the order of itertools.combinations."""

    search: Search
    begin: int
    end: int
    bound: float

    def run(self) -> Sets:
        """Return the best of those whose cost is within the bound."""
        search = self.search
        sets = np.array(list(islice(combinations(range(len(search.lines)), search.count), self.begin, self.end)))
        found = search.costs.of_good_sets(sets, self.bound)
        return _best({tuple(sets[row].tolist()): float(found[row]) for row in np.flatnonzero(found <= self.bound)})


@dataclass(frozen=True, eq=False)
class LociTask:
    """Sets whose loci are to be computed, as rows of the lines."""

    search: Search
    sets: list[list[int]]

    def run(self) -> list[tuple[float, str]]:
        """Return how near the poses come to a singular or near-singular locus of each set [m], and its name."""
        return [nearest_locus_of_poses(self.search.lines.select(rows), self.search.poses) for rows in self.sets]


def run_search_task(task: StartsTask | SetsTask | LociTask) -> list[list[object]]:
    """Do a task; the result is as JSON keeps it."""
    return [list(each) for each in task.run()]


def starts_tasks(search: Search) -> list[StartsTask]:
    """Return the starts in tasks of about a second or more, all in one if they take less."""
    each = search.count * (len(search.lines) - search.count) * len(search.poses)
    size = min(max(200_000 // max(each, 1), 1), STARTS)
    return [StartsTask(search, begin, min(begin + size, STARTS)) for begin in range(0, STARTS, size)]


def sets_tasks(search: Search, bound: float) -> list[SetsTask]:
    """Return all sets in tasks of about a second."""
    total = math.comb(len(search.lines), search.count)
    return [SetsTask(search, begin, min(begin + _BATCH, total), bound) for begin in range(0, total, _BATCH)]


def merged(results: list[Sets]) -> Sets:
    """Return the best sets of several results."""
    return _best({tuple(rows): value for result in results for rows, value in result})


def nearest_locus_of_poses(lines: LineSet, poses: tuple[Pose, ...]) -> tuple[float, str]:
    """Return how near camera poses come to a locus that is singular as far as is known of the lines [m], and its name.

    That is every one of SingularSet.loci, with the tolerances of the lines. Where no locus is known, but a camera may
    be singular by z, the distance is 0.

    Returns:
        Infinite with "" if there is none.
    """
    singular = singular_set(lines)
    if singular.singular_everywhere:
        return 0.0, "every camera centre"
    if not lines.exact:
        z = min(singular.proximity(pose).z or 0.0 for pose in poses)
        if z < _MAY_BE_SINGULAR:
            return 0.0, f"a centre that may be singular as far as the lines are known (z = {z:.2g})"
    found = [(locus.distance(pose), locus.name) for locus in singular.loci for pose in poses]
    return min(found, default=(math.inf, ""))


class SetCosts:
    """What sets of lines are worth: the largest deviation over the poses, plus a fine for each pose that is blind."""

    def __init__(self, matrices: Array, visible: BoolArray) -> None:
        self._matrices, self._visible = matrices, visible

    def of_sets(self, sets: IntArray) -> Array:
        """Return the cost of sets of rows, shape (m, k), as (m,)."""
        return self.of_good_sets(sets, np.inf)

    def of_good_sets(self, sets: IntArray, bound: float) -> Array:
        """Return the cost of sets; one that is above a bound may be given by any number above it."""
        worst, blind = np.zeros(len(sets)), np.zeros(len(sets))
        open_ = np.arange(len(sets))
        for pose in range(len(self._matrices)):
            matrices, visible = self._matrices[pose], self._visible[pose]
            for begin in range(0, len(open_), _BATCH):
                rows = open_[begin : begin + _BATCH]
                of_rows = sets[rows]
                information = matrices[of_rows[:, 0]].copy()
                for column in range(1, sets.shape[1]):
                    information += matrices[of_rows[:, column]]
                deviation = position_deviations(information, visible[of_rows].sum(axis=1))
                unseen = ~np.isfinite(deviation)
                blind[rows] += unseen
                worst[rows] = np.maximum(worst[rows], np.where(unseen, 0.0, deviation))
            if bound < np.inf:
                open_ = open_[worst[open_] + _BLIND * blind[open_] <= bound]
        cost: Array = worst + _BLIND * blind
        return cost


def deviation_of(cost: float) -> float:
    return math.inf if cost >= _BLIND else float(cost)


def _best(values: dict[tuple[int, ...], float]) -> Sets:
    ordered = sorted(values, key=lambda rows: (values[rows], rows))[:CHECKED]
    return [(list(rows), values[rows]) for rows in ordered]


def _starts(search: Search) -> list[IntArray]:
    generator, n = np.random.default_rng(0), len(search.lines)
    return [_greedy(search), *(generator.permutation(n)[: search.count] for _ in range(STARTS - 1))]


def _exchange(search: Search, start: IntArray, met: dict[tuple[int, ...], float]) -> None:
    """Exchange one line after the other as long as that makes a set better; note all sets met."""
    costs = search.costs
    current = tuple(sorted(start.tolist()))
    cost = met[current] = float(costs.of_sets(np.array([current]))[0])
    while True:
        rest = [i for i in range(len(search.lines)) if i not in current]
        others = [tuple(sorted((set(current) - {i}) | {j})) for i in current for j in rest]
        if not others:
            return
        values = costs.of_sets(np.array(others))
        met.update(zip(others, values.tolist(), strict=True))
        best = int(np.argmin(values))
        if values[best] >= cost:
            return
        current, cost = others[best], float(values[best])


def _greedy(search: Search) -> IntArray:
    """Return rows taken one by one, from the best set of three among the first ones on."""
    costs, n = search.costs, len(search.lines)
    triples = np.array(list(islice(combinations(range(n), MIN_LINES), _BATCH)))
    rows = triples[np.argmin(costs.of_sets(triples))].tolist()
    while len(rows) < search.count:
        rest = [i for i in range(n) if i not in rows]
        rows.append(rest[int(np.argmin(costs.of_sets(np.array([[*rows, i] for i in rest]))))])
    return np.array(rows)
