# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes of their own, as `ros2 run` starts them, with the interpreter that runs this."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from plsing_ros.errors import PlsingError

_PATIENCE = 20.0  # [s], until a process has ended


class NodeProcesses:
    """Starts nodes, and ends them however the block ends.

    Args:
        environment: Of the processes.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._environment = dict(environment)
        self._logs = ExitStack()
        self._running: dict[str, tuple[subprocess.Popen[bytes], IO[bytes]]] = {}

    def __enter__(self) -> NodeProcesses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process, _ in self._running.values():
            process.send_signal(signal.SIGCONT)
            process.terminate()
        for process, _ in self._running.values():
            try:
                process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._logs.close()

    def start(
        self,
        node: str,
        files: Sequence[Path] = (),
        parameters: Mapping[str, Any] | None = None,
        remap: Mapping[str, str] | None = None,
        settings: Mapping[str, str] | None = None,
        arguments: Sequence[str] = (),
    ) -> subprocess.Popen[bytes]:
        """Start a node.

        Args:
            node: Its executable's name.
            files: Parameter files.
            parameters: Values by name, over those of the files.
            remap: New names of topics by their old ones.
            settings: Variables of its environment, over the others.
            arguments: Of its own, before those of ROS, as the nodes of the container.
        """
        words = [word for file in files for word in ("--params-file", str(file))]
        words += [word for name, value in (parameters or {}).items() for word in ("-p", f"{name}:={json.dumps(value)}")]
        words += [word for old, new in (remap or {}).items() for word in ("-r", f"{old}:={new}")]
        code = f"import sys; from plsing_ros.nodes.{node} import main; sys.argv[0] = '{node}'; sys.exit(main())"
        log = self._logs.enter_context(tempfile.TemporaryFile())  # noqa: SIM115
        process = subprocess.Popen(
            [sys.executable, "-c", code, *arguments, "--ros-args", *words],
            env={**self._environment, **(settings or {})},
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        self._running[node] = process, log
        return process

    def check(self) -> None:
        """Raise PlsingError with the last words of a process that has ended."""
        for node, (process, log) in self._running.items():
            if process.poll() is not None:
                log.seek(0)
                words = log.read().decode(errors="replace").strip().splitlines() or ["nothing"]
                raise PlsingError(f"{node} has ended with exit code {process.returncode}; its last words: {words[-1]}")
