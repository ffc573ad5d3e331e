"""The closed loop over DDS: simulator, controller and monitor in lockstep, on each executor in the same run."""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.experiments import near_transversal as experiment
from plsing_ros.experiments.config_files import config_file
from plsing_ros.nodes.controller import Controller
from plsing_ros.nodes.feature_simulator import FeatureSimulator
from plsing_ros.nodes.harness import Harness
from plsing_ros.nodes.run import run_node
from plsing_ros.nodes.singularity_monitor import SingularityMonitor

FRAMES, FIRST_FRAMES = 1000, 50  # the first ones are not counted
TIMEOUT = 120.0  # [s]
ROOT = Path(__file__).parents[1]
PARAMETERS = config_file("paper_p4l.yaml")
IN_LOCKSTEP = {"mode": "lockstep", "publish_clock": True, "start.position": experiment.STARTS[0].position.tolist()}
APART = "in three processes"
TOGETHER = "in one process"


class TimedSimulator(FeatureSimulator):
    """Notes when it makes a step; stops its process after the last one."""

    def __init__(self, **options: Any) -> None:
        self.times: list[float] = []
        self.ends_process = False
        super().__init__(**options)

    def _advance_in_lockstep(self) -> None:
        before = self._simulation.frame().step
        super()._advance_in_lockstep()
        if self._simulation.frame().step != before:
            self.times.append(time.perf_counter())
            if self.ends_process and self.is_done:
                os.kill(os.getpid(), signal.SIGTERM)

    @property
    def is_done(self) -> bool:
        """Whether there are enough frames."""
        return len(self.times) > FIRST_FRAMES + FRAMES

    def milliseconds(self) -> list[float]:
        """Return the times from one frame to the next [ms]."""
        return (1e3 * np.diff(self.times[FIRST_FRAMES:])).tolist()


class ReportingSimulator(TimedSimulator):
    """Writes its times to standard output in the end."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.ends_process = True

    def stop(self) -> None:
        """Write them."""
        print(*self.milliseconds(), flush=True)


def run_reporting_simulator() -> int:
    """Run the node."""
    return run_node(ReportingSimulator, "simulator that reports its times", "")


def main() -> None:
    """Measure and print."""
    print(f"time from one frame to the next, {FRAMES} frames of Start 1, three nodes [ms]\n")
    print(f"{'':>20} {'executor':>10} {'median':>8} {'10 %':>8} {'99 %':>8} {'steps/s':>8}")
    for where, measured in ((APART, _apart), (TOGETHER, _together)):
        medians = {}
        for executor in ("events", "single"):
            steps = measured(executor)
            medians[executor] = statistics.median(steps)
            low, high = np.percentile(steps, [10, 99])
            print(
                f"{where:>20} {executor:>10} {medians[executor]:8.2f} {low:8.2f} {high:8.2f} "
                f"{1e3 / medians[executor]:8.0f}",
                flush=True,
            )
        print(f"{where:>20} single / events: {medians['single'] / medians['events']:.1f}\n")


def _together(executor: str) -> Sequence[float]:
    with Harness(executor, log_level="ERROR") as ros:
        for node in (SingularityMonitor, Controller):
            ros.add(node, PARAMETERS, {"use_sim_time": True})
        simulator = ros.add(TimedSimulator, PARAMETERS, IN_LOCKSTEP)
        ros.spin_until(lambda: simulator.is_done, "all frames", TIMEOUT)
        return simulator.milliseconds()


def _apart(executor: str) -> Sequence[float]:
    # The harness only for its domain.
    with Harness(executor, log_level="ERROR") as ros:
        environment = ros.environment()
        others = [
            _process(f"plsing_ros.nodes.{name}", "main", executor, {"use_sim_time": True}, environment)
            for name in ("controller", "singularity_monitor")
        ]
        try:
            simulator = _process("benchmark.closed_loop", "run_reporting_simulator", executor, IN_LOCKSTEP, environment)
            output, _ = simulator.communicate(timeout=TIMEOUT)
        finally:
            for process in others:
                process.terminate()
            for process in others:
                process.communicate(timeout=TIMEOUT)
        return [float(each) for each in output.split()]


def _process(
    module: str, function: str, executor: str, parameters: dict[str, Any], environment: dict[str, str]
) -> subprocess.Popen[str]:
    given = [each for name, value in parameters.items() for each in ("-p", f"{name}:={value}")]
    return subprocess.Popen(
        [
            *(sys.executable, "-c", f"from {module} import {function}; raise SystemExit({function}())"),
            *("--executor", executor, "--ros-args", "--log-level", "ERROR", "--params-file", str(PARAMETERS), *given),
        ],
        env=environment,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
