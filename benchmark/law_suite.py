# SPDX-License-Identifier: Apache-2.0
"""Every control law on random servo tasks, with and without noise: success, speed, way, time.

The tasks are those of servo_tasks.py: 4 to 8 random lines, a third any two poses that see them (kind 0), a third across
a line that meets them all (kind 1), a third past an isolated point or a transversal of four (kind 2). Runs are of
law_batches.py, with the same tasks, the same noise and the same constant errors for every law. A few are repeated with
the package's own controller, which must do the same.

    python3 -m benchmark law_suite
    python3 -m benchmark.law_suite --seed 2 --tasks 100 --noise 0.002 --laws pinv detour
    python3 -m benchmark.law_suite --tasks 150 --noise 0 --map-shift 0.005 --map-turn 0.3
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from functools import partial

import numpy as np
from tqdm import tqdm

from benchmark.batch_simulation import Batch, DisturbedTask
from benchmark.constant_errors import ErrorSizes, task_errors
from benchmark.law_batches import ARRIVED, TIME_STEP, TURNED, BatchOutcome, noisy, run
from benchmark.law_variants import LAWS, LIMITS, Law
from benchmark.servo_tasks import random_task
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import ControllerParameters
from plsing_ros.planning.detour import DetourOptions, Plan, plan_path
from plsing_ros.singularities import singular_set

SEED, TASKS, NOISE = 1, 500, 2e-3
_SECONDS = 120.0
_HOLDING_SECONDS = 100.0
# With noise or constant errors, the root mean square over the last seconds must be within this of the target.
_HELD, _HELD_TURN = 0.05, np.radians(2.0)
_PROCESSES = 2
_COMPARED, _COMPARED_STEPS = 8, 300


def main() -> None:
    """Measure and print, without and with noise."""
    study(SEED, TASKS, (0.0, NOISE), LAWS, ErrorSizes(), False)


def study(
    seed: int, count: int, noises: tuple[float, ...], laws: tuple[Law, ...], sizes: ErrorSizes, taught: bool
) -> None:
    """Plan the paths, run all tasks of a seed by all laws, and print the results."""
    with ProcessPoolExecutor(_PROCESSES, initializer=os.nice, initargs=(5,)) as pool:
        jobs = pool.map(partial(_prepared, seed, sizes), range(count), chunksize=5)
        cases, plans, seconds = zip(*tqdm(jobs, total=count, desc="plans"), strict=True)
        print(
            f"seed {seed}: {count} tasks; constant errors: {sizes}; targets are {'taught' if taught else 'poses'}\n"
            f"plans: {dict(Counter(plan.decision.name for plan in plans))}, "
            f"{_quantiles(1e3 * np.array(seconds), (0.5, 0.95, 1.0))} ms of CPU time each (median / 95 % / most)",
            flush=True,
        )
        batch = Batch.of(cases, taught)
        held = Batch.of([replace(case, task=replace(case.task, start=case.task.target)) for case in cases], taught)
        for noise in noises:
            stop = noise == 0.0 and sizes == ErrorSizes()
            duration = _SECONDS if stop else _HOLDING_SECONDS
            runs = [(batch, law, duration, noise, seed, stop) for law in laws]
            if not stop:
                runs.append((held, LAWS[0], duration, noise, seed, stop))
            outcomes = list(tqdm(pool.map(_run, runs), total=len(runs), desc=f"noise {noise:g}", leave=False))
            print(_report(batch, laws, outcomes, noise, None if stop else outcomes[-1]), flush=True)
    few = cases[:_COMPARED]
    for noise in noises:
        print(_comparison(few, laws, noise, seed, taught), flush=True)


def _run(job: tuple[Batch, Law, float, float, int, bool]) -> BatchOutcome:
    batch, law, seconds, noise, seed, stop = job
    return run(batch, law, seconds, noise, seed, stop=stop)


def _prepared(seed: int, sizes: ErrorSizes, number: int) -> tuple[DisturbedTask, Plan, float]:
    task = random_task(seed, number)
    errors = task_errors(sizes, seed, number, task)
    true = singular_set(task.lines)
    known = true if errors.map is task.lines else singular_set(errors.map)
    begin = time.process_time()
    plan = plan_path(known, task.start, task.target, DetourOptions())
    return DisturbedTask(task, errors, known, true), plan, time.process_time() - begin


def _success(outcome: BatchOutcome, stop: bool) -> np.ndarray:
    if stop:
        return outcome.arrived
    return (outcome.final_distance <= _HELD) & (outcome.final_turn <= _HELD_TURN)


def _report(
    batch: Batch, laws: tuple[Law, ...], outcomes: list[BatchOutcome], noise: float, floor: BatchOutcome | None
) -> str:
    """Return a table in Markdown, a row for each law."""
    stop = floor is None
    straight = np.maximum(np.linalg.norm(batch.t - batch.t_target, axis=1), 1e-9)
    target = f"within {1e3 * ARRIVED:g} mm and {np.degrees(TURNED):g} degrees of the target in {_SECONDS:g} s"
    headings = [
        "law",
        "success",
        "kind 0 / 1 / 2",
        "peak speed [m/s]",
        "runs over a limit",
        "way / straight",
        "distance kept of that asked",
    ]
    if floor is None:
        headings.append("time [s]")
    else:
        target = (
            f"within {_HELD:g} m and {np.degrees(_HELD_TURN):g} degrees of the target, root mean square over the last "
            f"5 s of {_HOLDING_SECONDS:g} s"
        )
        headings.append("success at targets that can be held")
        able = _success(floor, stop)
    rows = [headings, ["---"] * len(headings)]
    # One more run may follow, that of the targets held.
    for law, outcome in zip(laws, outcomes, strict=False):
        good = _success(outcome, stop)
        over = (outcome.peak > LIMITS[0] * (1.0 + 1e-9)) | (outcome.peak_turn > LIMITS[1] * (1.0 + 1e-9))
        row = [law.name, f"{good.mean():.1%}", " / ".join(f"{good[kind::3].mean():.1%}" for kind in range(3))]
        row += [_quantiles(outcome.peak, (0.5, 0.95, 1.0)), f"{over.mean():.1%}"]
        row.append(_quantiles(outcome.length / straight, (0.5, 0.95)))
        row.append(_quantiles(outcome.kept, (0.0, 0.05, 0.5)))
        if floor is None:
            row.append(_quantiles(outcome.seconds[good], (0.5, 0.95)))
        else:
            row.append(f"{good[able].mean():.1%}" if able.any() else "-")
        rows.append(row)
    text = [f"\nnoise {noise:g}; success: {target}\n", *(f"| {' | '.join(row)} |" for row in rows)]
    if floor is not None:
        text.append(
            f"\nThe plain law, started at the target, holds {able.sum()} of {len(able)} targets that well; the other "
            f"{(~able).sum()} are too near a singularity for this noise and these errors, or elsewhere by the map."
        )
    for law, outcome in zip(laws, outcomes, strict=False):
        failed = np.flatnonzero(~_success(outcome, stop))
        if law.follows and len(failed):
            text.append(f"Tasks that {law.name} fails: {', '.join(map(str, failed))}")
        if law.follows:
            again = outcome.plans > 1
            text.append(f"Ways planned anew by {law.name}: in {again.sum()} tasks, {outcome.plans.max():g} at the most")
        if not stop:
            off = _quantiles(outcome.final_distance, (0.5, 0.95, 1.0))
            text.append(f"{law.name} ends {off} m off (median / 95 % / most)")
    return "\n".join(text)


def _quantiles(values: np.ndarray, which: tuple[float, ...]) -> str:
    if len(values) == 0:
        return "-"
    return " / ".join(f"{value:.3g}" for value in np.quantile(values, which))


def _comparison(cases: Sequence[DisturbedTask], laws: tuple[Law, ...], noise: float, seed: int, taught: bool) -> str:
    """Return how far the package's own controller gets from these runs, with the same noise, until they arrive."""
    text = [
        f"\nlargest distance to the package's controller, over the path gone where that is above 1 m, in {len(cases)} "
        f"tasks (median / most): noise {noise:g}, {_COMPARED_STEPS} steps"
    ]
    batch = Batch.of(cases, taught)
    drawn = np.random.default_rng(seed).normal(scale=noise, size=(_COMPARED_STEPS, 2, *batch.direction.shape))
    for law in laws:
        ours = run(batch, law, _COMPARED_STEPS * TIME_STEP, noise, seed, keep=True)
        apart = []
        for number, case in enumerate(cases):
            steps = round(ours.seconds[number] / TIME_STEP)
            theirs = _by_controller(case, law, drawn[:steps, :, number, : len(case.task.lines)], taught)
            distance = np.linalg.norm(theirs - np.array(ours.position)[:steps, number], axis=1)
            apart.append(distance.max(initial=0.0) / max(ours.length[number], 1.0))
        text.append(f"  {law.name:22} {np.median(apart):.1e} / {max(apart):.1e}")
    return "\n".join(text)


def _by_controller(case: DisturbedTask, law: Law, drawn: np.ndarray, taught: bool) -> np.ndarray:
    """Return the camera centres of a run by the package's controller, shape (steps, 3) [m].

    Args:
        case: The scene, where to go, and the constant errors.
        law: By which law.
        drawn: Noise of each step, shape (steps, 2, n, 3).
        taught: Whether the target is given by what is seen there.
    """
    task, errors = case.task, case.errors
    values = {
        "lines.points": tuple(errors.map.point.ravel()),
        "lines.directions": tuple(errors.map.direction.ravel()),
        "target.position": tuple(task.target.translation),
        "target.orientation": tuple(task.target.quaternion_xyzw),
        "target.source": "topic" if taught else "pose",
    }
    servo = ServoController.from_parameters(ControllerParameters.from_values({**values, **law.parameters}))
    none = np.zeros((2, len(task.lines), 3))
    if taught:
        servo.set_target(LineObservation.of_lines(_seen(case, task.target, none)))
    pose, centers = task.start, []
    for step, noise in enumerate(drawn):
        centers.append(pose.translation)
        stamp = 10**9 + round(step * TIME_STEP * 1e9)
        twist = servo.answer(LineObservation.of_lines(_seen(case, pose, noise)), stamp, stamp).twist
        told = pose @ errors.T_told_camera.inverse()
        pose = told.integrate(errors.speed * twist, TIME_STEP) @ errors.T_told_camera
    return np.reshape(centers, (-1, 3))


def _seen(case: DisturbedTask, pose: Pose, noise: np.ndarray) -> LineSet:
    true = case.task.lines.transformed(pose.inverse(), "camera")
    return LineSet(*noisy(true.direction, case.errors.depth * true.moment, noise), "camera", true.ids)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--tasks", type=int, default=TASKS)
    parser.add_argument(
        "--noise", type=float, nargs="+", default=(0.0, NOISE), help="on Plücker coordinates of the lines"
    )
    parser.add_argument("--laws", nargs="+", metavar="LAW", choices=[law.name for law in LAWS], help="default: all")
    for each in fields(ErrorSizes):
        option = "--" + each.name.replace("_", "-")
        parser.add_argument(option, type=float, default=each.default, help=f"constant error {each.metadata['help']}")
    parser.add_argument(
        "--largest-scale-error", type=float, default=LAWS[-1].max_scale_error, help="of the 3-D lines, for detour"
    )
    parser.add_argument("--taught", action="store_true", help="give targets by what is seen there, not as poses")
    options = parser.parse_args()
    chosen = tuple(
        replace(law, max_scale_error=options.max_scale_error)
        for law in LAWS
        if not options.laws or law.name in options.laws
    )
    errors = ErrorSizes(**{each.name: getattr(options, each.name) for each in fields(ErrorSizes)})
    study(options.seed, options.tasks, tuple(options.noise), chosen, errors, options.taught)
