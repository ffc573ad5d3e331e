# SPDX-License-Identifier: Apache-2.0
"""Words that messages carry as numbers, and the one that monitor and gate share: the level of concern."""

from __future__ import annotations

import enum


class MessageWord(enum.IntEnum):
    """A word with the number that stands for it in messages; prints as the word."""

    def __str__(self) -> str:
        return self.name

    def __format__(self, spec: str) -> str:
        return format(self.name, spec)


class Level(MessageWord):
    """How near to a singularity the camera is; values as in plsing_msgs/SingularityStatus."""

    OK = 0
    WARN = 1
    CRITICAL = 2
    STALE = 3
    UNOBSERVABLE = 4
    DISABLED = 5
