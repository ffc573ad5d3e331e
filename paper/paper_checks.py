# SPDX-License-Identifier: Apache-2.0
"""What the paper says about its servo experiments, and whether our runs agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from paper.scenes import PRINTED_L_M
from paper.tasks import (
    QUADRIFOLIA,
    QUADRIFOLIUM_GAIN,
    QUADRIFOLIUM_MIDDLES,
    STARTS_FIVE,
    STARTS_FOUR,
    TRAJECTORIES,
)
from plsing_ros.arrays import Array
from plsing_ros.simulation.near_transversal import GAIN
from plsing_ros.simulation.run_record import RunRecord

# How near a clover's centre counts as "when the camera approaches the singularity point" [m]; a leaf is 0.3 m long.
_NEAR_CENTER = 0.15


@dataclass(frozen=True)
class PaperCheck:
    """A statement of the paper against a measurement.

    Attributes:
        statement: In short words of the paper.
        criterion: What we ask for, in words with numbers.
        measured: What we find.
        holds: Whether it fulfils the criterion.
    """

    statement: str
    criterion: str
    measured: str
    holds: bool


def check_paper(records: Mapping[str, Sequence[RunRecord]]) -> dict[str, tuple[PaperCheck, ...]]:
    """Return the checks by group of runs (paper.tasks), for the groups that are there."""
    judges = {
        STARTS_FOUR: _of_starts_four,
        TRAJECTORIES: _of_trajectories,
        QUADRIFOLIA: _of_quadrifolia,
        STARTS_FIVE: _of_starts_five,
    }
    return {group: judge(records[group]) for group, judge in judges.items() if group in records}


def _of_starts_four(runs: Sequence[RunRecord]) -> tuple[PaperCheck, ...]:
    one, two, three, four = runs
    calm, longest = (one, three), float(two.distance.max())
    straightness = max(_detour_factor(run) for run in calm)
    rates = [_decay_rate(run) for run in calm]
    excursion = two.position[int(np.argmax(two.distance))] - two.position[0]
    # No excursion at all, if it is never farther away than at the start.
    along = abs(float(excursion @ np.array(PRINTED_L_M[:3]))) / max(float(np.linalg.norm(excursion)), 1e-9)
    drop = float(two.inverse_condition_number.min() / two.inverse_condition_number[0])
    speeds = float(two.linear_speed.max() / one.linear_speed.max())
    constancy = _error_ratio_while_leaving(two)
    faster = float(four.linear_speed.max() / one.linear_speed.max())
    return (
        PaperCheck(
            "Starts 1 and 3: an almost straight line to the target",
            "arrive, way at most 1.1 times the distance",
            f"way {straightness:.3f} times the distance",
            all(run.arrived for run in calm) and straightness <= 1.1,
        ),
        PaperCheck(
            "Starts 1 and 3: the error decreases exponentially",
            "decay rate within 10 % of λ = 0.1 1/s",
            f"rates {rates[0]:.4f} and {rates[1]:.4f} 1/s",
            all(abs(rate - GAIN) <= 0.1 * GAIN for rate in rates),
        ),
        PaperCheck("Start 2 reaches the target eventually", "arrives", two.ended, two.arrived),
        PaperCheck(
            "Start 2 diverges along L_M",
            "more than twice as far away as at the start, along L_M (cosine > 0.9)",
            f"{longest:.2f} m away from a start at {two.distance[0]:.2f} m, cosine {along:.3f}",
            longest > 2.0 * float(two.distance[0]) and along > 0.9,
        ),
        PaperCheck(
            "Start 2: the inverse condition number reaches almost zero",
            "below 1/20 of that at the start",
            f"{two.inverse_condition_number.min():.1e}, {drop:.1e} of that at the start",
            drop < 0.05,
        ),
        PaperCheck(
            "Start 2: velocities two orders of magnitude higher than in the stable run",
            "peak |v| at least 50 times that of Start 1",
            f"{speeds:.0f} times ({two.linear_speed.max():.3g} m/s, {one.linear_speed.max():.3g} m/s)",
            speeds >= 50.0,
        ),
        PaperCheck(
            "Start 2: while the distance grows, the error norm is about constant",
            "changes by less than a factor of 2 from the closest to the farthest point",
            f"factor {constancy:.2f}",
            constancy < 2.0,
        ),
        PaperCheck(
            "Start 4 converges, with considerably higher velocities and not monotonically",
            "arrives, peak |v| at least twice that of Start 1, distance not monotone",
            f"{four.ended}, {faster:.1f} times, {'monotone' if four.distance_is_monotone else 'not monotone'}",
            four.arrived and faster >= 2.0 and not four.distance_is_monotone,
        ),
    )


def _of_trajectories(runs: Sequence[RunRecord]) -> tuple[PaperCheck, ...]:
    through, beside = runs
    path_speed = float(np.linalg.norm(np.diff(beside.target, axis=0), axis=1).max() / (beside.time[1] - beside.time[0]))
    median, largest = float(np.median(beside.distance)), float(beside.distance.max())
    s_of_peak = 0.04 * through.time_of_peak - 1.0
    ratio = float(through.linear_speed.max() / beside.linear_speed.max())
    error = float(through.distance.max())
    return (
        PaperCheck(
            "Trajectory 2: a small, about constant tracking error of about 0.1 m",
            "median 0.03 to 0.2 m, largest below 0.3 m",
            f"median {median:.3f} m, largest {largest:.3f} m",
            0.03 <= median <= 0.2 and largest < 0.3,
        ),
        PaperCheck(
            "Trajectory 2: mild velocities",
            "peak |v| at most 3 times the path's own speed",
            f"{beside.linear_speed.max():.3f} m/s, {beside.linear_speed.max() / path_speed:.1f} times",
            float(beside.linear_speed.max()) <= 3.0 * path_speed,
        ),
        PaperCheck(
            "Trajectory 1: the translation error becomes as high as 1 m",
            "largest error 1 m within a factor of 4",
            f"{error:.2f} m",
            0.25 <= error <= 4.0,
        ),
        PaperCheck(
            "Trajectory 1: around s = 0 the velocities become very high",
            "peak |v| at least 10 times that of Trajectory 2, at |s| < 0.25",
            f"{ratio:.0f} times ({through.linear_speed.max():.3g} m/s), at s = {s_of_peak:.2f}",
            ratio >= 10.0 and abs(s_of_peak) < 0.25,
        ),
    )


def _of_quadrifolia(runs: Sequence[RunRecord]) -> tuple[PaperCheck, ...]:
    zero, one, *_ = runs
    path_speed = float(np.linalg.norm(np.diff(zero.target, axis=0), axis=1).max() / (zero.time[1] - zero.time[0]))
    delay = path_speed / QUADRIFOLIUM_GAIN
    medians = [float(np.median(run.distance)) for run in runs]
    largest = [float(run.distance.max()) for run in runs]
    where = [
        _target_when_error_arises(run, middle, 1.2 * largest[0])
        for run, middle in zip(runs[1:], QUADRIFOLIUM_MIDDLES[1:], strict=True)
    ]
    worst = 1 + int(np.argmax(largest[1:]))
    return (
        PaperCheck(
            "Ex. 0: an oscillating error from the delay only",
            "largest error at most 1.5 times the path's speed over λ",
            f"{largest[0]:.4f} m, {largest[0] / delay:.2f} times",
            largest[0] <= 1.5 * delay,
        ),
        PaperCheck(
            "Ex. 1: a significantly larger deviation than in Ex. 0",
            "largest error at least 1.5 times that of Ex. 0",
            f"{largest[1]:.4f} m, {largest[1] / largest[0]:.1f} times",
            largest[1] >= 1.5 * largest[0],
        ),
        PaperCheck(
            "Ex. 1: destabilising velocities at the centre",
            "peak |v| at least 3 times that of Ex. 0",
            f"{one.linear_speed.max():.3g} m/s, {one.linear_speed.max() / zero.linear_speed.max():.1f} times",
            float(one.linear_speed.max()) >= 3.0 * float(zero.linear_speed.max()),
        ),
        *(
            PaperCheck(
                f"{which}: the largest errors occur when the camera approaches the singular point",
                f"the wanted position is within {_NEAR_CENTER:g} m of it when the error first passes 1.2 times the "
                "largest of Ex. 0",
                ", ".join(f"{value:.3f}" for value in distances) + " m",
                max(distances) <= _NEAR_CENTER,
            )
            for which, distances in (("Ex. 1 to 5", where[:5]), ("Ex. 6", where[5:]))
        ),
        PaperCheck(
            "Ex. 1 to 6: most of the trajectory is followed with relative accuracy",
            "medians at most 1.5 times that of Ex. 0",
            f"{min(medians[1:]):.4f} to {max(medians[1:]):.4f} m, Ex. 0 {medians[0]:.4f} m",
            max(medians[1:]) <= 1.5 * medians[0],
        ),
        PaperCheck(
            "Ex. 2: a particularly large error",
            "the largest of all",
            f"Ex. 2 {_length(largest[2])}, the largest is Ex. {worst} with {_length(largest[worst])}",
            worst == 2,
        ),
    )


def _of_starts_five(runs: Sequence[RunRecord]) -> tuple[PaperCheck, ...]:
    one, two, three, four = runs
    rates = [_decay_rate(run) for run in runs]
    calm = (one, three)
    speeds = float(two.linear_speed.max() / one.linear_speed.max())
    drop = float(two.inverse_condition_number.min() / two.inverse_condition_number[0])
    factors = (_detour_factor(two), _detour_factor(four))
    return (
        PaperCheck(
            "In all four the error decreases exponentially",
            "decay rates within 20 % of λ = 0.1 1/s down to 1 % of the error",
            ", ".join(f"{rate:.3f}" for rate in rates) + " 1/s",
            all(abs(rate - GAIN) <= 0.2 * GAIN for rate in rates),
        ),
        PaperCheck(
            "Starts 1 and 3 converge, with small velocities and displacements",
            "end within 0.05 m, never farther than at the start, peak |v| below 0.15 m/s",
            ", ".join(f"{run.distance[-1]:.4f} m, {run.linear_speed.max():.3f} m/s" for run in calm),
            all(
                run.distance[-1] < 0.05
                and run.distance.max() <= 1.02 * run.distance[0]
                and run.linear_speed.max() < 0.15
                for run in calm
            ),
        ),
        PaperCheck(
            "Start 2: unstable motion and a large deviation",
            "way at least 2 times the distance",
            f"way {factors[0]:.1f} times the distance, up to {two.distance.max():.2f} m away",
            factors[0] >= 2.0,
        ),
        PaperCheck(
            "Start 4: unstable motion and a large deviation",
            "way at least 2 times the distance",
            f"way {factors[1]:.1f} times the distance, up to {four.distance.max():.2f} m away",
            factors[1] >= 2.0,
        ),
        PaperCheck(
            "Start 2: very high velocities as the inverse condition number drops near zero",
            "peak |v| at least 10 times that of Start 1, inverse condition number below 1/5 of that at the start",
            f"{speeds:.0f} times, {two.inverse_condition_number.min():.1e}, {drop:.2g} of that at the start",
            speeds >= 10.0 and drop < 0.2,
        ),
    )


def _detour_factor(run: RunRecord) -> float:
    """Return the length of the path over the distance between its ends at start and target."""
    return float(np.linalg.norm(np.diff(run.position, axis=0), axis=1).sum() / run.distance[0])


def _decay_rate(run: RunRecord) -> float:
    """Return the rate at which |s - s*| decays, from the start until 1 % of it is left [1/s]."""
    small = np.flatnonzero(run.error_norm < 0.01 * run.error_norm[0])
    until = int(small[0]) if len(small) else len(run.time)
    if until < 3 or (run.error_norm[:until] <= 0.0).any():
        return 0.0
    return -float(np.polyfit(run.time[:until], np.log(run.error_norm[:until]), 1)[0])


def _error_ratio_while_leaving(run: RunRecord) -> float:
    """Return the largest over the smallest |s - s*| between the closest point before the farthest one, and that."""
    farthest = int(np.argmax(run.distance))
    closest = int(np.argmin(run.distance[: farthest + 1]))
    errors: Array = run.error_norm[closest : farthest + 1]
    return float(errors.max() / max(float(errors.min()), 1e-300))


def _target_when_error_arises(run: RunRecord, middle: Sequence[float], ordinary: float) -> float:
    """Return how far the wanted position is from a clover's centre when the error first passes `ordinary` [m]."""
    beyond = np.flatnonzero(run.distance > ordinary)
    first = int(beyond[0]) if len(beyond) else int(np.argmax(run.distance))
    return float(np.linalg.norm(run.target[first] - np.array(middle)))


def _length(value: float) -> str:
    return f"{value:.3g} m" if value < 100.0 else f"over {100.0:g} m"
