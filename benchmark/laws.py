"""Every control law on random servo tasks, with and without noise: success, speed, way, time.

The tasks are those of servo_tasks.py: 4 to 8 random lines, a third any two poses that see them (kind 0), a third across
a line that meets them all (kind 1), a third past an isolated point or a transversal of four (kind 2). Runs are of
law_runs.py, with the same tasks and the same noise for every law. A few are repeated with the package's own
controller, which must do the same.

    python3 -m benchmark laws
    python3 -m benchmark.laws --seed 2 --tasks 100 --noise 0.002 --laws pinv detour
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
from functools import partial

import numpy as np
from tqdm import tqdm

from benchmark.law_list import LAWS, LIMITS, Law
from benchmark.law_runs import ARRIVED, TIME_STEP, TURNED, Batch, Outcome, noisy, run
from benchmark.servo_tasks import Task, random_task
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet
from plsing_ros.parameters import ControllerParameters
from plsing_ros.servoing.line_servo import LineServo
from plsing_ros.servoing.ways.detour import DetourOptions, Plan, plan_way
from plsing_ros.singularities import SingularSet, singular_set

SEED, TASKS, NOISE = 1, 500, 2e-3
_SECONDS = 120.0
_NOISY_SECONDS = 100.0
# With noise, the root mean square over the last seconds must be within this of the goal.
_HELD, _HELD_TURN = 0.05, np.radians(2.0)
_PROCESSES = 2
_COMPARED, _COMPARED_STEPS = 8, 300


def main() -> None:
    """Measure and print, without and with noise."""
    study(SEED, TASKS, (0.0, NOISE), LAWS)


def study(seed: int, count: int, noises: tuple[float, ...], laws: tuple[Law, ...]) -> None:
    """Plan the ways, run all tasks of a seed by all laws, and print the results."""
    with ProcessPoolExecutor(_PROCESSES, initializer=os.nice, initargs=(5,)) as pool:
        prepared = list(tqdm(pool.map(partial(_prepared, seed), range(count), chunksize=5), total=count, desc="plans"))
        tasks, sets, plans, seconds = zip(*prepared, strict=True)
        print(
            f"seed {seed}: {count} tasks; plans: {dict(Counter(plan.decision.name for plan in plans))}, "
            f"{_quantiles(1e3 * np.array(seconds), (0.5, 0.95, 1.0))} ms of CPU time each (median / 95 % / most)",
            flush=True,
        )
        batch = Batch.of(tasks, sets)
        held = Batch.of([Task(task.lines, task.goal, task.goal) for task in tasks], sets)
        for noise in noises:
            duration = _NOISY_SECONDS if noise else _SECONDS
            jobs = [(batch, law, duration, noise, seed) for law in laws]
            if noise:
                jobs.append((held, LAWS[0], duration, noise, seed))
            outcomes = list(tqdm(pool.map(_run, jobs), total=len(jobs), desc=f"noise {noise:g}", leave=False))
            print(_report(batch, laws, outcomes, noise, outcomes[-1] if noise else None), flush=True)
    few = tasks[:_COMPARED]
    for noise in noises:
        print(_comparison(few, Batch.of(few, sets[:_COMPARED]), laws, noise, seed), flush=True)


def _run(job: tuple[Batch, Law, float, float, int]) -> Outcome:
    return run(*job)


def _prepared(seed: int, number: int) -> tuple[Task, SingularSet, Plan, float]:
    task = random_task(seed, number)
    found = singular_set(task.lines)
    begin = time.process_time()
    plan = plan_way(found, task.start, task.goal, DetourOptions())
    return task, found, plan, time.process_time() - begin


def _success(outcome: Outcome, noise: float) -> np.ndarray:
    if noise == 0.0:
        return outcome.arrived
    return (outcome.final_distance <= _HELD) & (outcome.final_turn <= _HELD_TURN)


def _report(batch: Batch, laws: tuple[Law, ...], outcomes: list[Outcome], noise: float, floor: Outcome | None) -> str:
    """Return a table in Markdown, a row for each law."""
    straight = np.maximum(np.linalg.norm(batch.t - batch.t_goal, axis=1), 1e-9)
    goal = f"within {1e3 * ARRIVED:g} mm and {np.degrees(TURNED):g} degrees of the goal in {_SECONDS:g} s"
    headings = ["law", "success", "kind 0 / 1 / 2", "peak speed [m/s]", "runs over a limit", "way / straight"]
    if floor is None:
        headings.append("time [s]")
    else:
        goal = (
            f"within {_HELD:g} m and {np.degrees(_HELD_TURN):g} degrees of the goal, root mean square over the last "
            f"5 s of {_NOISY_SECONDS:g} s"
        )
        headings.append("success at goals that can be held")
        able = _success(floor, noise)
    rows = [headings, ["---"] * len(headings)]
    # With noise one more run follows, that of the goals held.
    for law, outcome in zip(laws, outcomes, strict=False):
        good = _success(outcome, noise)
        over = (outcome.peak > LIMITS[0] * (1.0 + 1e-9)) | (outcome.peak_turn > LIMITS[1] * (1.0 + 1e-9))
        row = [law.name, f"{good.mean():.1%}", " / ".join(f"{good[kind::3].mean():.1%}" for kind in range(3))]
        row += [_quantiles(outcome.peak, (0.5, 0.95, 1.0)), f"{over.mean():.1%}"]
        row.append(_quantiles(outcome.length / straight, (0.5, 0.95)))
        row.append(_quantiles(outcome.seconds[good], (0.5, 0.95)) if floor is None else f"{good[able].mean():.1%}")
        rows.append(row)
    text = [f"\nnoise {noise:g}; success: {goal}\n", *(f"| {' | '.join(row)} |" for row in rows)]
    if floor is not None:
        text.append(
            f"\nThe plain law, started at the goal, holds {able.sum()} of the {len(able)} goals that well; the other "
            f"{(~able).sum()} are too near a singularity for this noise."
        )
    for law, outcome in zip(laws, outcomes, strict=False):
        failed = np.flatnonzero(~_success(outcome, noise))
        if law.follows and len(failed):
            text.append(f"Tasks that {law.name} fails: {', '.join(map(str, failed))}")
    return "\n".join(text)


def _quantiles(values: np.ndarray, which: tuple[float, ...]) -> str:
    if len(values) == 0:
        return "-"
    return " / ".join(f"{value:.3g}" for value in np.quantile(values, which))


def _comparison(tasks: Sequence[Task], batch: Batch, laws: tuple[Law, ...], noise: float, seed: int) -> str:
    """Return how far the package's own controller gets from these runs, until they arrive.

    Both have the same noise, but none in the first step, so that they plan from the same pose.
    """
    text = [
        f"\nlargest distance to the package's controller, over the way gone where that is above 1 m: noise {noise:g}, "
        f"{_COMPARED_STEPS} steps of {len(tasks)} tasks"
    ]
    drawn = np.random.default_rng(seed).normal(scale=noise, size=(_COMPARED_STEPS, 2, *batch.direction.shape))
    drawn[0] = 0.0
    for law in laws:
        ours = run(batch, law, _COMPARED_STEPS * TIME_STEP, noise, seed, keep=True, quiet=1)
        apart = []
        for number, task in enumerate(tasks):
            steps = round(ours.seconds[number] / TIME_STEP)
            theirs = _by_controller(task, law, drawn[:steps, :, number, : len(task.lines)])
            distance = np.linalg.norm(theirs - np.array(ours.position)[:steps, number], axis=1)
            apart.append(distance.max(initial=0.0) / max(ours.length[number], 1.0))
        text.append(f"  {law.name:22} {max(apart):.1e}")
    return "\n".join(text)


def _by_controller(task: Task, law: Law, drawn: np.ndarray) -> np.ndarray:
    """Return the camera centres of a run by the package's controller, shape (steps, 3) [m].

    Args:
        task: The scene and where to go.
        law: By which law.
        drawn: Noise of each step, shape (steps, 2, n, 3).
    """
    values = {
        "lines.points": tuple(task.lines.point.ravel()),
        "lines.directions": tuple(task.lines.direction.ravel()),
        "target.position": tuple(task.goal.translation),
        "target.orientation": tuple(task.goal.quaternion_xyzw),
    }
    servo = LineServo(ControllerParameters.from_values({**values, **law.parameters}))
    pose, centers = task.start, []
    for step, noise in enumerate(drawn):
        centers.append(pose.translation)
        true = task.lines.transformed(pose.inverse(), "camera")
        seen = LineSet(*noisy(true.direction, true.moment, noise), "camera", true.ids)
        stamp = 10**9 + round(step * TIME_STEP * 1e9)
        pose = pose.moved(servo.step(LineObservation.of_lines(seen), stamp, stamp).twist, TIME_STEP)
    return np.reshape(centers, (-1, 3))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--tasks", type=int, default=TASKS)
    parser.add_argument(
        "--noise", type=float, nargs="+", default=(0.0, NOISE), help="on Plücker coordinates of the lines"
    )
    parser.add_argument("--laws", nargs="+", metavar="LAW", choices=[law.name for law in LAWS], help="default: all")
    options = parser.parse_args()
    chosen = tuple(law for law in LAWS if not options.laws or law.name in options.laws)
    study(options.seed, options.tasks, tuple(options.noise), chosen)
