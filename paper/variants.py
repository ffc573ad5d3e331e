# SPDX-License-Identifier: Apache-2.0
"""All variants of the paper's runs, and many runs at once."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

from paper import pose_quadrifolium
from paper.pose_quadrifolium import QuadrifoliumErrors
from paper.sensitivity import CHOICES, shortened
from plsing_ros.planning.camera_path import SpeedLimits
from plsing_ros.planning.detour import DetourOptions
from plsing_ros.simulation.run_record import RunRecord
from plsing_ros.simulation.servo_run import run_in_core
from plsing_ros.simulation.servo_task import ServoTask

_T = TypeVar("_T")
_R = TypeVar("_R")

Groups = Mapping[str, tuple[ServoTask, ...]]

# A moving target is up to 0.19 m/s fast, more than the guarded law's own limit.
SPEED_LIMIT_ON_PATHS = 0.3  # [m/s]
# Half of the default margin, because a leaf of a quadrifolium is only 0.3 m long; a tenth of the speed is left to the
# feedback.
AVOIDANCE = DetourOptions(margin=0.1, limits=SpeedLimits(linear=0.9 * SPEED_LIMIT_ON_PATHS))


@dataclass(frozen=True)
class Variant:
    """One way to run all tasks.

    Attributes:
        kind: "plain", "choice" or "law".
        key: Of the choice or law.
    """

    kind: str
    key: str = ""


PLAIN = Variant("plain")


def all_variants(tasks: Groups) -> dict[Variant, Groups]:
    """Return the tasks by group for the plain runs, for each other choice, and for each other law."""
    variants: dict[Variant, Groups] = {PLAIN: tasks}
    for choice in CHOICES:
        variants[Variant("choice", choice.key)] = {
            group: tuple(choice.change(shortened(task)) for task in each) for group, each in tasks.items()
        }
    for law in ("guarded", "detour"):
        variants[Variant("law", law)] = {
            group: tuple(_with_law(task, law) for task in each) for group, each in tasks.items()
        }
    return variants


def _with_law(task: ServoTask, law: str) -> ServoTask:
    if not task.moving:
        return replace(task, law={"law": law})
    return replace(
        task,
        law={"law": "guarded", "max_linear_speed": SPEED_LIMIT_ON_PATHS},
        avoidance=AVOIDANCE if law == "detour" else None,
    )


def run_pose_experiments(jobs: int = 1, on_run: Callable[[], object] = lambda: None) -> list[QuadrifoliumErrors]:
    """Run all experiments on pose estimation, with one seed each, in so many processes; on_run as in run_variants."""
    results = []
    for errors in _mapped(partial(pose_quadrifolium.run, seeds=(1,)), pose_quadrifolium.EXPERIMENTS, jobs):
        results.append(errors)
        on_run()
    return results


def run_variants(
    variants: Mapping[Variant, Groups], jobs: int = 1, on_run: Callable[[], object] = lambda: None
) -> dict[Variant, dict[str, list[RunRecord]]]:
    """Run all tasks of all variants in the core.

    Args:
        variants: Tasks by variant and group.
        jobs: Processes.
        on_run: Called after each run.

    Returns:
        Records by variant and group, in the order of the tasks.
    """
    wanted = [(variant, group, task) for variant, of in variants.items() for group in of for task in of[group]]
    records: dict[Variant, dict[str, list[RunRecord]]] = {}
    for (variant, group, _), record in zip(
        wanted, _mapped(run_in_core, [each[2] for each in wanted], jobs), strict=True
    ):
        records.setdefault(variant, {}).setdefault(group, []).append(record)
        on_run()
    return records


def _mapped(function: Callable[[_T], _R], values: Sequence[_T], jobs: int) -> Iterator[_R]:
    if jobs == 1:
        yield from map(function, values)
        return
    # Not forked: the parent may have threads of the middleware.
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(function, values)
