# SPDX-License-Identifier: Apache-2.0
"""Where answers that take long are worked out: here and now, or in a process of their own while control goes on."""

from __future__ import annotations

import importlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any, Protocol

from plsing_ros.errors import ObservationError


class Answer(Protocol):
    """What was asked for."""

    def result(self) -> Any:
        """Return it, or None while it is not ready.

        Raises:
            ObservationError: If it cannot be worked out.
        """


class Planner(Protocol):
    """Whoever works it out."""

    def ask(self, function: Callable[..., Any], *arguments: object) -> Answer:
        """Return what becomes the answer of a function of a module."""


class PlanNow:
    """Works it out when it is asked: deterministic, and as long as it takes."""

    def ask(self, function: Callable[..., Any], *arguments: object) -> Answer:
        """Return the answer."""
        answer = _Pending()
        answer.put(function(*arguments))
        return answer


class PlanProcess:
    """Works out one answer after the other in a process of its own, started by the first question.

    Neither the interpreter's lock nor a long computation holds up who asks. The process ends with its parent, however
    that ends.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._questions: queue.SimpleQueue[tuple[_Pending, tuple[object, ...]] | None] = queue.SimpleQueue()

    def start(self) -> None:
        """Start the process if it does not run."""
        if self._process is not None and self._process.poll() is None:
            return
        code = f"from {__name__} import answer_until_the_end; answer_until_the_end()"
        self._process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._questions = queue.SimpleQueue()
        threading.Thread(target=_converse, args=(self._process, self._questions), name="planner", daemon=True).start()

    def ask(self, function: Callable[..., Any], *arguments: object) -> Answer:
        """Return what becomes the answer of a function of a module; its arguments are copied."""
        self.start()
        answer = _Pending()
        self._questions.put((answer, (function, *arguments)))
        return answer

    def close(self) -> None:
        """End the process, whatever it is working on."""
        if self._process is not None:
            self._process.kill()
            self._questions.put(None)
            self._process.wait()
            self._process = None


class _Pending:
    """An answer, set by one thread and looked at by another."""

    def __init__(self) -> None:
        self._result: Any = None
        self._problem = ""

    def put(self, result: Any) -> None:
        self._result = result

    def fail(self, problem: str) -> None:
        self._problem = problem

    def result(self) -> Any:
        if self._problem:
            raise ObservationError(self._problem)
        return self._result


def _converse(
    process: subprocess.Popen[bytes], questions: queue.SimpleQueue[tuple[_Pending, tuple[object, ...]] | None]
) -> None:
    """Hand questions to the process and its answers back until it ends; waiting takes no interpreter's lock."""
    assert process.stdin is not None and process.stdout is not None
    with process.stdin, process.stdout:
        while (question := questions.get()) is not None:
            answer, asked = question
            try:
                pickle.dump(asked, process.stdin)
                process.stdin.flush()
                result, problem = pickle.load(process.stdout)
            except (OSError, EOFError, pickle.PickleError) as error:
                answer.fail(f"the process that plans paths has ended: {error!r}; another one is started")
                process.kill()
                return
            if problem:
                answer.fail(problem)
            else:
                answer.put(result)


def answer_until_the_end() -> None:
    """Answer questions from the standard input until it is closed."""
    # Ctrl-C is for the parent, who then closes the input; what it controls comes first.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(5)
    questions, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    # Nothing that is printed may get between the answers.
    os.dup2(2, 1)
    # What is asked most, before it is asked.
    importlib.import_module("plsing_ros.planning.target_check")
    while True:
        try:
            function, *arguments = pickle.load(questions)
        except EOFError:
            return
        result, problem = None, ""
        try:
            result = function(*arguments)
        except Exception as error:
            problem = f"no path was planned: {error!r}"
        pickle.dump((result, problem), answers)
        answers.flush()
