# SPDX-License-Identifier: Apache-2.0
"""survey, evaluate and select_lines on one process and on two: wall time, in one run.

python3 -m benchmark parallel
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

from benchmark.line_selection import room
from plsing_ros import select_lines
from plsing_ros.analysis.evaluation.evaluation import evaluate
from plsing_ros.analysis.evaluation.setup import Setup
from plsing_ros.analysis.parallel import Workers, run_tasks
from plsing_ros.cli.survey import survey_chunk
from plsing_ros.parameters import (
    ControllerParameters,
    MonitorParameters,
    PoseEstimatorParameters,
    SimulatorParameters,
)
from plsing_ros.parameters.config_files import config_file
from plsing_ros.parameters.parameter_file import read_parameters


def main() -> None:
    """Measure and print."""
    for name, call in (
        ("survey, 150,000 scenes", _survey),
        ("evaluate, 16 runs", _evaluate),
        ("select_lines", _select),
    ):
        seconds, spent, answers = [], [], []
        for processes in (1, 2):
            begin, before = time.perf_counter(), _processor_time()
            answers.append(call(processes))
            seconds.append(time.perf_counter() - begin)
            spent.append(_processor_time() - before)
        same = "the same result" if answers[0] == answers[1] else "ANOTHER RESULT"
        print(
            f"{name:24s} wall {seconds[0]:5.1f} and {seconds[1]:5.1f} s: {seconds[0] / seconds[1]:.2f} times; "
            f"processor {spent[0]:5.1f} and {spent[1]:5.1f} s: {2.0 * spent[0] / spent[1]:.2f} times at best; {same}",
            flush=True,
        )


def _processor_time() -> float:
    """Return what this process and those that it has waited for have taken [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _survey(processes: int) -> object:
    return list(run_tasks(_chunk, list(range(15)), processes=processes))


def _chunk(number: int) -> object:
    return [survey_chunk(1, 5 * number + i, 2000) for i in range(5)]


def _evaluate(processes: int) -> object:
    file = config_file("small_object.yaml")
    kinds: tuple[tuple[str, Callable[..., object]], ...] = (
        ("controller", ControllerParameters.from_values),
        ("singularity_monitor", MonitorParameters.from_values),
        ("pose_estimator", PoseEstimatorParameters.from_values),
    )
    simulator = SimulatorParameters.from_values(read_parameters(file, "feature_simulator"))
    parameters = [make(read_parameters(file, node)) for node, make in kinds]
    setup = Setup.of_parameters(*parameters, simulator.start_pose(), simulator.time_step)
    with Workers(processes=processes) as workers:
        found = evaluate(setup, 8, 8, laws=(), workers=workers)
    return found.as_json()


def _select(processes: int) -> object:
    lines, ends, path = room(0, 50)
    chosen = select_lines(lines, 4, path, ends=ends, clearance=0.1, processes=processes)
    return chosen.ids, chosen.deviation, chosen.dropped
