"""Shared memory that a killed program has left behind and that would keep a node from starting.

Fast DDS receives through files /dev/shm/fastrtps_port<n>. A program that is killed in the instant it makes such a file
leaves it half made, and whoever takes that port next waits for the dead one to finish: without end and without a word,
inside the creation of a node. Fast DDS clears other leftovers away by itself, but not this one, nor does
`fastdds shm clean`.
"""

from __future__ import annotations

import time
from pathlib import Path

from rclpy.logging import get_logger

# The first word of a segment of boost::interprocess that is ready for use.
_MADE = (2).to_bytes(4, "little")

# A living program makes the file in milliseconds [s].
_SURELY_DEAD = 2.0


def clear_half_made_ports(folder: Path = Path("/dev/shm")) -> None:
    """Remove the files of Fast DDS's ports that nobody is going to finish, and log each.

    To be called before a node is made. Takes two seconds if there is a half-made file, to see whether it stays so.

    Args:
        folder: Where shared memory lies.
    """
    if suspects := _half_made(folder):
        time.sleep(_SURELY_DEAD)
        for path, _ in sorted(suspects & _half_made(folder)):
            try:
                path.unlink(missing_ok=True)
                outcome = "removed, for nodes would wait for it without end"
            except OSError as error:
                outcome = f"it cannot be removed ({error.strerror}); remove it, or nodes may wait for it without end"
            get_logger("shared_memory").warning(
                f"{path} was left half made by a program killed at its start: {outcome}"
            )


def _half_made(folder: Path) -> set[tuple[Path, int]]:
    """Return the files, with their inodes, for one that was made anew is another one."""
    found = set()
    for path in folder.glob("fastrtps_port*[0-9]"):
        try:
            if _first_word(path) != _MADE:
                found.add((path, path.stat().st_ino))
        except OSError:
            # Gone meanwhile, or for its owner alone.
            continue
    return found


def _first_word(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(len(_MADE))
