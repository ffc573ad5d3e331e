# SPDX-License-Identifier: Apache-2.0
"""How often a zero twist is said before falling silent."""

from __future__ import annotations

from plsing_ros.control.command import Command, Mode


class HaltMessages:
    """Counts zero twists in a row, so that others may command the robot while this controller stands still."""

    def __init__(self) -> None:
        self._count = 0

    def to_be_published(self, command: Command, most: int) -> bool:
        """Return whether a command's twist is to be published.

        Args:
            command: What the controller decided.
            most: Zero twists in a row before silence; negative: no end.
        """
        # Without a single usable message nobody has asked this controller to move anything, not even to stop it.
        if command.mode is Mode.WAITING:
            return False
        if command.mode.moves:
            self._count = 0
            return True
        self._count += 1
        return most < 0 or self._count <= most
