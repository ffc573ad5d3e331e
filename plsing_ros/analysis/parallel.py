# SPDX-License-Identifier: Apache-2.0
"""Many independent tasks on the cores of this machine, or on a Dask cluster: the same results, in the same order."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, TypeVar

from plsing_ros.errors import PlsingError

_T = TypeVar("_T")
_R = TypeVar("_R")
# How long a scheduler may take to answer [s].
_CONNECT = 10.0


class SchedulerError(PlsingError):
    """A cluster that cannot be reached or used; the message says what to do."""


def run_tasks(
    function: Callable[[_T], _R], tasks: Sequence[_T], scheduler: str | None = None, processes: int | None = None
) -> Iterator[_R]:
    """Yield function(task) for each task, in order; tasks should take half a second or more.

    Args:
        function: Of a module, without state, so that every machine gives the same; its results can be pickled.
        tasks: What it is called with.
        scheduler: Address of a Dask scheduler ("tcp://host:8786"), whose workers have this package installed. A task
            whose worker dies is run by another one. None: processes of this machine.
        processes: How many of them; None: as many as there are cores; 1: this one.

    Raises:
        SchedulerError: If the scheduler cannot be reached, or distributed is not installed.
    """
    if scheduler is not None:
        yield from _on_cluster(function, tasks, scheduler)
        return
    count = min(processes or os.cpu_count() or 1, len(tasks))
    if count <= 1:
        yield from map(function, tasks)
        return
    # Fresh interpreters: a fork would copy the threads of the libraries in whatever state they are.
    with ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(function, tasks)


def _on_cluster(function: Callable[[_T], _R], tasks: Sequence[_T], scheduler: str) -> Iterator[_R]:
    try:
        from distributed import Client
    except ImportError:
        raise SchedulerError("--scheduler needs the package distributed: pip install 'plsing_ros[dask]'") from None
    try:
        client: Any = Client(scheduler, timeout=_CONNECT)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        raise SchedulerError(
            f"no Dask scheduler answers at {scheduler} ({error}); start one with `dask scheduler` and workers with "
            "`dask worker`, or leave --scheduler out"
        ) from None
    with client:
        # Pure results would be taken from an earlier run with other code.
        futures = client.map(function, tasks, pure=False)
        for future in futures:
            yield future.result()
