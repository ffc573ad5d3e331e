# SPDX-License-Identifier: Apache-2.0
"""Many independent tasks on the cores of this machine, or on a Dask cluster: the same results, in the same order."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from types import TracebackType
from typing import Any, TypeVar

from plsing_ros.errors import ParameterError, PlsingError

_T = TypeVar("_T")
_R = TypeVar("_R")
# How long a scheduler may take to answer [s].
_CONNECT = 10.0
# Processes are started if what is left takes this process longer [s]: each of them begins with the imports.
_WORTH = 4.0
# How often processes may die before it is given up.
_ATTEMPTS = 3
# One thread for each process: more of them only wait for each other.
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class SchedulerError(PlsingError):
    """A cluster, or processes, that cannot be reached or used; the message says what to do."""


class Workers:
    """Who does the work: this process, several of this machine, or a Dask cluster. To be used in a with statement."""

    def __init__(self, scheduler: str | None = None, processes: int | None = None) -> None:
        """Choose; nothing is started before it is needed.

        Args:
            scheduler: Address of a Dask scheduler ("tcp://host:8786"), whose workers have this package installed. A
                task whose worker dies is run by another one. None: processes of this machine.
            processes: How many of them; None: as many as there are cores; 1: this one.

        Raises:
            ParameterError: If processes is below 1.
        """
        if processes is not None and processes < 1:
            raise ParameterError(f"{processes} processes cannot work; at least 1 must")
        self._scheduler, self._count = scheduler, processes or os.cpu_count() or 1
        self._pool: ProcessPoolExecutor | None = None
        self._client: Any = None

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._drop_pool()
        if self._client is not None:
            self._client.close()

    def run(self, function: Callable[[_T], _R], tasks: Sequence[_T]) -> Iterator[_R]:
        """Yield function(task) for each task, in order; tasks should take half a second or more.

        Args:
            function: Of a module, without state, so that every machine gives the same; its results can be pickled.
            tasks: What it is called with. Those not yet begun are dropped when the iterator is closed.

        Raises:
            SchedulerError: If the scheduler cannot be reached, distributed is not installed, or processes die.
        """
        if self._scheduler is not None:
            yield from self._on_cluster(function, tasks, self._scheduler)
        elif min(self._count, len(tasks)) <= 1:
            yield from map(function, tasks)
        else:
            yield from self._on_processes(function, tasks)

    def _on_processes(self, function: Callable[[_T], _R], tasks: Sequence[_T]) -> Iterator[_R]:
        done, begin = 0, time.process_time()
        while self._pool is None and _WORTH > 0.0 and done < len(tasks):
            yield function(tasks[done])
            done += 1
            if (time.process_time() - begin) / done * (len(tasks) - done) > _WORTH:
                break
        for _ in range(_ATTEMPTS if done < len(tasks) else 0):
            try:
                for result in self._submitted(function, tasks[done:]):
                    done += 1
                    yield result
                return
            except BrokenProcessPool:
                self._drop_pool()
        if done < len(tasks):
            raise SchedulerError(
                f"processes of this machine died {_ATTEMPTS} times, as when memory is short; try --processes 1"
            )

    def _submitted(self, function: Callable[[_T], _R], tasks: Sequence[_T]) -> Iterator[_R]:
        if self._pool is None:
            # Fresh interpreters: a fork would copy the threads of the libraries in whatever state they are.
            self._pool = ProcessPoolExecutor(self._count, mp_context=multiprocessing.get_context("spawn"))
        before = {name: os.environ.get(name) for name in _ONE_THREAD}
        os.environ.update(_ONE_THREAD)
        try:
            return self._pool.map(function, tasks)
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value

    def _drop_pool(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    def _on_cluster(self, function: Callable[[_T], _R], tasks: Sequence[_T], scheduler: str) -> Iterator[_R]:
        try:
            from distributed import Client, KilledWorker
        except ImportError:
            raise SchedulerError("--scheduler needs the package distributed: pip install 'plsing_ros[dask]'") from None
        try:
            if self._client is None:
                self._client = Client(scheduler, timeout=_CONNECT)  # type: ignore[no-untyped-call]
        except (OSError, ValueError, TimeoutError) as error:
            raise SchedulerError(
                f"no Dask scheduler answers at {scheduler} ({error}); start one with `dask scheduler` and workers with "
                "`dask worker`, or leave --scheduler out"
            ) from None
        # Pure results would be taken from an earlier run with other code.
        futures = self._client.map(function, tasks, pure=False)
        try:
            for future in futures:
                yield future.result()
        except (KilledWorker, CancelledError, OSError, ImportError) as error:
            raise SchedulerError(
                f"the cluster at {scheduler} gave up a task ({' '.join(str(error).split())}): its workers must stay "
                "alive and have plsing_ros installed, in the same version as here"
            ) from None
        finally:
            self._client.cancel(futures)


def run_tasks(
    function: Callable[[_T], _R], tasks: Sequence[_T], scheduler: str | None = None, processes: int | None = None
) -> Iterator[_R]:
    """Yield function(task) for each task, in order: Workers.run for one list of tasks alone."""
    with Workers(scheduler, processes) as workers:
        yield from workers.run(function, tasks)
