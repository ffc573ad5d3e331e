# SPDX-License-Identifier: Apache-2.0
"""Man-made scenes: nothing singular is missed or invented, exact, rounded or measured, and what it takes.

Every kind of benchmark/structured_scenes.py is drawn several times, turned and shifted at random, and compared with a
search of the smallest singular value from random starts that shares nothing with the package.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from benchmark.singular_search import singular_centers
from benchmark.structured_scenes import KINDS, Scene, box_subset_scenes, measured, posed, rounded
from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.levels import Level
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.singularities import IsolatedStatus, Kind, SingularSet, singular_set
from plsing_ros.singularities.scene_frame import SceneFrame

# A centre found by the search lies on a locus within this share of its distance, and a reported point is singular up to
# this residual.
_FOUND, _SINGULAR = 3e-5, 1e-9
# Degrees for each millimetre.
_DEGREES = 0.1
_SIZES = (1e-4, 1e-3, 5e-3)


def main(quick: bool = False) -> None:
    """Measure and print; quickly a third of the scenes, from a fifth of the starts."""
    run(rounds=1 if quick else 3, starts=20 if quick else 100, every=12 if quick else 1)


def run(rounds: int, starts: int, every: int) -> None:
    """Print what is found of how many draws of each kind, from how many starts, and of every so many boxes."""
    counts = [len(kind(np.random.default_rng(0))[0]) for kind in KINDS.values()]
    print(f"{len(KINDS)} kinds of scenes, {min(counts)} to {max(counts)} lines, {rounds} draws of each")
    _exact("kinds", list(_draws(rounds, 1)), starts)
    for count in (4, 5, 6):
        boxes = box_subset_scenes(count)[::every]
        _exact(f"sets of {count} edges of a box", [(str(i), scene) for i, scene in enumerate(boxes)], starts)
    _rounded(rounds)
    _measured(rounds)
    _healthy()


def _draws(rounds: int, seed: int) -> Iterator[tuple[str, Scene]]:
    generator = np.random.default_rng(seed)
    for _ in range(rounds):
        for name, kind in KINDS.items():
            yield name, posed(kind(generator), generator)


def _lines(scene: Scene, position_std: float = 0.0, direction_std: float = 0.0) -> LineSet:
    return LineSet.from_points_directions(*scene, position_std=position_std, direction_std=direction_std)


def _timed(call: Callable[[], SingularSet]) -> tuple[SingularSet, float]:
    start = time.process_time()
    singular = call()
    return singular, 1e3 * (time.process_time() - start)


def _times(milliseconds: list[float]) -> str:
    median, slow, slowest = np.percentile(milliseconds, [50, 95, 99])
    return (
        f"singular_set took {median:.1f} ms of processor time (median), {slow:.0f} ms (95 %), {slowest:.0f} ms (99 %)"
    )


def _exact(what: str, scenes: list[tuple[str, Scene]], starts: int) -> None:
    generator = np.random.default_rng(2)
    centers = missed = 0
    loci, wrong, spent = 0, 0, []
    incomplete: list[str] = []
    open_kinds: Counter[str] = Counter()
    for name, scene in scenes:
        lines = _lines(scene)
        singular, milliseconds = _timed(lambda lines=lines: singular_set(lines))
        spent.append(milliseconds)
        if singular.isolated_status is IsolatedStatus.UNRESOLVED:
            open_kinds[name] += 1
        if singular.singular_everywhere:
            continue
        for locus in singular.loci:
            loci += 1
            wrong += locus.residual > _SINGULAR
        frame = SceneFrame.of(lines)
        found = frame.from_scene(singular_centers(frame.direction, frame.point, starts, generator))
        # The search ends within some 1e-5 of a double point or far away.
        far = 1.0 + np.linalg.norm(found - frame.center, axis=1) / frame.length
        off = [
            _distance(singular, center, exactly=True) / frame.length > _FOUND * size
            for center, size in zip(found, far, strict=True)
        ]
        centers += len(found)
        missed += sum(off)
        if any(off):
            incomplete.append(name)
    print(f"\nexact, {len(scenes)} {what}: {centers} singular centres found by search, {missed} on no reported locus")
    if incomplete:
        print(f"  in {len(incomplete)} scenes: {', '.join(sorted(set(incomplete)))}")
    print(f"  {loci} loci reported, {wrong} of them not singular; UNRESOLVED: {dict(open_kinds) or 'none'}")
    print(f"  {_times(spent)}")


def _distance(singular: SingularSet, center: Array, exactly: bool = False) -> float:
    distances = []
    for locus in singular.loci:
        closest = center
        # The first-order step of curved surfaces, repeated.
        for _ in range(4 if exactly and locus.kind in (Kind.QUADRIC, Kind.CUBIC) else 1):
            closest = locus.closest_point(closest)
        distances.append(float(np.linalg.norm(closest - center)))
    return min(distances, default=np.inf)


def _signature(singular: SingularSet) -> tuple[str, ...]:
    return tuple(locus.name for locus in singular.loci)


def _rounded(rounds: int) -> None:
    print("\nrounded scenes, tolerances set to the rounding step")
    for what, digits in (("float32", None), ("6 decimals", 6), ("4 decimals", 4)):
        lost = total = same = scenes = 0
        spent = []
        for _, scene in _draws(rounds, 3):
            exact = singular_set(_lines(scene))
            coarse, step = rounded(scene, digits)
            singular, milliseconds = _timed(lambda s=coarse, t=step: singular_set(_lines(s, t, t)))
            spent.append(milliseconds)
            here = Counter(locus.kind for locus in singular.loci)
            missing = Counter(locus.kind for locus in exact.loci) - here
            lost, total = lost + sum(missing.values()), total + len(exact.loci)
            same, scenes = same + (_signature(exact) == _signature(singular)), scenes + 1
        print(f"  {what:11s} {lost} of {total} loci lost, the same names in {same} of {scenes} scenes; {_times(spent)}")


def _measured(rounds: int) -> None:
    print(f"\nmeasured scenes, true tolerances, {_DEGREES} degrees for each mm; cameras on the ideal loci and away")
    for size in _SIZES:
        generator = np.random.default_rng(4)
        turn = float(np.deg2rad(_DEGREES * size / 1e-3))
        within, low, apart, same, spent = [], [], [], [], []
        for _, scene in _draws(rounds, 5):
            exact = singular_set(_lines(scene))
            draws = []
            for _ in range(2):
                coarse = measured(scene, size, turn, generator)
                singular, milliseconds = _timed(lambda s=coarse, a=size, b=turn: singular_set(_lines(s, a, b)))
                draws.append(singular)
                spent.append(milliseconds)
            same.append(_signature(draws[0]) == _signature(draws[1]))
            if exact.singular_everywhere:
                continue
            for locus in exact.loci:
                # A point is one camera, however often it is sampled.
                places = np.unique(locus.samples, axis=0)
                for center in places[generator.permutation(len(places))[:4]]:
                    within.append(any(each.distance(center) <= 3.0 * each.half_width for each in draws[0].loci))
                    low.append((draws[0].proximity(center).z or 0.0) < 3.0)
            for center in exact.frame.center + exact.frame.length * 2.0 * generator.normal(size=(20, 3)):
                if all(each.distance(center) >= 10.0 * each.half_width for each in exact.loci):
                    apart.append(not any(each.distance(center) <= each.half_width for each in draws[0].loci))
        print(
            f"  {1e3 * size:3.1f} mm: on a locus, within 3 half widths of a reported one {np.mean(within):.1%}, "
            f"z below 3 in {np.mean(low):.1%} (of {len(within)})"
        )
        print(
            f"          10 half widths away, not near {np.mean(apart):.1%} (of {len(apart)}); "
            f"the same names in two draws {np.mean(same):.1%} (of {len(same)})"
        )
        print(f"          {_times(spent)}")


def _healthy() -> None:
    """Boxes and stairs looked at from anywhere: how often the monitor alerts, and what z says."""
    generator = np.random.default_rng(6)
    below, box_levels, stair_levels, said = [], [], [], []
    for _ in range(20):
        scene = posed(KINDS["box, nine visible edges"](generator), generator)
        monitor = SingularityMonitor(_lines(measured(scene, 1e-3, 1.7e-3, generator), 1e-3, 1.7e-3))
        singular = monitor.singular_set
        for pose in _views(singular, generator, 50):
            if all(locus.distance(pose) >= 10.0 * locus.half_width for locus in singular.loci):
                below.append((singular.proximity(pose).z or 0.0) < 3.0)
                box_levels.append(monitor.assess_pose(pose).level)
        points, directions = KINDS["stairs, five nosings and two sides"](generator)
        nosings = posed((points[:5], directions[:5]), generator)
        # Off parallel by their tolerances, and by one and a half milliradians more than these.
        for extra in (0.0, 1.5e-3):
            lines = _lines(measured(nosings, 1e-3, 1e-3 + extra, generator), 1e-3, 1e-3)
            monitor = SingularityMonitor(lines)
            for pose in _views(monitor.singular_set, generator, 10):
                found = monitor.assess_pose(pose)
                stair_levels.append(found.level)
                said.append(" rad" in found.reason)
    print(
        f"\nboxes of nine edges off by 1 mm, cameras anywhere 10 half widths from their loci: z below 3 in "
        f"{np.mean(below):.1%}, alert in {np.mean([level > Level.OK for level in box_levels]):.1%} of {len(below)}"
    )
    bad = [level > Level.OK for level in stair_levels]
    print(f"five stair nosings: WARN or worse in {np.mean(bad):.1%} of {len(bad)}, with metres in {np.mean(said):.1%}")
    edges = singular_set(_lines(measured(KINDS["box, all edges"](generator), 1e-3, 1.7e-3, generator), 1e-3, 1.7e-3))
    start = time.process_time()
    for _ in range(1000):
        edges.proximity([1.0, 2.0, 1.5])
    each = 1e6 * (time.process_time() - start) / 1000
    print(f"proximity (z, distance, closest point, precision of the pose) of 12 lines takes {each:.0f} us of it")


def _views(singular: SingularSet, generator: np.random.Generator, count: int) -> Iterator[Pose]:
    """Yield poses that look at a scene from two to six scene lengths."""
    frame = singular.frame
    for _ in range(count):
        way = generator.normal(size=3)
        away = generator.uniform(2.0, 6.0) * frame.length / np.linalg.norm(way)
        yield Pose.look_at(frame.center + away * way, frame.center)
