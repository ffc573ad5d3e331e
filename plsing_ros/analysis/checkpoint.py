# SPDX-License-Identifier: Apache-2.0
"""Results of a long run in a file of JSON lines, so that the run can go on after it was stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from plsing_ros.analysis.parallel import Workers
from plsing_ros.errors import ParameterError

_T = TypeVar("_T")


class Checkpoint:
    """Records by the value of one of their keys; what is added is in the file at once.

    Attributes:
        records: Of this run and of earlier ones.
    """

    def __init__(self, file: Path | None, header: Mapping[str, Any], key: str = "task") -> None:
        """Read what an earlier run has left, or begin a file.

        Args:
            file: Where; None: nowhere, so that nothing is kept.
            header: What the run is about; its first value names the kind of run.
            key: Name of the key that tells records apart.

        Raises:
            ParameterError: If the file is of another run, or none of ours; it is left as it is.
            OSError: If it cannot be read or written.
        """
        self._file, self._key = file, key
        self.records: dict[Any, dict[str, Any]] = {}
        if file is None:
            return
        if not file.exists() or file.stat().st_size == 0:
            file.write_text(json.dumps(dict(header)) + "\n", encoding="utf-8")
            return
        try:
            text = file.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            raise ParameterError(f"{file} is a binary file; give another --output") from None
        first, *lines = text.splitlines()
        if _record(first) != dict(header):
            raise ParameterError(
                f"{file} belongs to another {next(iter(header))} or is none (it begins with {first[:100]!r}); give "
                "another --output, or the same input as before"
            )
        # The last line of an interrupted run may be cut off; its task is done again, on a line of its own.
        if not text.endswith("\n"):
            self._append("")
        self.records = {record[key]: record for record in map(_record, lines) if key in record}

    def add(self, record: dict[str, Any]) -> None:
        """Keep a record."""
        if self._file is not None:
            self._append(json.dumps(record))
        self.records[record[self._key]] = record

    def run(self, workers: Workers, function: Callable[[_T], Any], tasks: Mapping[str, _T]) -> Iterator[Any]:
        """Yield function(task) for named tasks, in order; those that are in the file are taken from there.

        Args:
            workers: Who does what is left.
            function: As for Workers.run, with results that JSON keeps as they are: no tuples.
            tasks: By names that are unique in the run.
        """
        open_tasks = [name for name in tasks if name not in self.records]
        results = workers.run(function, [tasks[name] for name in open_tasks])
        for name in tasks:
            if name not in self.records:
                self.add({self._key: name, "result": next(results)})
            yield self.records[name]["result"]

    def _append(self, line: str) -> None:
        assert self._file is not None
        with self._file.open("a", encoding="utf-8") as file:
            file.write(line + "\n")


def digest(*values: Any) -> str:
    """Return a short name for values that have an exact repr, or are arrays: the same for the same values."""
    named = hashlib.sha256()
    for value in values:
        named.update(value.tobytes() if hasattr(value, "tobytes") else repr(value).encode())
        named.update(b"\0")
    return named.hexdigest()[:12]


def _record(line: str) -> dict[str, Any]:
    """Return what a line says, or nothing if it is no record."""
    try:
        record = json.loads(line)
    except json.JSONDecodeError:
        return {}
    return record if isinstance(record, dict) else {}
