# SPDX-License-Identifier: Apache-2.0
"""A harness to test nodes with plain rclpy, in one process and one thread, without launch.

    with Harness() as ros:
        controller = ros.add(Controller, params_file="config/paper_p4l.yaml", parameters={"gain": 0.5})
        twists = ros.collect(TwistStamped, "cmd_twist")
        features = ros.publisher(LineFeatureArray, "line_features")
        features.publish(message)
        ros.spin_until(lambda: twists, "a twist for the features")

Each harness has a ROS domain and a context of its own, so that tests do not hear each other, also when they run in
parallel. Nothing runs but inside spin_until and spin_for, in the calling thread: between two calls the world stands
still. docs/howto/testing.md shows how to test your own nodes with it.
"""

from __future__ import annotations

import os
import textwrap
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from plsing_ros.errors import PlsingError
from plsing_ros.nodes import qos
from plsing_ros.nodes.main import make_executor
from plsing_ros.nodes.shared_memory import clear_half_made_ports

_N = TypeVar("_N", bound=Node)

TIMEOUT = 10.0

# Characters of a message that are shown when something else was waited for.
_SHOWN = 600


class HarnessTimeoutError(PlsingError, AssertionError):
    """What was waited for did not happen; the message says what was received instead."""


class Collected(list[Any]):
    """Messages of one topic, in order of arrival."""

    def __init__(self, topic: str) -> None:
        super().__init__()
        self.topic = topic

    def __repr__(self) -> str:
        if not self:
            return f"{self.topic}: nothing"
        return f"{self.topic}: {len(self)} message(s), the last: {textwrap.shorten(str(self[-1]), _SHOWN)}"


class Harness:
    """A ROS domain, context and executor for one test.

    Attributes:
        domain: The reserved domain's id.
        context: The rclpy context.
    """

    def __init__(self, executor: str = "events", log_level: str = "INFO") -> None:
        """Reserve a domain and create a context.

        Args:
            executor: As in plsing_ros.nodes.main.make_executor.
            log_level: From which severity on the nodes log, as for --log-level; the first harness of a process decides.

        Raises:
            RuntimeError: If all hundred domains are reserved by others on this machine.
        """
        # Loopback only: a test or demo must not reach the robot next door.
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        self._reservation = ExitStack()
        self.domain = self._reservation.enter_context(domain_id())
        self.context = Context()
        rclpy.init(args=["--ros-args", "--log-level", log_level], context=self.context, domain_id=self.domain)
        clear_half_made_ports(self.domain)
        self._executor = make_executor(executor, self.context)
        self._nodes: list[Node] = []
        self._collected: list[Collected] = []
        self.node = self.add(Node, node_name="harness")

    def __enter__(self) -> Harness:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Destroy all nodes and release the domain."""
        for node in self._nodes:
            self._executor.remove_node(node)
            node.destroy_node()
        self._nodes.clear()
        self._executor.shutdown()
        rclpy.shutdown(context=self.context)
        self._reservation.close()

    def add(
        self,
        create: Callable[..., _N],
        params_file: str | Path | None = None,
        parameters: Mapping[str, Any] | None = None,
        remap: Mapping[str, str] | None = None,
        **options: Any,
    ) -> _N:
        """Create a node in the harness and let it spin.

        Args:
            create: Class of the node; takes the keyword arguments of rclpy.node.Node.
            params_file: ROS parameter file.
            parameters: Values by name, over those of the file.
            remap: New names of topics and services by their old ones.
            options: Further keyword arguments, such as namespace.
        """
        arguments = [] if params_file is None else ["--params-file", str(params_file)]
        for old, new in (remap or {}).items():
            arguments += ["-r", f"{old}:={new}"]
        node = create(
            context=self.context,
            use_global_arguments=False,
            cli_args=["--ros-args", *arguments],
            parameter_overrides=[Parameter(name, value=value) for name, value in (parameters or {}).items()],
            **options,
        )
        self._nodes.append(node)
        self._executor.add_node(node)
        return node

    def remove(self, node: Node) -> None:
        """Destroy a node, as if its process had ended."""
        self._executor.remove_node(node)
        self._nodes.remove(node)
        # Events that an EventsExecutor has queued already still call back, and must find the node alive.
        self.spin_for(0.02)
        node.destroy_node()

    def collect(self, message_type: type, topic: str, profile: QoSProfile = qos.SENSOR_DATA) -> Collected:
        """Subscribe to a topic and return the list that its messages are appended to while the harness spins."""
        collected = Collected(topic)
        self._collected.append(collected)
        self.node.create_subscription(message_type, topic, collected.append, profile)
        return collected

    def publisher(self, message_type: type, topic: str, profile: QoSProfile = qos.STATUS) -> Publisher:
        """Create a publisher and wait until it has a subscriber."""
        publisher = self.node.create_publisher(message_type, topic, profile)
        self.spin_until(lambda: publisher.get_subscription_count() > 0, f"a subscriber to {topic}")
        return publisher

    def call(self, service_type: type, name: str, request: Any, timeout: float = TIMEOUT) -> Any:
        """Call a service and return its response."""
        client = self.node.create_client(service_type, name)
        if not client.service_is_ready():
            self.spin_until(client.service_is_ready, f"service {name}", timeout)
            # A server learns of its client a moment after the client of it; an answer before that would be lost.
            self.spin_for(0.2)
        future = client.call_async(request)
        self.spin_until(future.done, f"an answer of service {name}", timeout)
        return future.result()

    def spin_until(self, condition: Callable[[], Any], what: str, timeout: float = TIMEOUT) -> None:
        """Spin until a condition holds.

        Args:
            condition: Asked after every event.
            what: What is waited for, for the message.
            timeout: Wall clock time to wait [s].

        Raises:
            HarnessTimeoutError: With everything that was received meanwhile.
        """
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                received = "\n  ".join(map(repr, self._collected)) or "nothing was collected"
                raise HarnessTimeoutError(f"waited {timeout:g} s in vain for {what}. Received:\n  {received}")
            self._executor.spin_once(timeout_sec=0.02)

    def spin_for(self, duration: float) -> None:
        """Spin for a wall clock time [s], to see that something does not happen."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=min(left, 0.02))

    def environment(self) -> dict[str, str]:
        """Return the environment variables for a process that shall be in the harness's domain."""
        return {**os.environ, "ROS_DOMAIN_ID": str(self.domain)}
