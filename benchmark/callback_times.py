# SPDX-License-Identifier: Apache-2.0
"""How long the controller's callback takes, features in to twist published, by every law beside a bare rclpy node.

Controller and simulator in lockstep, in a process each, with the controller's own transports (UDP), and the plain law
and the bare node with shared memory as well: what the setting costs a round trip. Loci are computed before the first
frame; detour plans in the run.

    python3 -m benchmark callback_times
    python3 -m benchmark callback_times --quick
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmark.closed_loop import IN_LOCKSTEP, PARAMETERS, ROOT, TIMEOUT
from benchmark.rclpy_baseline import BareController
from benchmark.step_times import FIRST_FRAMES, FRAMES
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.main import node_parser, run_nodes
from plsing_ros.nodes.transports import RANGE, TRANSPORTS
from plsing_ros.testing.harness import Harness

LAWS = ("pinv", "dls", "adaptive_dls", "guarded", "detour", "position", "fused")
BARE = "bare"
_UDP = {TRANSPORTS: "UDPv4", RANGE: "SUBNET"}
_SHARED_MEMORY = {TRANSPORTS: "DEFAULT", RANGE: "SUBNET"}


def main(quick: bool = False) -> None:
    """Measure and print."""
    print(f"{FRAMES} frames each [ms]\n")
    print(
        "| controller | transports | callback: median | 99 % | 99.9 % | most | frame to frame: median | 99 % |\n"
        "|---|---|---|---|---|---|---|---|"
    )
    for law in (BARE, "pinv", "fused") if quick else (BARE, *LAWS):
        for name, settings in (("UDP", _UDP), ("shared memory", _SHARED_MEMORY)):
            if settings is _SHARED_MEMORY and law not in (BARE, "pinv"):
                continue
            callbacks, frames = measure(law, settings)
            parts = [*np.quantile(callbacks, (0.5, 0.99, 0.999, 1.0)), *np.quantile(frames, (0.5, 0.99))]
            print(f"| {law} | {name} | {' | '.join(f'{each:.2f}' for each in parts)} |", flush=True)


def measure(law: str, settings: dict[str, str]) -> tuple[np.ndarray, np.ndarray]:
    """Return how long each callback took, and the times from frame to frame [ms].

    Args:
        law: Of the controller, or BARE.
        settings: Environment of the processes.
    """
    # The harness only for its domain.
    with Harness("events", log_level="ERROR") as ros:
        environment = {**ros.environment(), **settings}
        controller = _start("callback_times", (law,), ["controller:use_sim_time:=true", *_law(law)], environment)
        simulator = _start(
            "closed_loop",
            ("bare" if law == BARE else "ours", "simulator"),
            [] if law == BARE else [f"feature_simulator:{name}:={value}" for name, value in IN_LOCKSTEP.items()],
            environment,
        )
        try:
            frames, _ = simulator.communicate(timeout=TIMEOUT)
        finally:
            controller.terminate()
            simulator.kill()
            callbacks, _ = controller.communicate(timeout=TIMEOUT)
    return np.array(callbacks.split()[FIRST_FRAMES:], dtype=float), np.array(frames.split(), dtype=float)


def run_some(law: str, *argv: str) -> int:
    """Run the controller in this process until it is told to end, and print how long its callbacks took [ms]."""
    times: list[float] = []

    def timed(of: type[Any]) -> type[Any]:
        class Timed(of):  # type: ignore[misc]
            def _on_features(self, message: Any) -> None:
                before = time.perf_counter()
                super()._on_features(message)
                times.append(1e3 * (time.perf_counter() - before))

        return Timed

    code = run_nodes(lambda _: [timed(BareController if law == BARE else ControllerNode)], node_parser("", ""), argv)
    print(*times)
    return code


def _law(law: str) -> list[str]:
    return [] if law == BARE else [f"controller:law:={law}"]


def _start(
    module: str, names: Sequence[str], parameters: Sequence[str], environment: dict[str, str]
) -> subprocess.Popen[str]:
    file = [] if BARE in names else ["--params-file", str(PARAMETERS)]
    return subprocess.Popen(
        [
            *(sys.executable, "-c", f"import sys; from benchmark.{module} import run_some as run; run(*sys.argv[1:])"),
            *(*names, "--ros-args", "--log-level", "ERROR", *file),
            *(each for parameter in parameters for each in ("-p", parameter)),
        ],
        env=environment,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
