# SPDX-License-Identifier: Apache-2.0
"""Stopping a process just while it holds a lock in Fast DDS' shared memory."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

# Of a segment: the lock of its port is near the beginning [bytes].
_LOOKED_AT = 1 << 16
_PATIENCE = 120.0  # [s]
# Flag of pthread_mutex_t.__kind for a lock that processes share.
_SHARED = 128


def stop_in_lock(process: subprocess.Popen[str], pause: Callable[[], None]) -> None:
    """Stop a process, and let it go on for a pause, until it is stopped with the lock of a port in its hands.

    Raises:
        TimeoutError: If it never is.
    """
    end = time.monotonic() + _PATIENCE
    while time.monotonic() < end:
        pause()
        process.send_signal(signal.SIGSTOP)
        while _state(process.pid) != "T":
            pass
        if _holds_a_lock(process.pid):
            return
        process.send_signal(signal.SIGCONT)
    raise TimeoutError(f"process {process.pid} held no lock of a port in {_PATIENCE} s")


def mapped_segments(pid: int) -> set[str]:
    """Return the files of Fast DDS' shared memory that a process has mapped."""
    files = {line.split()[-1] for line in Path(f"/proc/{pid}/maps").read_text().splitlines()}
    return {each for each in files if each.startswith("/dev/shm/fast")}


def _holds_a_lock(pid: int) -> bool:
    """Return whether the owner of a locked mutex in a port is a thread of the process.

    Source: pthread_mutex_t of the GNU C library: lock, count, owner, users, kind, 32 bits each.
    """
    threads = [int(each.name) for each in Path(f"/proc/{pid}/task").iterdir()]
    for file in mapped_segments(pid):
        if "port" not in file:
            continue
        with Path(file).open("rb") as stream:
            words = np.frombuffer(stream.read(_LOOKED_AT), dtype="<i4")
        owner, lock, users, kind = words[2:-2], words[:-4], words[3:-1], words[4:]
        if np.any(np.isin(owner, threads) & np.isin(lock, (1, 2)) & (users == 1) & (kind & _SHARED != 0)):
            return True
    return False


def _state(pid: int) -> str:
    return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
