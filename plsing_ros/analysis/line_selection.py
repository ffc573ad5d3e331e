# SPDX-License-Identifier: Apache-2.0
"""Which k of n candidate lines to servo on: the most exact set along a path that keeps away from singularities."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np
import numpy.typing as npt

from plsing_ros.analysis.accuracy import MIN_LINES, Camera, line_information, position_deviations
from plsing_ros.arrays import Array, BoolArray, IntArray, checked_array
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.singularities import singular_set

# Up to so many sets all are tried.
MAX_EXHAUSTIVE = 400_000
MAX_POSES = 50
_STARTS = 12
# The best sets whose loci are computed.
_CHECKED = 200
_RANDOM = 500
# Rows of each kind in a summary.
_SHOWN = 5
_BATCH = 20_000
# A pose at which a set sees too few lines is worse than any deviation.
_BLIND = 1e9


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
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> LineSelection:
    """Return the lines to servo on: the smallest of the largest position deviation over the poses.

    Up to 400,000 sets are all compared; of more, the best of an exchange of lines from twelve starts is taken. Of the
    best 200 sets the first is chosen whose singular loci, lines' tolerances included, keep the clearance from the path
    through the poses. If none does, it is the one with the largest clearance. The same input gives the same answer.

    Args:
        lines: n candidates in the world frame.
        count: How many to choose, k.
        poses: T_world_camera along a path, or spread over a workspace; of more than 50, 50 are used.
        ends: End points of the segments, shape (n, 2, 3) [m]; None: the lines have no ends.
        image_std: Standard deviation of an image line's angle [rad] and offset.
        max_angle: A line is in view within this angle of the optical axis [rad].
        clearance: Distance from the path to singular loci that is asked for [m].
        progress: Called with what is done and the total.

    Raises:
        GeometryError: If count is not between 3 and n, there is no pose, or ends has another shape.

    Source: new, docs/howto/select_lines.md.
    """
    n = len(lines)
    if not MIN_LINES <= count <= n:
        raise GeometryError(f"count is {count}; it must be between {MIN_LINES} and the number of candidates, {n}")
    segments = None if ends is None else checked_array("ends", np.reshape(ends, (-1, 2, 3)), (n, 2, 3))
    chosen_poses = _thinned(poses)
    information = line_information(lines, chosen_poses, Camera(image_std, max_angle), segments)
    costs = _Costs(information.matrices, information.visible)
    exact = math.comb(n, count) <= MAX_EXHAUSTIVE
    local = _exchange_from_starts(costs, n, count, progress)
    sets, values = _exhaustive(costs, n, count, local, progress) if exact else local
    kept, dropped = _keep_clear(lines, sets, values, chosen_poses, clearance)
    best, value, distance, locus = kept
    rest = [i for i in range(n) if i not in best]
    without = {i: [j for j in best if j != i] for i in best}
    instead = {i: [[i if j == other else j for j in best] for other in best] for i in rest}
    generator = np.random.default_rng(0)
    random = np.array([generator.permutation(n)[:count] for _ in range(_RANDOM)])
    longest = None
    if segments is not None:
        length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
        longest = _deviation(costs.of_sets(np.argsort(-length, kind="stable")[np.newaxis, :count])[0])
    return LineSelection(
        ids=tuple(lines.ids[i] for i in best),
        deviation=_deviation(value),
        clearance=distance,
        locus=locus,
        exact=exact,
        dropped=tuple((tuple(lines.ids[i] for i in rows), _deviation(v), d, name) for rows, v, d, name in dropped),
        without={lines.ids[i]: _deviation(costs.of_sets(np.array([rows]))[0]) for i, rows in without.items()},
        instead={lines.ids[i]: _deviation(costs.of_sets(np.array(rows)).min()) for i, rows in instead.items()},
        random=_deviation(float(np.median(costs.of_sets(random)))),
        longest=longest,
        everything=_deviation(costs.of_sets(np.arange(n)[np.newaxis])[0]),
        clearance_asked=clearance,
    )


def _thinned(poses: Sequence[Pose]) -> list[Pose]:
    rows = np.linspace(0, len(poses) - 1, min(len(poses), MAX_POSES)).round().astype(int)
    return [poses[row] for row in rows]


class _Costs:
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


def _deviation(cost: float) -> float:
    return math.inf if cost >= _BLIND else float(cost)


def _exchange_from_starts(
    costs: _Costs, n: int, count: int, progress: Callable[[int, int], None]
) -> tuple[IntArray, Array]:
    """Return sets that no exchange of one line improves, and all sets met on the way to them, best first."""
    generator = np.random.default_rng(0)
    starts = [_greedy(costs, n, count), *(generator.permutation(n)[:count] for _ in range(_STARTS - 1))]
    met: dict[tuple[int, ...], float] = {}
    for number, start in enumerate(starts):
        current = tuple(sorted(start.tolist()))
        cost = float(costs.of_sets(np.array([current]))[0])
        while True:
            rest = [i for i in range(n) if i not in current]
            others = [tuple(sorted((set(current) - {i}) | {j})) for i in current for j in rest]
            if not others:
                met[current] = cost
                break
            values = costs.of_sets(np.array(others))
            met.update(zip(others, values.tolist(), strict=True))
            best = int(np.argmin(values))
            if values[best] >= cost:
                met[current] = cost
                break
            current, cost = others[best], float(values[best])
        progress(number + 1, len(starts))
    ordered = sorted(met, key=lambda rows: (met[rows], rows))[:_CHECKED]
    return np.array(ordered), np.array([met[rows] for rows in ordered])


def _greedy(costs: _Costs, n: int, count: int) -> IntArray:
    """Return rows taken one by one, from the best set of three among the first ones on."""
    triples = np.array(list(islice(combinations(range(n), MIN_LINES), _BATCH)))
    rows = triples[np.argmin(costs.of_sets(triples))].tolist()
    while len(rows) < count:
        rest = [i for i in range(n) if i not in rows]
        rows.append(rest[int(np.argmin(costs.of_sets(np.array([[*rows, i] for i in rest]))))])
    return np.array(rows)


def _exhaustive(
    costs: _Costs, n: int, count: int, local: tuple[IntArray, Array], progress: Callable[[int, int], None]
) -> tuple[IntArray, Array]:
    """Return the best of all sets, best first."""
    sets, total = combinations(range(n), count), math.comb(n, count)
    best, values = local
    for begin in range(0, total, _BATCH):
        batch = np.array(list(islice(sets, _BATCH)))
        # A set that is worse than so many others is of no interest, whatever its cost is.
        bound = float(values[-1]) if len(values) >= _CHECKED else np.inf
        found = costs.of_good_sets(batch, bound)
        merged = {tuple(rows): value for rows, value in zip(best.tolist(), values.tolist(), strict=True)}
        for row in np.flatnonzero(found <= bound):
            merged[tuple(batch[row].tolist())] = float(found[row])
        ordered = sorted(merged, key=lambda rows: (merged[rows], rows))[:_CHECKED]
        best, values = np.array(ordered), np.array([merged[rows] for rows in ordered])
        progress(min(begin + _BATCH, total), total)
    return best, values


_Kept = tuple[tuple[int, ...], float, float, str]


def _keep_clear(
    lines: LineSet, sets: IntArray, values: Array, poses: Sequence[Pose], clearance: float
) -> tuple[_Kept, list[_Kept]]:
    """Return the first set that keeps the clearance, and those before it that do not."""
    centers = np.array([pose.translation for pose in poses])
    dropped: list[_Kept] = []
    for rows, value in zip(sets.tolist(), values.tolist(), strict=True):
        distance, name = _nearest(lines.select(rows), centers)
        if distance >= clearance:
            return (tuple(rows), value, distance, name), dropped
        dropped.append((tuple(rows), value, distance, name))
    kept = max(dropped, key=lambda each: each[2])
    return kept, [each for each in dropped if each is not kept]


def _nearest(lines: LineSet, centers: Array) -> tuple[float, str]:
    """Return the distance of camera centres to the nearest singular locus, and its name."""
    singular = singular_set(lines)
    if singular.singular_everywhere:
        return 0.0, "every camera centre"
    nearest = [singular.nearest_locus(center) for center in centers]
    found = [(each.distance, each.name) for each in nearest if each is not None]
    return min(found, default=(math.inf, ""))


def _listed(ids: tuple[int, ...]) -> str:
    return ", ".join(map(str, ids))


def _mm(value: float) -> str:
    return "too few in view" if math.isinf(value) else f"{1000.0 * value:.3g} mm"
