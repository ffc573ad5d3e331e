# SPDX-License-Identifier: Apache-2.0
"""What a node tells /diagnostics once a second."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from plsing_ros.nodes.conversions import fill_stamp
from plsing_ros.nodes.parameterized_node import ParameterizedNode

PERIOD = 1.0  # [s] of the wall clock


class Diagnostics:
    """Counts the cycles of a node and publishes rate, latency and what else the node reports."""

    def __init__(
        self, node: ParameterizedNode[Any], report: Callable[[], tuple[bytes, str, Mapping[str, str]]]
    ) -> None:
        """Publish from now on.

        Args:
            node: The node.
            report: Returns a level of diagnostic_msgs/DiagnosticStatus, a message, and values by name.
        """
        self._node, self._report = node, report
        self._cycles, self._latency, self._since = 0, 0.0, time.monotonic()
        # The absolute name that diagnostic tools listen to; it can still be remapped.
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_steady_timer(PERIOD, self._publish, also_inactive=True)

    def count(self, stamp: int) -> None:
        """Count a cycle that answered input of that stamp [ns]."""
        self._cycles += 1
        self._latency = max(self._latency, (self._node.now() - stamp) * 1e-9)

    def _publish(self) -> None:
        now = time.monotonic()
        rate = self._cycles / (now - self._since)
        if self._node.active:
            level, message, values = self._report()
        else:
            level, message, values = DiagnosticStatus.STALE, self._node.state_label, {}
        shown = {"rate [Hz]": f"{rate:.1f}", "largest latency [s]": f"{self._latency:.4f}", **values}
        self._cycles, self._latency, self._since = 0, 0.0, now
        status = DiagnosticStatus(
            level=level,
            name=f"{self._node.get_fully_qualified_name()[1:]}: state",
            message=message,
            hardware_id="none",
            values=[KeyValue(key=key, value=value) for key, value in shown.items()],
        )
        array = DiagnosticArray(status=[status])
        fill_stamp(array.header.stamp, self._node.now())
        self._publisher.publish(array)
