# SPDX-License-Identifier: Apache-2.0
"""Quality of service of the topics; every endpoint's can be overridden by parameters (qos_overrides.<topic>...)."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.qos_overriding_options import QoSOverridingOptions

SENSOR_DATA = qos_profile_sensor_data
COMMAND = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
# Who listens takes the latest one only: an acknowledgement of each would delay the next.
COMMAND_INPUT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
STATUS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# As tf2_ros has it.
TRANSFORMS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def overridable() -> QoSOverridingOptions:
    """Return the options that let parameters override history, depth and reliability of an endpoint."""
    return QoSOverridingOptions.with_default_policies()
