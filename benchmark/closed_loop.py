"""The closed loop over DDS: simulator, controller and monitor in lockstep, on each executor in the same run."""

from __future__ import annotations

import contextlib
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from plsing_ros.experiments import near_transversal as experiment
from plsing_ros.experiments.config_files import config_file
from plsing_ros.nodes.controller import Controller
from plsing_ros.nodes.feature_simulator import FeatureSimulator
from plsing_ros.nodes.harness import Harness
from plsing_ros.nodes.singularity_monitor import SingularityMonitor

FRAMES, FIRST_FRAMES = 1000, 50  # the first ones are not counted
TIMEOUT = 60.0  # [s]
PARAMETERS = config_file("paper_p4l.yaml")


class TimedSimulator(FeatureSimulator):
    """Notes when it publishes a frame for the first time."""

    def __init__(self, **options: Any) -> None:
        self.times: list[float] = []
        super().__init__(**options)

    def _advance_in_lockstep(self) -> None:
        before = self._simulation.frame().step
        super()._advance_in_lockstep()
        if self._simulation.frame().step != before:
            self.times.append(time.perf_counter())


def main() -> None:
    """Measure and print."""
    print(f"time from one frame to the next, {FRAMES} frames of Start 1 [ms]\n")
    print(f"{'nodes':>30} {'executor':>10} {'median':>8} {'99 %':>8} {'steps/s':>8} {'CPU':>6}")
    medians = {}
    for apart, nodes in ((False, "in one process"), (True, "in three processes")):
        for executor in ("events", "single"):
            steps, busy = _measured(executor, apart)
            medians[apart, executor] = statistics.median(steps)
            print(
                f"{nodes:>30} {executor:>10} {medians[apart, executor]:8.2f} {np.percentile(steps, 99):8.2f} "
                f"{1e3 / medians[apart, executor]:8.0f} {busy:6.2f}",
                flush=True,
            )
    for apart, nodes in ((False, "in one process"), (True, "in three processes")):
        print(f"\nsingle / events {nodes}: {medians[apart, 'single'] / medians[apart, 'events']:.1f}", end="")
    print("\nCPU: of the simulator's process, ms for each step, all its threads")


def _measured(executor: str, apart: bool) -> tuple[Sequence[float], float]:
    """Return the times of all steps, and the processor time of this process for each [ms]."""
    with Harness(executor, log_level="ERROR") as ros, _others(ros, executor, apart):
        simulator = ros.add(
            TimedSimulator,
            PARAMETERS,
            {
                "mode": "lockstep",
                "publish_clock": True,
                "start.position": experiment.STARTS[0].position.tolist(),
            },
        )
        ros.spin_until(lambda: len(simulator.times) >= FIRST_FRAMES, "the first frames", TIMEOUT)
        del simulator.times[:-1]
        before = time.process_time()
        ros.spin_until(lambda: len(simulator.times) > FRAMES, "all frames", TIMEOUT)
        return 1e3 * np.diff(simulator.times), 1e3 * (time.process_time() - before) / FRAMES


@contextlib.contextmanager
def _others(ros: Harness, executor: str, apart: bool) -> Iterator[None]:
    """Run controller and monitor, in this process or in two of their own."""
    if not apart:
        for node in (SingularityMonitor, Controller):
            ros.add(node, PARAMETERS, {"use_sim_time": True})
        yield
        return
    processes = [
        subprocess.Popen(
            [
                *(sys.executable, "-c", f"from plsing_ros.nodes.{name} import main; raise SystemExit(main())"),
                *("--executor", executor, "--ros-args", "--params-file", str(PARAMETERS), "-p", "use_sim_time:=true"),
                *("--log-level", "ERROR"),
            ],
            env=ros.environment(),
        )
        for name in ("controller", "singularity_monitor")
    ]
    try:
        yield
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait(timeout=TIMEOUT)
