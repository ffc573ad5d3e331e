# SPDX-License-Identifier: Apache-2.0
"""Results of long studies: made by several processes, and kept, so that one that was stopped goes on where it was."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from tqdm import tqdm

import plsing_ros
from plsing_ros.analysis.parallel import run_tasks

FOLDER = Path("build/benchmark/kept")
_PART = 10

_T = TypeVar("_T")
_R = TypeVar("_R")


def parts(count: int) -> list[range]:
    """Return the numbers from 0 to a count in parts that take some seconds each."""
    return [range(first, min(first + _PART, count)) for first in range(0, count, _PART)]


def kept_results(function: Callable[[_T], _R], tasks: Sequence[_T]) -> Iterator[_R]:
    """Yield function(task) for each task, in order; those made before by the same code are read.

    Args:
        function: Of a module; what it returns can be pickled.
        tasks: What it is called with; their repr tells them apart.
    """
    folder = FOLDER / _code()
    folder.mkdir(parents=True, exist_ok=True)
    yield from tqdm(
        run_tasks(partial(_kept, folder, function), tasks), total=len(tasks), desc=function.__name__, leave=False
    )


def _kept(folder: Path, function: Callable[[_T], _R], task: _T) -> _R:
    name = hashlib.sha256(f"{function.__module__}.{function.__name__}{task!r}".encode()).hexdigest()[:16]
    file = folder / f"{name}.pickle"
    if file.exists():
        return pickle.loads(file.read_bytes())
    result = function(task)
    unfinished = file.with_suffix(".part")
    unfinished.write_bytes(pickle.dumps(result))
    unfinished.rename(file)
    return result


def _code() -> str:
    """Return a mark of all code that a result may depend on."""
    total = hashlib.sha256()
    for folder in (Path(plsing_ros.__file__).parent, Path(__file__).parent):
        for file in sorted(each for suffix in ("py", "cpp", "hpp") for each in folder.rglob(f"*.{suffix}")):
            total.update(file.read_bytes())
    return total.hexdigest()[:16]
