# SPDX-License-Identifier: Apache-2.0
"""The parameter that every managed node has beside those of its own set."""

from __future__ import annotations

from plsing_ros.parameters.parameter_set import Specification

AUTOSTART = Specification(
    "autostart",
    "Whether the node configures and activates itself; false: it waits for the transitions of a lifecycle manager",
    live=False,
)
AUTOSTART_DEFAULT = True
