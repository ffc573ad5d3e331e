# SPDX-License-Identifier: Apache-2.0
"""The answer of an evaluation: whether a task is safe, why, and what to do next."""

from __future__ import annotations

import enum
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from plsing_ros.analysis.checkpoint import Checkpoint, digest
from plsing_ros.analysis.evaluation.closed_loop import RunResult, RunTask, run_tasks_of, simulate_run
from plsing_ros.analysis.evaluation.maps import MapResult, MapTask, check_maps, map_tasks_of
from plsing_ros.analysis.evaluation.setup import HARD, YOURS, Setup
from plsing_ros.analysis.parallel import Workers
from plsing_ros.analysis.rates import Rate
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.parameters.law import LAWS
from plsing_ros.planning.rollout import Harm

# A law is worth proposing if it comes to harm this much less often.
_BETTER = 0.1
# Mean squared errors of poses above this, where 6 is right, mean that poses are less exact than they say.
_TOO_SURE = 12.0
HARM_TEXT = {
    Harm.NONE: "arrived",
    Harm.AWAY: "left the neighbourhood of its path",
    Harm.FEW_LINES: "lost sight of the lines",
    Harm.LATE: "did not arrive in time",
}


class Safety(enum.Enum):
    """Whether the task is safe, in a word."""

    SAFE = "safe"
    CARE = "safe with care"
    UNKNOWN = "not known: too few runs"
    UNSAFE = "not safe"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """All runs and maps of a setup, and what they mean.

    Attributes:
        setup: What was evaluated.
        runs: By each law from the user's starts, and by the user's law from hard starts.
        maps: As they may be in reality.
        max_harm: The share of harmful runs that is allowed.
        clearance: Distance from singular loci that is asked for [m].
        accuracy: Distance from the target at the end that is good enough [m].
    """

    setup: Setup
    runs: tuple[RunResult, ...]
    maps: tuple[MapResult, ...]
    max_harm: float
    clearance: float
    accuracy: float

    def of_law(self, law: str, kind: str = YOURS) -> list[RunResult]:
        """Return the runs of a law."""
        return [run for run in self.runs if run.law == law and run.kind == kind]

    def harm(self, law: str) -> Rate:
        """Return how many runs of a law come to harm."""
        runs = self.of_law(law)
        return Rate(sum(run.harm > 0 for run in runs), len(runs))

    @cached_property
    def laws(self) -> tuple[str, ...]:
        """The laws that were run, the user's first."""
        return tuple(dict.fromkeys(run.law for run in self.runs))

    @property
    def law(self) -> str:
        """The user's law."""
        return self.setup.controller.law

    @cached_property
    def watched(self) -> list[RunResult]:
        """The runs that the monitor watched."""
        return [run for run in self.runs if run.law == self.law]

    def lead(self, run: RunResult) -> float:
        """Return how long before harm the first alert came [s]; negative infinity if none came."""
        return -math.inf if run.first_alert is None else run.time - run.first_alert

    @cached_property
    def announced(self) -> Rate:
        """How many harmful runs were announced early enough: 0.5 s or 0.3 / gain before, or at once."""
        wanted = min(0.5, 0.3 / self.setup.controller.gain)
        harmful = [run for run in self.watched if run.harm]
        hits = [
            run.first_alert is not None and run.first_alert <= max(run.time - wanted, 0.0) + 1e-9 for run in harmful
        ]
        return Rate(sum(hits), len(hits))

    @cached_property
    def false_alarms(self) -> Rate:
        """How many runs without harm and without too much speed had an alert."""
        calm = [run for run in self.watched if not run.harm and run.demand_time is None]
        return Rate(sum(run.first_alert is not None for run in calm), len(calm))

    @cached_property
    def wrong_poses(self) -> Rate:
        """In how many runs of the user's law a pose was off by more than five standard deviations and not refused."""
        runs = self.of_law(self.law)
        return Rate(sum(run.wrong > 0 for run in runs), len(runs))

    @cached_property
    def nees(self) -> float:
        """Mean normalised squared error of the poses of the user's runs; 6 is right."""
        values = [run.nees for run in self.of_law(self.law) if run.poses]
        return float(np.mean(values)) if values else math.nan

    @cached_property
    def end_error(self) -> float:
        """95 % of the user's runs that arrive end within this of the target [m]; nan if none arrives."""
        return self.end_error_of(self.law)

    def end_error_of(self, law: str) -> float:
        """Return within what of the target 95 % of a law's runs that arrive end [m]; nan if none arrives."""
        errors = [run.error for run in self.of_law(law) if not run.harm]
        return float(np.quantile(errors, 0.95)) if errors else math.nan

    @cached_property
    def near_maps(self) -> Rate:
        """In how many maps the straight path comes nearer to a singular locus than the clearance."""
        return Rate(
            sum(each.nearest is not None and each.nearest < self.clearance for each in self.maps), len(self.maps)
        )

    @cached_property
    def covered(self) -> Rate:
        """How many true singular centres are near a reported locus or have a low z."""
        return Rate(sum(each.covered for each in self.maps), sum(each.on_loci for each in self.maps))

    @cached_property
    def safety(self) -> Safety:
        """The verdict."""
        low, high = self.harm(self.law).interval
        if low > self.max_harm:
            return Safety.UNSAFE
        if high > self.max_harm:
            return Safety.UNKNOWN if self.harm(self.law).share <= self.max_harm else Safety.UNSAFE
        return Safety.CARE if self.concerns else Safety.SAFE

    @cached_property
    def verdict(self) -> str:
        """The verdict in a sentence."""
        harm, (_, high) = self.harm(self.law), self.harm(self.law).interval
        did = f"{harm.hits} of {harm.total} runs with law {self.law} come to harm"
        if self.safety is Safety.UNSAFE:
            kinds = Counter(HARM_TEXT[Harm(run.harm)] for run in self.of_law(self.law) if run.harm)
            return f"This task is not safe: {did} (most often the camera {kinds.most_common(1)[0][0]})."
        if self.safety is Safety.UNKNOWN:
            return f"{did}; that is too few runs to say that at most {self.max_harm:.0%} do (it may be {high:.1%})."
        care = "" if self.safety is Safety.SAFE else ", but read what follows"
        return f"This task is safe as far as these runs can tell{care}: {did}, so at most {high:.1%} do (95 %)."

    @cached_property
    def concerns(self) -> list[str]:
        """What speaks against the task although it may arrive, a sentence each."""
        found, runs = [], self.of_law(self.law)
        fast = Rate(sum(run.demand_time is not None for run in runs), len(runs))
        if fast.hits:
            worst = max(run.demand for run in runs)
            found.append(f"more speed is commanded than the robot's limit, up to {worst:.1f} times as much: {fast}")
        if self.announced.hits < self.announced.total:
            found.append(f"not every harm is announced early enough by the monitor: {self.announced}")
        if self.wrong_poses.hits:
            found.append(f"runs with a pose that is wrong and not said to be: {self.wrong_poses}")
        if self.nees > _TOO_SURE:
            found.append(
                f"poses are less exact than they say: their squared error over their covariance is {self.nees:.3g}, "
                "where 6 is right"
            )
        if self.end_error > self.accuracy:
            found.append(
                f"95 % of the runs that arrive end within {1e3 * self.end_error:.3g} mm of the target; asked were "
                f"{1e3 * self.accuracy:g} mm"
            )
        if self.near_maps.hits:
            nearest = min(
                (each for each in self.maps if each.nearest is not None), key=lambda each: each.nearest or 0.0
            )
            found.append(
                f"the straight path comes within {nearest.nearest:.3g} m of a singular centre ({nearest.name}); nearer "
                f"than {self.clearance:g} m in {self.near_maps} of the maps that your lines may be"
            )
        return found

    @cached_property
    def advice(self) -> list[str]:
        """What to do next, a sentence each; empty if there is nothing to do."""
        found = []
        own, monitor = self.harm(self.law), self.setup.monitor
        better = [law for law in self.laws if self.harm(law).share <= own.share - _BETTER]
        if better:
            best = min(better, key=lambda law: (self.harm(law).share, self.end_error_of(law)))
            found.append(
                f"use law: {best} for the controller, and evaluate again: with it {self.harm(best)} come to harm"
            )
        if self.safety is Safety.UNKNOWN:
            found.append(f"make more runs: --runs {4 * own.total}; what is done is kept with --output")
        said = Counter(run.late for run in self.of_law(self.law) if run.harm == Harm.LATE and run.late)
        if said:
            found.append(f"see why the controller stood still: {said.most_common(1)[0][0]}")
        blind = sum(run.harm == Harm.FEW_LINES for run in self.of_law(self.law))
        if blind:
            found.append("keep the lines in view: start nearer, choose a lens with a wider view, or use more lines")
        if not better and (self.nees > _TOO_SURE or self.wrong_poses.hits):
            found.append("give the lines larger tolerances (lines.position_std, lines.direction_std), or measure them")
        if self.near_maps.hits or self.end_error > self.accuracy:
            found.append("look at the scene with `analyze --page`, and for better lines with `select_lines`")
        if monitor.image_noise == 0.0 and self.setup.noise > 1e-4:
            found.append(
                f"set camera.image_noise: {self.setup.noise:g} for singularity_monitor: its roll-outs are without noise"
            )
        if monitor.controller == "unknown":
            found.append("set prediction.controller: law for singularity_monitor, or it cannot tell the risk")
        return found

    def __str__(self) -> str:
        rows = [self.verdict, *(f"  - {each}" for each in self.concerns)]
        if self.advice:
            rows += ["what to do next:", *(f"  - {each}" for each in self.advice)]
        rows += ["", "law               comes to harm                           95 % end within    time"]
        for law in self.laws:
            arrived = [run.time for run in self.of_law(law) if not run.harm]
            time = f"{np.median(arrived):.1f} s" if arrived else "-"
            error = self.end_error_of(law)
            end = f"{1e3 * error:.2f} mm" if math.isfinite(error) else "-"
            rows.append(f"{law:16s}  {self.harm(law)!s:38s}  {end:>15s}  {time:>6s}")
        rows += [
            "",
            f"alerts: harm announced early enough {self.announced}; false alarms {self.false_alarms}",
            f"pose:   wrong and not said to be in {self.wrong_poses}; squared error / covariance {self.nees:.2f} (6)",
            f"map:    path nearer than {self.clearance:g} m to a singular centre in {self.near_maps} of the maps",
            f"        true singular centres that the report covers: {self.covered}",
        ]
        return "\n".join(rows)

    def as_json(self) -> dict[str, Any]:
        """Return what a program needs."""
        return {
            "verdict": self.safety.value,
            "sentence": self.verdict,
            "concerns": self.concerns,
            "advice": self.advice,
            "law": self.law,
            "laws": {
                law: {
                    "harm": _rate(self.harm(law)),
                    "end_error": _number(self.end_error_of(law)),
                    "kinds": dict(Counter(HARM_TEXT[Harm(run.harm)] for run in self.of_law(law))),
                }
                for law in self.laws
            },
            "alerts": {
                "announced": _rate(self.announced),
                "false_alarms": _rate(self.false_alarms),
                "hard_runs": len(self.of_law(self.law, HARD)),
            },
            "pose": {"wrong_runs": _rate(self.wrong_poses), "mean_squared_error": _number(self.nees)},
            "map": {"near_path": _rate(self.near_maps), "covered": _rate(self.covered)},
        }


def evaluate(
    setup: Setup,
    runs: int = 40,
    maps: int = 40,
    *,
    laws: tuple[str, ...] = LAWS,
    max_harm: float = 0.1,
    clearance: float = 0.1,
    accuracy: float = 0.02,
    workers: Workers | None = None,
    checkpoint: Checkpoint | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Evaluation:
    """Return whether a task is safe, by simulated runs and by maps as they may be.

    Args:
        setup: The task.
        runs: With each law, and once more from hard starts.
        maps: To be drawn.
        laws: To be compared with the setup's own.
        max_harm: The share of harmful runs that is allowed.
        clearance: Distance from singular loci that is asked for [m].
        accuracy: Distance from the target at the end that is good enough [m].
        workers: Who does the work; None: this process.
        checkpoint: Where results are kept.
        progress: Called with how many tasks are done, and how many there are.

    Raises:
        PlsingError: If the parameters make no task, or the workers cannot be used.

    Source: new, docs/howto/evaluate.md.
    """
    ServoController.from_parameters(setup.controller)
    SingularityMonitor.from_parameters(setup.monitor)
    tasks: dict[str, RunTask | MapTask] = {**run_tasks_of(setup, laws, runs), **map_tasks_of(setup, maps)}
    found: list[RunResult] = []
    checked: list[MapResult] = []
    with workers or Workers(processes=1) as team:
        results = (checkpoint or Checkpoint(None, {})).run(team, run_task, tasks)
        for done, (task, result) in enumerate(zip(tasks.values(), results, strict=True), start=1):
            if isinstance(task, RunTask):
                found.append(RunResult(**result))
            else:
                checked += [MapResult(**each) for each in result]
            progress(done, len(tasks))
    return Evaluation(setup, tuple(found), tuple(checked), max_harm, clearance, accuracy)


def run_task(task: RunTask | MapTask) -> dict[str, Any] | list[dict[str, Any]]:
    """Do a task of an evaluation."""
    return simulate_run(task) if isinstance(task, RunTask) else check_maps(task)


def name_of(setup: Setup) -> str:
    """Return a short name for a setup: results under it are of no other."""
    start = setup.start
    return digest(
        setup.controller,
        setup.monitor,
        setup.estimator,
        start.rotation,
        start.translation,
        (setup.period, setup.noise, setup.spread, setup.turn, setup.seed),
    )


def _rate(rate: Rate) -> dict[str, Any]:
    low, high = rate.interval
    return {"hits": rate.hits, "total": rate.total, "low": low, "high": high}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
