"""Ids in a Celery task's message, added to the task's log lines and to its span."""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Mapping
from typing import Any

from telemetry import tracing
from telemetry.log_lines import about

__all__ = ["Steps", "message_ids", "traced_task"]

# What messages call it, and what lines do.
NAMES = {"job": "job", "batch": "batch", "frame": "frame", "scene": "scene", "work": "work", "watch": "view"}
MAX_ID_LENGTH = 200


def message_ids(message: Any) -> dict[str, Any]:
    """Returns the ids (of job, batch, scene, ...) in a task's message. Skips malformed ones, which another release may send."""
    if isinstance(message, str):
        return {"scene": message[:MAX_ID_LENGTH]}
    if not isinstance(message, Mapping):
        return {}
    found = {name: message.get(key) for key, name in NAMES.items()}
    return {name: value for name, value in found.items() if isinstance(value, (int, str)) and len(str(value)) <= MAX_ID_LENGTH}


class Steps:
    """Records consecutive steps of a task as spans."""

    def __init__(self) -> None:
        self._name: str | None = None
        self._begun = 0.0

    def begin_step(self, name: str | None) -> None:
        """Ends the current step and begins the one named `name`. None: only ends the current step."""
        if name != self._name:
            if self._name is not None:
                tracing.record_span(self._name.lower(), self._begun, time.time(), tracing.current_span())
            self._name, self._begun = name, time.time()


def traced_task(task: Callable[[Any, Any], None], span: str, slot: Callable[[], int]) -> Callable[..., None]:
    """Wraps a Celery task so that its log lines contain the message's ids and its run is recorded as a span.

    The parent span is in Celery's message; without it no span is recorded. span: the span's name; empty to record none, for
    tasks whose batches record their own. slot: returns the number of this process's slot.
    """

    @functools.wraps(task)
    def run(self: Any, *positional: Any, **arguments: Any) -> None:
        (message,) = (*positional, *arguments.values())
        parent = tracing.parse_traceparent(getattr(self.request, tracing.HEADER, None)) if tracing.is_on() else None
        ids = message_ids(message)
        with about(**ids), tracing.child_of(parent), tracing.span(span, slot=slot(), **ids) if span else contextlib.nullcontext():
            task(self, message)

    return run
