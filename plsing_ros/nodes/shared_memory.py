# SPDX-License-Identifier: Apache-2.0
"""Shared memory that a killed program has left behind and that would keep a node from starting.

Fast DDS receives through files /dev/shm/fastrtps_port<n>. A program that is killed in the instant it makes such a file
leaves it half made, and whoever takes that port next waits for the dead one to finish: without end and without a word,
inside the creation of a node. Fast DDS clears other leftovers away by itself, but not this one, nor does
`fastdds shm clean`. A file is removed here only if the kernel says that no process has it open.
"""

from __future__ import annotations

import fcntl
import os
import signal
import time
from pathlib import Path

from rclpy.logging import get_logger

from plsing_ros.errors import StartError

# The first word of a segment of boost::interprocess that is ready for use.
_MADE = (2).to_bytes(4, "little")

# A living program makes the file in milliseconds [s].
_SURELY_STUCK = 2.0

# The ports of a domain, as the RTPS standard numbers them.
_FIRST_PORT, _PORTS = 7400, 250


def clear_half_made_ports(domain: int, folder: Path = Path("/dev/shm"), processes: Path = Path("/proc")) -> None:
    """Remove the half-made files of a domain's ports, and log each.

    To be called before a node is made. Takes two seconds if there is a half-made file, to see whether it stays so.

    Args:
        domain: ROS domain that the node is going to be in.
        folder: Where shared memory lies.
        processes: Where the kernel tells of processes.

    Raises:
        StartError: If a file stays half made and a process has it open, or that cannot be found out.
    """
    if suspects := _half_made(domain, folder):
        time.sleep(_SURELY_STUCK)
        for path, _ in sorted(suspects & _half_made(domain, folder)):
            _remove(path, processes)


def _half_made(domain: int, folder: Path) -> set[tuple[Path, int]]:
    """Return the files, with their inodes, for one that was made anew is another one."""
    first = _FIRST_PORT + _PORTS * domain
    found = set()
    for path in (folder / f"fastrtps_port{port}" for port in range(first, first + _PORTS)):
        try:
            with path.open("rb") as file:
                if file.read(len(_MADE)) != _MADE:
                    found.add((path, os.fstat(file.fileno()).st_ino))
        except FileNotFoundError:
            continue
        except OSError as error:
            raise StartError(
                f"{path} cannot be read ({error.strerror}), and if it is half made a node waits for it without end; "
                "choose another ROS_DOMAIN_ID, or have its owner see to it"
            ) from None
    return found


def _remove(path: Path, processes: Path) -> None:
    users = _users(path, processes)
    obstacle = f"process {users[0]} has it open: end that process" if users else _remove_if_free(path)
    if obstacle:
        raise StartError(
            f"{path} is half made, by a program that was killed or stopped at its start, and a node would wait for it "
            f"without end; {obstacle}, or remove the file, or choose another ROS_DOMAIN_ID"
        )
    get_logger("shared_memory").warning(
        f"{path} was left half made by a program killed at its start; no living process had it open: removed"
    )


def _remove_if_free(path: Path) -> str:
    """Remove a file that no process in any container has open; return "", or what keeps it from that."""
    try:
        descriptor = os.open(path, os.O_RDWR)
    except FileNotFoundError:
        return ""
    except OSError as error:
        return f"it belongs to another user ({error.strerror})"
    try:
        # Else whoever opens the file meanwhile would end this program by a signal.
        fcntl.fcntl(descriptor, fcntl.F_SETSIG, signal.SIGURG)
        # The kernel gives this lease only if there is no other open descriptor and no mapping of the file.
        fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_WRLCK)
        path.unlink(missing_ok=True)
    except OSError as error:
        return f"whether a process has it open cannot be found out ({error.strerror})"
    finally:
        os.close(descriptor)
    return ""


def _users(path: Path, processes: Path) -> list[str]:
    """Return the ids, with names, of the processes that have a file open or mapped, as far as they can be seen."""
    return [
        f"{process.name} ({_name(process)})"
        for process in processes.glob("[0-9]*")
        if _has_open(process, path) or _has_mapped(process, path)
    ]


def _has_open(process: Path, path: Path) -> bool:
    try:
        return any(_target(link) == str(path) for link in (process / "fd").iterdir())
    except OSError:
        # Ended meanwhile, or another user's.
        return False


def _has_mapped(process: Path, path: Path) -> bool:
    try:
        maps = (process / "maps").read_text(errors="replace")
    except OSError:
        return False
    return any(line.endswith(f" {path}") for line in maps.splitlines())


def _target(link: Path) -> str:
    try:
        return str(link.readlink())
    except OSError:
        return ""


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text(errors="replace").strip()
    except OSError:
        return "ended meanwhile"
