# SPDX-License-Identifier: Apache-2.0
"""How late the zero twist comes when the features stop because their publisher, who listens to cmd_twist, is stopped.

The controller and a simulator in real time run as processes of their own. The simulator is stopped (SIGSTOP) at random
times and goes on after two seconds, or is killed (SIGKILL) and started again; this process listens. With the
controller's own transports, and with shared memory as Fast DDS uses it by default. A process that has mapped none of
Fast DDS' shared memory cannot be held up by a lock in it, whenever another one is stopped or killed.

    python3 -m benchmark stop_time
    python3 -m benchmark stop_time --quick
"""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from geometry_msgs.msg import TwistStamped

from plsing_msgs.msg import LineFeatureArray
from plsing_ros.nodes import qos
from plsing_ros.nodes.transports import RANGE, TRANSPORTS
from plsing_ros.parameters.config_files import config_file
from plsing_ros.testing.node_processes import NodeProcesses

_STOPPED = 2.0  # [s]
_PATIENCE = 180.0  # [s]
_SEED = 1


def main(quick: bool = False) -> None:
    """Print how late zero twists were."""
    print(
        "| transports of the controller | the simulator is | times | zero twist after the last feature [ms]: median / "
        "most | later than 350 ms | moving twists after the zero | shared memory of Fast DDS in the controller |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, settings, kills, times, priority in (
        ("its own (UDP)", {}, False, 200, None),
        ("its own (UDP)", {}, True, 40, None),
        ("its own (UDP), nice -n -10", {}, False, 40, _nice),
        ("its own (UDP), chrt --fifo 50", {}, False, 40, _fifo),
        ("shared memory", {TRANSPORTS: "DEFAULT"}, False, 60, None),
    ):
        late, moving, mapped = measure(times // 20 if quick else times, settings, kills, priority)
        late.sort()
        print(
            f"| {name} | {'killed' if kills else 'stopped'} | {len(late)} | {1e3 * late[len(late) // 2]:.0f} / "
            f"{1e3 * late[-1]:.0f} | {sum(each > 0.35 for each in late)} | {moving} | {mapped} segments |",
            flush=True,
        )


def _nice(process: int) -> None:
    os.setpriority(os.PRIO_PROCESS, process, -10)


def _fifo(process: int) -> None:
    os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(50))


def measure(
    times: int, settings: dict[str, str], kills: bool = False, priority: Callable[[int], None] | None = None
) -> tuple[list[float], int, int]:
    """Return how late each zero twist was [s], how many moving twists came after one, and shared memory segments.

    Args:
        times: How often to stop the simulator.
        settings: Environment of the controller.
        kills: Whether the simulator is killed and started anew, and not stopped for a while.
        priority: What to do with the threads of the controller, by their ids; it needs the right to it.
    """
    base = {key: value for key, value in os.environ.items() if key not in (TRANSPORTS, RANGE, "ROS_LOCALHOST_ONLY")}
    base["ROS_DOMAIN_ID"] = os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randrange(60, 100))
    os.environ.update({TRANSPORTS: "UDPv4", RANGE: "SUBNET"})
    chance = random.Random(_SEED)
    late: list[float] = []
    moving_after = 0
    with NodeProcesses(base) as processes, _Ears() as ears:
        file = config_file("paper_p4l.yaml")
        simulator = processes.start("feature_simulator", [file], {"mode": "realtime"})
        limits = {"features_timeout": 0.2, "gain": 0.02}
        controller = processes.start("controller", [file], limits, settings=settings)
        for number in range(times):
            ears.wait_until_moving()
            if number == 0 and priority is not None:
                for thread in Path(f"/proc/{controller.pid}/task").iterdir():
                    priority(int(thread.name))
            ears.listen(chance.uniform(0.0, 1.0))
            ears.twists.clear()
            simulator.send_signal(signal.SIGKILL if kills else signal.SIGSTOP)
            stopped = time.monotonic()
            ears.listen(_STOPPED)
            last = max(ears.last_feature, stopped - 1.0)
            zeros = [when for when, moves in ears.twists if not moves and when > last]
            late.append((zeros[0] if zeros else time.monotonic()) - last)
            if zeros:
                moving_after += sum(moves and when > zeros[0] for when, moves in ears.twists)
            if kills:
                simulator.wait()
                simulator = processes.start("feature_simulator", [file], {"mode": "realtime"})
            else:
                simulator.send_signal(signal.SIGCONT)
        mapped = {line.split()[-1] for line in Path(f"/proc/{controller.pid}/maps").read_text().splitlines()}
    return late, moving_after, sum(each.startswith("/dev/shm/fast") for each in mapped)


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
