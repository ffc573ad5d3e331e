# SPDX-License-Identifier: Apache-2.0
"""Levels of concern: the word that monitor and gate share."""

from __future__ import annotations

import enum


class Level(enum.IntEnum):
    """How near to a singularity the camera is; values as in plsing_msgs/SingularityStatus."""

    OK = 0
    WARN = 1
    CRITICAL = 2
    STALE = 3
    UNOBSERVABLE = 4
    DISABLED = 5
