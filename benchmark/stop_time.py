# SPDX-License-Identifier: Apache-2.0
"""How late the zero twist comes when the features stop because their publisher, who listens to cmd_twist, is stopped.

The controller and a simulator in real time run as processes of their own. The simulator is stopped (SIGSTOP) at random
times and goes on after two seconds, or just while it holds a lock in Fast DDS' shared memory, or is killed (SIGKILL)
and started again; this process listens. With the controller's own transports, and with shared memory as Fast DDS uses
it by default.

    python3 -m benchmark stop_time
    python3 -m benchmark stop_time --quick
    python3 -m benchmark.stop_time --cases stopped killed --times 60
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import rclpy
from geometry_msgs.msg import TwistStamped

from benchmark.lock_holder import mapped_segments, stop_in_lock
from plsing_msgs.msg import LineFeatureArray
from plsing_ros.nodes import qos
from plsing_ros.nodes.transports import RANGE, TRANSPORTS
from plsing_ros.parameters.config_files import config_file
from plsing_ros.testing.node_processes import NodeProcesses

_STOPPED = 2.0  # [s]
_PAUSE = 0.004  # at most, between two tries to stop a process just while it holds a lock [s]
_PATIENCE = 180.0  # [s]
_SEED = 1


def main(quick: bool = False) -> None:
    """Print how late zero twists were."""
    print_table(tuple(CASES), 5 if quick else None, _SEED)


def print_table(names: Sequence[str], times: int | None, seed: int) -> None:
    """Print how late zero twists were in some cases, with so many stops each or as many as it has."""
    print(
        "| transports of the controller | the simulator is | times | zero twist after the last feature [ms]: median / "
        "most | later than 350 ms | moving twists after the zero | shared memory of Fast DDS in the controller |"
    )
    print("|---|---|---|---|---|---|---|")
    for case in (CASES[name] for name in names):
        late, moving, mapped = measure(case, times or case.times, seed)
        late.sort()
        print(
            f"| {case.transports} | {case.how} | {len(late)} | {1e3 * late[len(late) // 2]:.0f} / "
            f"{1e3 * late[-1]:.0f} | {sum(each > 0.35 for each in late)} | {moving} | {mapped} segments |",
            flush=True,
        )


def _nice(process: int) -> None:
    os.setpriority(os.PRIO_PROCESS, process, -10)


def _fifo(process: int) -> None:
    os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(50))


class Interruption(NamedTuple):
    """What is done.

    Attributes:
        transports: Of the controller, and its priority, for the table.
        how: What becomes of the simulator: STOPPED, IN_LOCK or KILLED.
        times: How often.
        settings: Environment of the controller.
        priority: What to do with each thread of the controller; it needs the right to it.
    """

    transports: str
    how: str
    times: int
    settings: Mapping[str, str] = {}
    priority: Callable[[int], None] | None = None


STOPPED, IN_LOCK, KILLED = "stopped", "stopped while it holds a lock", "killed"
_SHARED_MEMORY = {TRANSPORTS: "DEFAULT"}
CASES = {
    "stopped": Interruption("its own (UDP)", STOPPED, 200),
    "in-lock": Interruption("its own (UDP)", IN_LOCK, 40),
    "killed": Interruption("its own (UDP)", KILLED, 40),
    "nice": Interruption("its own (UDP), nice -n -10", STOPPED, 40, priority=_nice),
    "fifo": Interruption("its own (UDP), chrt --fifo 50", STOPPED, 40, priority=_fifo),
    "shared-memory": Interruption("shared memory", STOPPED, 60, _SHARED_MEMORY),
    "shared-memory-in-lock": Interruption("shared memory", IN_LOCK, 20, _SHARED_MEMORY),
}


def measure(case: Interruption, times: int, seed: int) -> tuple[list[float], int, int]:
    """Return how late each zero twist was [s], how many moving twists came after one, and shared memory segments.

    Args:
        case: What is done.
        times: How often.
        seed: Of the times when.
    """
    base = {key: value for key, value in os.environ.items() if key not in (TRANSPORTS, RANGE, "ROS_LOCALHOST_ONLY")}
    base["ROS_DOMAIN_ID"] = os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randrange(60, 100))
    os.environ.update({TRANSPORTS: "UDPv4", RANGE: "SUBNET"})
    chance = random.Random(seed)
    late: list[float] = []
    moving_after = 0
    with NodeProcesses(base) as processes, _Ears() as ears:
        file = config_file("paper_p4l.yaml")
        simulator = processes.start("feature_simulator", [file], {"mode": "realtime"})
        limits = {"features_timeout": 0.2, "gain": 0.02}
        controller = processes.start("controller", [file], limits, settings=dict(case.settings))
        if case.how == IN_LOCK:
            # Somebody whom the simulator sends features through shared memory.
            processes.start("singularity_monitor", [file], {})
        for number in range(times):
            ears.wait_until_moving()
            if number == 0 and case.priority is not None:
                for thread in Path(f"/proc/{controller.pid}/task").iterdir():
                    case.priority(int(thread.name))
            ears.listen(chance.uniform(0.0, 1.0))
            ears.twists.clear()
            if case.how == IN_LOCK:
                stop_in_lock(simulator, lambda: ears.listen(chance.uniform(0.0, _PAUSE)))
            else:
                simulator.send_signal(signal.SIGKILL if case.how == KILLED else signal.SIGSTOP)
            stopped = time.monotonic()
            ears.listen(_STOPPED)
            last = max(ears.last_feature, stopped - 1.0)
            zeros = [when for when, moves in ears.twists if not moves and when > last]
            late.append((zeros[0] if zeros else time.monotonic()) - last)
            if zeros:
                moving_after += sum(moves and when > zeros[0] for when, moves in ears.twists)
            if case.how == KILLED:
                simulator.wait()
                simulator = processes.start("feature_simulator", [file], {"mode": "realtime"})
            else:
                simulator.send_signal(signal.SIGCONT)
        mapped = len(mapped_segments(controller.pid))
    return late, moving_after, mapped


class _Ears:
    """Listens to features and twists, and remembers when they came."""

    def __enter__(self) -> _Ears:
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("ears", context=self._context)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.twists: list[tuple[float, bool]] = []
        self.last_feature = 0.0
        self._node.create_subscription(TwistStamped, "cmd_twist", self._on_twist, qos.COMMAND_INPUT)
        self._node.create_subscription(LineFeatureArray, "line_features", self._on_features, qos.SENSOR_DATA)
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def listen(self, seconds: float) -> None:
        """Listen for a while."""
        end = time.monotonic() + seconds
        while (rest := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=rest)

    def wait_until_moving(self) -> None:
        """Listen until features come and a twist moves the camera."""
        self.twists.clear()
        self.last_feature = 0.0
        end = time.monotonic() + _PATIENCE
        while not (self.last_feature and any(moves for _, moves in self.twists)):
            self._executor.spin_once(timeout_sec=0.1)
            if time.monotonic() > end:
                raise TimeoutError(f"no twist that moves in {_PATIENCE} s")

    def _on_twist(self, message: TwistStamped) -> None:
        v, w = message.twist.linear, message.twist.angular
        self.twists.append((time.monotonic(), any((v.x, v.y, v.z, w.x, w.y, w.z))))

    def _on_features(self, _: LineFeatureArray) -> None:
        self.last_feature = time.monotonic()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=tuple(CASES))
    parser.add_argument("--times", type=int, help="stops in each case (default: as many as each has)")
    parser.add_argument("--seed", type=int, default=_SEED)
    options = parser.parse_args()
    print_table(options.cases, options.times, options.seed)
