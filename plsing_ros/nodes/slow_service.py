# SPDX-License-Identifier: Apache-2.0
"""A service whose answers take long, in a node that answers messages meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

from rclpy.service import Service

# How often requests and answers are looked for [s].
LOOK_PERIOD = 0.02

# Takes a request and a response to fill, yields while it is not ready, and returns it.
SlowAnswer = Callable[[Any, Any], Generator[None, None, Any]]


class SlowService:
    """Takes requests, and answers each when its answer is ready.

    Executors of rclpy send what a callback returns, and EventsExecutor keeps a processor busy for one that awaits. So
    this service is looked after by a timer, and no executor may serve it.

    Args:
        service: Of rclpy.
        answer: How to answer.
        guarded: Makes a callback one that refuses where its node is not active, and that reports faults.
    """

    def __init__(
        self, service: Service, answer: SlowAnswer, guarded: Callable[[Callable[..., Any]], Callable[..., Any]]
    ) -> None:
        self._service, self._answer, self._advance = service, answer, guarded(_advance)
        # Answers that are worked on, the response to be filled, and to whom it goes.
        self._open: list[tuple[Generator[None, None, Any], Any, Any]] = []

    def look(self) -> None:
        """Take a request, if there is one, and send the answers that are ready."""
        with self._service.handle:
            request, header = self._service.handle.service_take_request(self._service.srv_type.Request)
        if request is not None:
            response = self._service.srv_type.Response()
            self._open.append((self._answer(request, response), response, header))
        waiting, self._open = self._open, []
        for answer, response, header in waiting:
            ready = self._advance(answer, response)
            if ready is None:
                self._open.append((answer, response, header))
            else:
                self._service.send_response(ready, header)


def _advance(answer: Generator[None, None, Any], _: Any) -> Any:
    """Return the response if it is ready, or None."""
    try:
        next(answer)
    except StopIteration as end:
        return end.value
    return None
