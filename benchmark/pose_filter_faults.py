# SPDX-License-Identifier: Apache-2.0
"""What the pose filter says when its input is wrong."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchmark.camera_sequences import (
    NOISE,
    RATE,
    STARTS,
    Sequence,
    error_of,
    motion,
    noisy_image,
    off_start,
    sequences,
    size_of,
    squared,
)
from benchmark.kept_results import kept_results, parts
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.parameters import FilterParameters
from plsing_ros.pose import PoseEstimate, PoseFilter, Verdict

# A pose further off than this, in standard deviations, is wrong and must have been called LOST.
_WRONG = 5.0


@dataclass
class Tally:
    """What became of runs with a disturbance.

    Attributes:
        frames: With a pose.
        wrong: Of those, further off than _WRONG standard deviations of the pose.
        lost_runs: Runs in which LOST was said.
        wrong_runs: Runs in which a pose was wrong without LOST.
        runs: All runs.
        recovery: How long it took to have a pose again after good input returned, where it was lost then [s].
        unrecovered: Runs that ended LOST though single images determine the pose.
    """

    frames: int = 0
    wrong: int = 0
    lost_runs: int = 0
    wrong_runs: int = 0
    runs: int = 0
    recovery: list[float] = dataclasses.field(default_factory=list)
    unrecovered: int = 0

    def add(self, other: Tally) -> None:
        """Take the runs of another one in."""
        for field in dataclasses.fields(self):
            setattr(self, field.name, getattr(self, field.name) + getattr(other, field.name))


def tallied(task: tuple[str, int, range]) -> Tally:
    """Return what became of sequences with a disturbance of CASES, by name, seed and numbers."""
    name, seed, numbers = task
    tally = Tally()
    for seen, generator in sequences(seed, numbers):
        if name.startswith("teleported"):
            changed, returned = _teleported(seen, generator)
        else:
            changed, returned = CASES[name](seen, generator), None
        _tally(changed, generator, tally, 3 if "latency" in name else 0, returned)
    return tally


def disturbances(seed: int, runs: int) -> Iterator[str]:
    """Yield the table of what the filter says under wrong input, from a start known to 1 cm."""
    yield f"disturbances, {runs} sequences each; wrong: further off than {_WRONG:g} standard deviations (median / max)"
    tasks = [(name, seed + 1000, numbers) for name in CASES for numbers in parts(runs)]
    tallies = {name: Tally() for name in CASES}
    for (name, *_), tally in zip(tasks, kept_results(tallied, tasks), strict=True):
        tallies[name].add(tally)
    for name, tally in tallies.items():
        recovery = "-" if not tally.recovery else f"{np.median(tally.recovery):.2f} / {max(tally.recovery):.2f} s"
        yield (
            f"  {name:32s} wrong poses {tally.wrong:4d} of {tally.frames} ({tally.wrong / max(1, tally.frames):.2%}); "
            f"runs with one {tally.wrong_runs}, with LOST {tally.lost_runs}; found again after {recovery}; "
            f"LOST at the end {tally.unrecovered}"
        )


def _tally(seen: Sequence, generator: np.random.Generator, tally: Tally, latency: int, returned: int | None) -> None:
    start = off_start(seen.poses[0], STARTS["known to 1 cm, 0.2 deg"], generator)
    pose_filter = PoseFilter(seen.lines, FilterParameters(noise_image=NOISE), start=start[0], start_covariance=start[1])
    lost = wrong = False
    since: int | None = None
    verdict = Verdict.OK
    for k in range(len(seen.poses)):
        if k > 0:
            pose_filter.predict(seen.twists[k - 1], 1.0 / RATE)
        frame = k - latency
        if frame < 0 or not seen.images[frame].usable.any():
            continue
        estimate = pose_filter.update(seen.images[frame], frame / RATE)
        verdict = estimate.verdict
        if estimate.pose is None:
            lost, since = True, since if since is not None else k
            continue
        if since is not None:
            if returned is None or k >= returned:
                tally.recovery.append((k - max(since, returned or since)) / RATE)
            since = None
        off = _deviations(error_of(seen.poses[frame], estimate.pose), estimate)
        tally.frames += 1
        tally.wrong += off > _WRONG
        wrong |= off > _WRONG
    tally.runs += 1
    tally.lost_runs += lost
    tally.wrong_runs += wrong
    tally.unrecovered += verdict is Verdict.LOST


def _deviations(error: np.ndarray, estimate: PoseEstimate) -> float:
    """Return how many standard deviations the position, or the orientation, is off in its direction."""
    _, position, orientation = squared(error, estimate.covariance)
    return float(np.sqrt(max(position, orientation)))


def _true_twists(seen: Sequence) -> list[np.ndarray]:
    return [motion(*pair) * RATE for pair in pairwise(seen.poses)]


def _scaled(seen: Sequence, generator: np.random.Generator, share: float) -> Sequence:
    factor = 1.0 + share * generator.choice([-1.0, 1.0])
    return dataclasses.replace(seen, twists=[factor * each for each in _true_twists(seen)])


def _with_wrong_lines(seen: Sequence, generator: np.random.Generator, share: float) -> Sequence:
    """Return a sequence in which a share of all lines is anywhere, swapped with the next one, or reversed."""
    images = []
    for image in seen.images:
        rows = image.image_lines.copy()
        for i in np.flatnonzero(generator.uniform(size=len(rows)) < share):
            kind = generator.integers(3)
            if kind == 0:
                angle = generator.uniform(-np.pi, np.pi)
                rows[i] = np.cos(angle), np.sin(angle), generator.normal()
            elif kind == 1:
                rows[i] = image.image_lines[(i + 1) % len(rows)]
            else:
                rows[i] = -image.image_lines[i]
        images.append(LineObservation(image.ids, rows, image.usable, None))
    return dataclasses.replace(seen, images=images)


def _without(image: LineObservation) -> LineObservation:
    return LineObservation(image.ids, image.image_lines, np.zeros(len(image.ids), dtype=bool), None)


def _dropped(seen: Sequence, generator: np.random.Generator, share: float) -> Sequence:
    gone = generator.uniform(size=len(seen.images)) < share
    images = [_without(image) if drop else image for image, drop in zip(seen.images, gone, strict=True)]
    return dataclasses.replace(seen, images=images)


def _blind(seen: Sequence) -> Sequence:
    first = len(seen.images) // 3
    images = [_without(image) if first <= k < first + 2 * RATE else image for k, image in enumerate(seen.images)]
    return dataclasses.replace(seen, images=images)


def _teleported(seen: Sequence, generator: np.random.Generator) -> tuple[Sequence, int]:
    """Return a sequence whose camera is suddenly elsewhere, unknown to its twists, and from which frame on."""
    first = len(seen.poses) // 3
    shift = generator.normal(size=3)
    shift *= 0.5 / np.linalg.norm(shift)
    poses = [Pose(pose.rotation, pose.translation + shift) if k >= first else pose for k, pose in enumerate(seen.poses)]
    images = [*seen.images[:first], *(noisy_image(seen.lines, pose, generator) for pose in poses[first:])]
    return dataclasses.replace(seen, poses=poses, images=images), first


CASES: dict[str, Callable[[Sequence, np.random.Generator], Sequence]] = {
    "none": lambda seen, generator: seen,
    "20 % wrong lines": lambda seen, generator: _with_wrong_lines(seen, generator, 0.2),
    **{
        f"twist {share:.0%} too fast or slow": lambda seen, generator, share=share: _scaled(seen, generator, share)
        for share in (0.05, 0.2, 0.5)
    },
    **{
        f"twist {share:.0%} wrong in each frame": lambda seen, generator, share=share: dataclasses.replace(
            seen, twists=[each + share * size_of(each) * generator.normal(size=6) for each in _true_twists(seen)]
        )
        for share in (0.2, 0.5)
    },
    "10 % dropped frames": lambda seen, generator: _dropped(seen, generator, 0.1),
    "3 frames of latency": lambda seen, generator: seen,
    "teleported by 0.5 m": lambda seen, generator: seen,
    "2 s without features": lambda seen, generator: _blind(seen),
}
