"""What a task is about: the ids of its message, for the lines that are logged while it is done and for its span."""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from worker import tracing
from worker.log_lines import about

__all__ = ["Steps", "named", "task_of", "told_about"]

# What messages call it, and what lines do.
NAMES = {"job": "job", "batch": "batch", "frame": "frame", "scene": "scene", "work": "work", "watch": "view"}
LONGEST = 200


def named(message: Any) -> dict[str, Any]:
    """The ids in a message; of another release it may be anything."""
    if isinstance(message, str):
        return {"scene": message[:LONGEST]}
    if not isinstance(message, Mapping):
        return {}
    found = {name: message.get(key) for key, name in NAMES.items()}
    return {name: value for name, value in found.items() if isinstance(value, (int, str)) and len(str(value)) <= LONGEST}


@contextlib.contextmanager
def task_of(task: Any, span: str, message: Any) -> Iterator[None]:
    """Within it, `span` is done for a message. Its parent comes with Celery's message; without one there is no span."""
    parent = tracing.where(getattr(task.request, tracing.HEADER, None)) if tracing.is_on() else None
    ids = named(message)
    with about(**ids), tracing.span(span, parent, **ids) if parent is not None else contextlib.nullcontext():
        yield


class Steps:
    """What is told of a piece of work on its way, as spans one behind the other within it."""

    def __init__(self) -> None:
        self._name: str | None = None
        self._begun = 0.0

    def now(self, name: str | None) -> None:
        """It goes on to this; None: it is done."""
        if name != self._name:
            if self._name is not None:
                tracing.record(self._name.lower(), self._begun, time.time(), tracing.here())
            self._name, self._begun = name, time.time()


def told_about(task: Callable[[Any, Any], None], span: str) -> Callable[..., None]:
    """A task (its arguments are one message, by name), whose lines and span say what it is about."""

    @functools.wraps(task)
    def run(self: Any, *positional: Any, **arguments: Any) -> None:
        (message,) = (*positional, *arguments.values())
        with task_of(self, span, message):
            task(self, message)

    return run
