"""The closed loop over DDS: simulator, controller and monitor in lockstep, on each executor in the same run.

Beside it bare nodes that send the same messages and compute nothing: what rclpy and the middleware take of each step.
"""

from __future__ import annotations

import functools
import os
import signal
import statistics
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmark.bare_loop import BareController, BareMonitor, BareSimulator
from benchmark.step_times import FRAMES, StepTimes
from plsing_ros.experiments import near_transversal as experiment
from plsing_ros.experiments.config_files import config_file
from plsing_ros.nodes.controller import Controller
from plsing_ros.nodes.feature_simulator import FeatureSimulator
from plsing_ros.nodes.harness import Harness
from plsing_ros.nodes.run import run_node
from plsing_ros.nodes.singularity_monitor import SingularityMonitor

TIMEOUT = 120.0  # [s]
ROOT = Path(__file__).parents[1]
PARAMETERS = config_file("paper_p4l.yaml")
IN_LOCKSTEP = {"mode": "lockstep", "publish_clock": True, "start.position": experiment.STARTS[0].position.tolist()}


class TimedSimulator(FeatureSimulator):
    """Notes when it makes a step."""

    def __init__(self, **options: Any) -> None:
        self.steps = StepTimes()
        super().__init__(**options)

    def _advance_in_lockstep(self) -> None:
        before = self._simulation.frame().step
        super()._advance_in_lockstep()
        if self._simulation.frame().step != before:
            self.steps.note()


class Nodes(NamedTuple):
    """The three nodes of a loop."""

    controller: Callable[..., Any]
    monitor: Callable[..., Any]
    simulator: Callable[..., Any]
    params_file: Path | None
    of_simulator: Mapping[str, Any]


LOOPS = {
    "ours": Nodes(Controller, SingularityMonitor, TimedSimulator, PARAMETERS, IN_LOCKSTEP),
    "bare": Nodes(BareController, BareMonitor, BareSimulator, None, {}),
}


def main() -> None:
    """Measure and print."""
    print(f"time from one frame to the next, {FRAMES} frames, three nodes [ms]\n")
    print(f"{'':>20} {'nodes':>6} {'executor':>10} {'median':>8} {'10 %':>8} {'99 %':>8} {'steps/s':>8}")
    yielding = functools.partial(_apart, monitor=("nice", "-n", "10"))
    ways = (("in three processes", _apart), ("monitor at nice 10", yielding), ("in one process", _together))
    for where, measured in ways:
        for loop in LOOPS:
            medians = {}
            for executor in ("events", "single"):
                steps = measured(loop, executor)
                medians[executor] = statistics.median(steps)
                low, high = np.percentile(steps, [10, 99])
                print(
                    f"{where:>20} {loop:>6} {executor:>10} {medians[executor]:8.2f} {low:8.2f} {high:8.2f} "
                    f"{1e3 / medians[executor]:8.0f}",
                    flush=True,
                )
            print(f"{where:>20} {loop:>6} single / events: {medians['single'] / medians['events']:.1f}\n")


def run_one(loop: str, role: str, *argv: str) -> int:
    """Run one node of a loop in this process; the simulator ends after the last frame and prints its times."""
    if role != "simulator":
        return run_node(getattr(LOOPS[loop], role), role, "", argv)
    made = []

    def create(**options: Any) -> Any:
        made.append(LOOPS[loop].simulator(**options))
        made[0].steps.done.add_done_callback(lambda _: os.kill(os.getpid(), signal.SIGTERM))
        return made[0]

    code = run_node(create, role, "", argv)
    if code == 0:
        print(*made[0].steps.milliseconds())
    return code


def _together(loop: str, executor: str) -> Sequence[float]:
    nodes = LOOPS[loop]
    with Harness(executor, log_level="ERROR") as ros:
        for node in (nodes.monitor, nodes.controller):
            ros.add(node, nodes.params_file, {"use_sim_time": True})
        simulator = ros.add(nodes.simulator, nodes.params_file, nodes.of_simulator)
        # Not spin_until: it comes back after each event.
        ros._executor.spin_until_future_complete(simulator.steps.done, TIMEOUT)
        return simulator.steps.milliseconds()


def _apart(loop: str, executor: str, monitor: Sequence[str] = ()) -> Sequence[float]:
    # The harness only for its domain.
    with Harness(executor, log_level="ERROR") as ros:
        start = functools.partial(_process, loop, executor, ros.environment())
        others = [start("controller", {"use_sim_time": True}), start("monitor", {"use_sim_time": True}, monitor)]
        try:
            output, _ = start("simulator", LOOPS[loop].of_simulator).communicate(timeout=TIMEOUT)
        finally:
            for process in others:
                process.terminate()
            for process in others:
                process.communicate(timeout=TIMEOUT)
        return [float(each) for each in output.split()]


def _process(
    loop: str,
    executor: str,
    environment: dict[str, str],
    role: str,
    parameters: Mapping[str, Any],
    before: Sequence[str] = (),
) -> subprocess.Popen[str]:
    given = [each for name, value in parameters.items() for each in ("-p", f"{name}:={value}")]
    file = LOOPS[loop].params_file
    return subprocess.Popen(
        [
            *before,
            *(
                sys.executable,
                "-c",
                "import sys; from benchmark.closed_loop import run_one as run; sys.exit(run(*sys.argv[1:]))",
            ),
            *(loop, role, "--executor", executor, "--ros-args", "--log-level", "ERROR"),
            *([] if file is None else ["--params-file", str(file)]),
            *given,
        ],
        env=environment,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
