"""The closed loop over DDS: simulator, controller and monitor in lockstep, on each executor in the same run."""

from __future__ import annotations

import statistics
import time

import numpy as np

from plsing_ros.experiments import near_transversal as experiment
from plsing_ros.experiments.config_files import config_file
from plsing_ros.nodes.closed_loop import run_closed_loop

FRAMES = 500


def main() -> None:
    """Measure and print."""
    print(f"one step of the loop, {FRAMES} frames of Start 1, three nodes and a recorder in one process [ms]\n")
    print(f"{'executor':>10} {'median':>8} {'99 %':>8} {'steps/s':>8}")
    medians = {}
    for executor in ("events", "single"):
        times: list[float] = []
        run_closed_loop(
            executor,
            config_file("paper_p4l.yaml"),
            start={"start.position": experiment.STARTS[0].position.tolist()},
            target={},
            arrived=experiment.ARRIVED,
            most_steps=FRAMES,
            on_frame=lambda number, distance: times.append(time.perf_counter()),
            executor=executor,
        )
        steps = 1e3 * np.diff(times)
        medians[executor] = statistics.median(steps)
        print(f"{executor:>10} {medians[executor]:8.2f} {np.percentile(steps, 99):8.2f} {1e3 / medians[executor]:8.0f}")
    print(f"\nsingle / events: {medians['single'] / medians['events']:.1f}")
