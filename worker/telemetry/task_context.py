"""The ids in a task's message, for the lines logged during the task and for its span."""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Mapping
from typing import Any

from telemetry import tracing
from telemetry.log_lines import about

__all__ = ["Steps", "named", "traced_task"]

# What messages call it, and what lines do.
NAMES = {"job": "job", "batch": "batch", "frame": "frame", "scene": "scene", "work": "work", "watch": "view"}
LONGEST = 200


def named(message: Any) -> dict[str, Any]:
    """Returns the ids in a message; another release may send anything."""
    if isinstance(message, str):
        return {"scene": message[:LONGEST]}
    if not isinstance(message, Mapping):
        return {}
    found = {name: message.get(key) for key, name in NAMES.items()}
    return {name: value for name, value in found.items() if isinstance(value, (int, str)) and len(str(value)) <= LONGEST}


class Steps:
    """The steps of a piece of work, as consecutive spans."""

    def __init__(self) -> None:
        self._name: str | None = None
        self._begun = 0.0

    def now(self, name: str | None) -> None:
        """Begins the next step; None ends the last."""
        if name != self._name:
            if self._name is not None:
                tracing.record(self._name.lower(), self._begun, time.time(), tracing.here())
            self._name, self._begun = name, time.time()


def traced_task(task: Callable[[Any, Any], None], span: str) -> Callable[..., None]:
    """Wraps a task (its argument is one message, by name) with its ids in log lines and its span.

    The span's parent comes with Celery's message; without one there is no span. span: empty if batches have their own.
    """

    @functools.wraps(task)
    def run(self: Any, *positional: Any, **arguments: Any) -> None:
        (message,) = (*positional, *arguments.values())
        parent = tracing.where(getattr(self.request, tracing.HEADER, None)) if tracing.is_on() else None
        ids = named(message)
        with about(**ids), tracing.child_of(parent), tracing.span(span, **ids) if span else contextlib.nullcontext():
            task(self, message)

    return run
