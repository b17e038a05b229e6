"""What a task is about, for the lines that are logged while it is done: the ids of its message."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

from worker.log_lines import about

__all__ = ["named", "told_about"]

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


def told_about(task: Callable[[Any, Any], None]) -> Callable[..., None]:
    """A task (its arguments are one message, by name), whose lines say what it is about."""

    @functools.wraps(task)
    def run(self: Any, *positional: Any, **arguments: Any) -> None:
        (message,) = (*positional, *arguments.values())
        with about(**named(message)):
            task(self, message)

    return run
