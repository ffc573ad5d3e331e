# SPDX-License-Identifier: Apache-2.0
"""Resident memory of every node of the loop over very many cycles, in processes of their own: does it grow?

Simulator (image lines only, with noise), pose_estimator, controller and monitor in lockstep, at a gain at which the
camera moves all the time.

    python3 -m benchmark node_memory
    python3 -m benchmark.node_memory --cycles 1000000
"""

from __future__ import annotations

import argparse
import time

from rosgraph_msgs.msg import Clock

from benchmark.memory import resident
from plsing_ros.nodes import qos
from plsing_ros.parameters.config_files import config_file
from plsing_ros.testing.harness import Harness
from plsing_ros.testing.node_processes import NodeProcesses

CYCLES = 100_000
NODES = ("feature_simulator", "pose_estimator", "controller", "singularity_monitor")
_LAW, _NOISE, _GAIN = "fused", 5e-4, 1e-4
_SAMPLES = 10
_STEP = 0.04  # [s]
_COMPLETED = {"line_features": "completed_line_features"}
_PATIENCE = 60.0  # [s]


def main(quick: bool = False) -> None:
    """Print the table."""
    measure(CYCLES // 50 if quick else CYCLES)


def measure(cycles: int) -> None:
    """Print resident memory after each tenth of the cycles."""
    file = config_file("paper_p4l.yaml")
    lockstep = {"mode": "lockstep", "publish_clock": True, "image_only": True, "noise": _NOISE, "noise_on": "image"}
    own = {"feature_simulator": lockstep, "controller": {"law": _LAW, "gain": _GAIN}}
    # The harness for its domain, and to read the clock.
    with Harness(log_level="ERROR") as ros, NodeProcesses(ros.environment()) as processes:
        pids = {}
        # The simulator last: from its first frame on the others must be there.
        for node in reversed(NODES):
            remap = _COMPLETED if node in ("controller", "singularity_monitor") else None
            simulated = {} if node == "feature_simulator" else {"use_sim_time": True}
            pids[node] = processes.start(node, [file], {**own.get(node, {}), **simulated}, remap).pid
        print(f"| cycles | {' [MB] | '.join(NODES)} [MB] |\n|---|{'---|' * len(NODES)}")
        first = _simulated_seconds(ros)
        for sample in range(1, _SAMPLES + 1):
            due = first + _STEP * cycles * sample / _SAMPLES
            while (now := _simulated_seconds(ros)) < due:
                processes.check()
                time.sleep(1.0)
            sizes = " | ".join(f"{resident(pids[node]):.1f}" for node in NODES)
            print(f"| {round((now - first) / _STEP)} | {sizes} |", flush=True)


def _simulated_seconds(ros: Harness) -> float:
    """Return the simulated time; nobody listens to it between two calls."""
    received: list[Clock] = []
    subscription = ros.node.create_subscription(Clock, "/clock", received.append, qos.CLOCK)
    try:
        ros.spin_until(lambda: received, "a simulated time", _PATIENCE)
    finally:
        ros.node.destroy_subscription(subscription)
    return received[-1].clock.sec + 1e-9 * received[-1].clock.nanosec


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=CYCLES)
    measure(parser.parse_args().cycles)
