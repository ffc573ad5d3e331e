# SPDX-License-Identifier: Apache-2.0
"""The closed loop over DDS: simulator, controller and monitor in lockstep, on each executor in the same run.

Beside it bare nodes that send the same messages and compute nothing: what rclpy and the middleware take of each step.
Nodes that are named together share a process, as in the executable container.
"""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmark.rclpy_baseline import BareController, BareMonitor, BareSimulator
from benchmark.step_times import FRAMES, StepTimes
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.main import node_parser, run_nodes
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation import near_transversal as experiment
from plsing_ros.testing.harness import Harness

TIMEOUT = 120.0  # [s]
ROOT = Path(__file__).parents[1]
PARAMETERS = config_file("paper_p4l.yaml")
IN_LOCKSTEP = {"mode": "lockstep", "publish_clock": True, "start.position": experiment.STARTS[0].position.tolist()}


class TimedSimulator(FeatureSimulatorNode):
    """Notes when it makes a step."""

    def __init__(self, **options: Any) -> None:
        self.steps = StepTimes()
        super().__init__(**options)

    def _advance_in_lockstep(self) -> None:
        before = self.simulation.step
        super()._advance_in_lockstep()
        if self.simulation.step != before:
            self.steps.note()


class Nodes(NamedTuple):
    """The three nodes of a loop."""

    controller: Callable[..., Any]
    monitor: Callable[..., Any]
    simulator: Callable[..., Any]
    params_file: Path | None
    of_simulator: Mapping[str, Any]


class Place(NamedTuple):
    """Where the nodes of a loop run.

    Attributes:
        processes: The nodes of each process.
        before_monitor: Put before the command of the process whose only node is the monitor.
    """

    processes: Sequence[Sequence[str]]
    before_monitor: Sequence[str] = ()


LOOPS = {
    "ours": Nodes(ControllerNode, SingularityMonitorNode, TimedSimulator, PARAMETERS, IN_LOCKSTEP),
    "bare": Nodes(BareController, BareMonitor, BareSimulator, None, {}),
}
_APART = (["simulator"], ["controller"], ["monitor"])
PLACES = {
    "three processes": Place(_APART),
    "monitor at nice 10": Place(_APART, ("nice", "-n", "10")),
    "monitor apart": Place((["simulator", "controller"], ["monitor"])),
    "one process": Place((["simulator", "controller", "monitor"],)),
}


def main() -> None:
    """Measure and print."""
    print(f"time from one frame to the next, {FRAMES} frames, three nodes [ms]\n")
    print(f"{'':>20} {'nodes':>6} {'executor':>10} {'median':>8} {'10 %':>8} {'99 %':>8} {'steps/s':>8}")
    for where, place in PLACES.items():
        for loop in LOOPS:
            medians = {}
            for executor in ("events", "single"):
                steps = measured(loop, place, executor)
                medians[executor] = statistics.median(steps)
                low, high = np.percentile(steps, [10, 99])
                print(
                    f"{where:>20} {loop:>6} {executor:>10} {medians[executor]:8.2f} {low:8.2f} {high:8.2f} "
                    f"{1e3 / statistics.mean(steps):8.0f}",
                    flush=True,
                )
            print(f"{where:>20} {loop:>6} single / events: {medians['single'] / medians['events']:.1f}\n")


def measured(loop: str, place: Place, executor: str) -> Sequence[float]:
    """Return the times from one frame to the next [ms]."""
    # The harness only for its domain.
    with Harness(executor, log_level="ERROR") as ros:
        # The simulator last: from its first frame on the others must be there.
        others, leading = [], None
        for nodes in sorted(place.processes, key=lambda each: "simulator" in each):
            process = _start(loop, nodes, executor, place.before_monitor if nodes == ["monitor"] else (), ros)
            if "simulator" in nodes:
                leading = process
            else:
                others.append(process)
        assert leading is not None
        try:
            output, _ = leading.communicate(timeout=TIMEOUT)
        finally:
            for process in others:
                process.terminate()
            for process in others:
                process.communicate(timeout=TIMEOUT)
        return [float(each) for each in output.split()]


def run_some(loop: str, names: str, *argv: str) -> int:
    """Run nodes of a loop in this process; the simulator ends it after the last frame and prints its times."""
    simulators = []

    def simulator(**options: Any) -> Any:
        simulators.append(LOOPS[loop].simulator(**options))
        simulators[0].steps.done.add_done_callback(lambda _: os.kill(os.getpid(), signal.SIGTERM))
        return simulators[0]

    nodes = [simulator if name == "simulator" else getattr(LOOPS[loop], name) for name in names.split(",")]
    code = run_nodes(lambda _: nodes, node_parser("", ""), argv)
    if code == 0 and simulators:
        print(*simulators[0].steps.milliseconds())
    return code


def _start(
    loop: str, nodes: Sequence[str], executor: str, before: Sequence[str], ros: Harness
) -> subprocess.Popen[str]:
    file = LOOPS[loop].params_file
    parameters = [f"{name}:={value}" for name, value in LOOPS[loop].of_simulator.items() if "simulator" in nodes]
    parameters = [f"feature_simulator:{each}" for each in parameters]
    parameters += [f"{name}:use_sim_time:=true" for name in ("controller", "singularity_monitor")]
    return subprocess.Popen(
        [
            *before,
            *(
                sys.executable,
                "-c",
                "import sys; from benchmark.closed_loop import run_some as run; sys.exit(run(*sys.argv[1:]))",
            ),
            *(loop, ",".join(nodes), "--executor", executor, "--ros-args", "--log-level", "ERROR"),
            *([] if file is None else ["--params-file", str(file)]),
            *(each for parameter in parameters for each in ("-p", parameter)),
        ],
        env=ros.environment(),
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
