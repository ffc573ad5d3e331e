# SPDX-License-Identifier: Apache-2.0
"""By which way messages leave a process that moves a robot: not through shared memory that others may hold locked.

A subscriber on the same machine that is stopped or killed while it holds the lock of its port in Fast DDS's shared
memory holds up publish() for a second or two, and a twist that moves the robot may come after that, before the zero
twist. UDP alone does not: docs/stopping.md. Images need shared memory, for most of them are lost over UDP.
"""

from __future__ import annotations

from collections.abc import Callable, MutableMapping, Sequence
from typing import Any

TRANSPORTS, RANGE = "FASTDDS_BUILTIN_TRANSPORTS", "ROS_AUTOMATIC_DISCOVERY_RANGE"
# With any of these the user has decided.
_DECIDED = (TRANSPORTS, "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_RISK = "a stopped or killed subscriber of cmd_twist on this machine can hold up the zero twist for seconds"


def avoid_shared_memory(creates: Sequence[Callable[..., Any]], environment: MutableMapping[str, str]) -> str:
    """Set the transports of a process that moves a robot; to be called before rclpy.init.

    Args:
        creates: What makes the nodes; a node class says moves_robot and takes_images.
        environment: Of the process; changed where the user has set nothing.

    Returns:
        What of the user's settings leaves the risk, and the setting that removes it, or "".
    """
    if not any(getattr(each, "moves_robot", False) for each in creates):
        return ""
    if "fastrtps" not in environment.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp"):
        return ""
    if any(getattr(each, "takes_images", False) for each in creates):
        return f"{_RISK}, for a node with images is in the same process; run the controller in one of its own"
    localhost = environment.get(RANGE, "").upper() == "LOCALHOST" or environment.get("ROS_LOCALHOST_ONLY") == "1"
    decided = [name for name in _DECIDED if environment.get(name)]
    if localhost:
        # rmw_fastrtps adds shared memory then, whatever the transports.
        setting = RANGE if environment.get(RANGE) else "ROS_LOCALHOST_ONLY"
        return f"{_RISK}, as {setting} is {environment[setting]}; set {RANGE}=SUBNET and {TRANSPORTS}=UDPv4"
    if not decided:
        environment[TRANSPORTS] = "UDPv4"
        environment.setdefault(RANGE, "SUBNET")
        return ""
    if environment.get(TRANSPORTS) == "UDPv4":
        return ""
    return f"{_RISK}, as {decided[0]} is {environment[decided[0]]}; set {TRANSPORTS}=UDPv4 and {RANGE}=SUBNET"
