# SPDX-License-Identifier: Apache-2.0
"""select_lines on random rooms: against brute force over all sets, exchange against exact, and what it gains.

40 edges of a room (walls, doors, shelves, half of them along the room's axes), known to 1 mm and 1 mrad, 4 of them to
be chosen for 50 poses on a path of 3 m, a view of 60 degrees, image lines to 1e-3. Brute force inverts the information
of every set at every pose as a whole.

    python3 -m benchmark line_selection
    python3 -m benchmark line_selection --quick
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import combinations

import numpy as np

import plsing_ros as pl
from plsing_ros.analysis import line_selection
from plsing_ros.analysis.accuracy import Camera, line_information

SCENES, QUICK = 10, 2
_NOISE, _VIEW = 1e-3, np.pi / 6
# For the exchange: so many lines of so many, where all sets can be compared.
_EXCHANGE = ((18, 5), (24, 4), (16, 7))


def main(quick: bool = False) -> None:
    """Measure and print."""
    print("40 choose 4, 50 poses                                        these lines / random / longest / all [mm]")
    for seed in range(QUICK if quick else SCENES):
        print(f"  room {seed}: {_against_brute_force(seed)}", flush=True)
    for n, k in _EXCHANGE:
        ratios = [_exchange_ratio(seed, n, k) for seed in range(QUICK if quick else SCENES)]
        print(f"{n} choose {k}: exchange over exact {np.median(ratios):.4f} (median), {max(ratios):.4f} (worst)")


def room(seed: int, n: int) -> tuple[pl.LineSet, np.ndarray, list[pl.Pose]]:
    """Return lines, their ends (n, 2, 3) [m] and 50 poses on a path."""
    generator = np.random.default_rng([seed, n])
    middle = generator.uniform((-3.0, 1.5, -1.5), (3.0, 4.0, 1.5), (n, 3))
    direction = generator.normal(size=(n, 3))
    along = generator.random(n) < 0.5
    direction[along] = np.eye(3)[generator.integers(3, size=along.sum())]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    half = 0.5 * np.exp(generator.uniform(np.log(0.3), np.log(3.0), (n, 1))) * direction
    ends = np.stack([middle - half, middle + half], axis=1)
    lines = pl.LineSet.from_points_directions(middle, direction, position_std=1e-3, direction_std=1e-3)
    start, stop = generator.uniform((-1.5, -3.5, -0.5), (1.5, -2.0, 0.5), (2, 3))
    stop = start + 3.0 * (stop - start) / np.linalg.norm(stop - start)
    path = [pl.Pose.look_at(start + share * (stop - start), (0.0, 3.0, 0.0)) for share in np.linspace(0.0, 1.0, 50)]
    return lines, ends, path


def _against_brute_force(seed: int) -> str:
    lines, ends, path = room(seed, 40)
    begin = time.perf_counter()
    chosen = pl.select_lines(lines, 4, path, ends=ends, image_std=_NOISE, max_angle=_VIEW, clearance=0.0, processes=2)
    seconds = time.perf_counter() - begin
    best, value = min(_brute_force(lines, ends, path), key=lambda each: each[1])
    same = chosen.ids == tuple(lines.ids[i] for i in best)
    alike = abs(chosen.deviation / value - 1.0) if np.isfinite(value) else 0.0
    near = pl.select_lines(lines, 4, path, ends=ends, image_std=_NOISE, max_angle=_VIEW, clearance=0.1, processes=2)
    return (
        f"{seconds:5.1f} s, {'the set of brute force' if same else 'ANOTHER SET'}, values apart by {alike:.0e}; "
        f"{' / '.join(f'{1e3 * each:.2f}' for _, each in chosen.table())}; with 0.1 m of clearance "
        f"{1e3 * near.deviation:.2f}, {len(near.dropped)} sets dropped"
    )


def _brute_force(lines: pl.LineSet, ends: np.ndarray, path: list[pl.Pose]) -> Iterator[tuple[tuple[int, ...], float]]:
    information = line_information(lines, path, Camera(_NOISE, _VIEW), ends)
    sets = np.array(list(combinations(range(len(lines)), 4)))
    worst = np.zeros(len(sets))
    for matrices, visible in zip(information.matrices, information.visible, strict=True):
        total = matrices[sets].sum(axis=1)
        seen = visible[sets].sum(axis=1) >= 3
        size = np.trace(total, axis1=1, axis2=2)[:, np.newaxis, np.newaxis] + 1e-300
        covariance = np.linalg.inv(
            np.where(seen[:, np.newaxis, np.newaxis], total + 1e-15 * size * np.eye(6), np.eye(6))
        )
        deviation = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance[:, :3, :3])[:, -1], 0.0))
        worst = np.maximum(worst, np.where(seen, deviation, np.inf))
    yield from zip(map(tuple, sets.tolist()), worst.tolist(), strict=True)


def _exchange_ratio(seed: int, n: int, k: int) -> float:
    lines, ends, path = room(seed, n)
    most = line_selection.MAX_EXHAUSTIVE
    values = []
    for line_selection.MAX_EXHAUSTIVE in (most, 0):
        values.append(pl.select_lines(lines, k, path, image_std=_NOISE, max_angle=np.pi / 2, clearance=0.0).deviation)
    line_selection.MAX_EXHAUSTIVE = most
    return values[1] / values[0]
