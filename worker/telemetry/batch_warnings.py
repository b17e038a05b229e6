"""Collects this slot's warnings while it renders a batch, and how long each step took.

They are sent with the batch's result and stored in its job's log.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

from telemetry import tracing

__all__ = ["BatchWarnings", "WarningHandler", "collect_warnings", "step"]

MAX_LINES = 10  # lines of a batch
MAX_LINE_LENGTH = 300  # characters of a line


@dataclass
class BatchWarnings:
    """Warnings and timings of a batch. lines: the first warnings and errors. took: duration of each step in seconds, by name."""

    lines: list[str] = field(default_factory=list)
    took: dict[str, float] = field(default_factory=dict)

    def result_fields(self) -> dict[str, Any]:
        """Returns the fields to add to the result; empty without warnings or steps."""
        said = {"lines": self.lines, "took": {name: round(seconds, 4) for name, seconds in self.took.items()}}
        return {name: value for name, value in said.items() if value}


_current_warnings: ContextVar[BatchWarnings | None] = ContextVar("overheard", default=None)


class WarningHandler(logging.Handler):
    """A handler of the root logger that collects warnings while a batch is rendered."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)

    def emit(self, record: logging.LogRecord) -> None:
        """Adds the record's message to the warnings."""
        now = _current_warnings.get()
        if now is not None and len(now.lines) < MAX_LINES:
            error = record.exc_info[1] if record.exc_info else None
            said = record.getMessage().strip() + (f" ({type(error).__name__}: {error})" if error is not None else "")
            now.lines.append(f"{record.levelname.lower()}: {said}"[:MAX_LINE_LENGTH])


@contextlib.contextmanager
def collect_warnings() -> Iterator[BatchWarnings]:
    """Context manager that collects warnings and durations; yields them."""
    noted = BatchWarnings()
    before = _current_warnings.set(noted)
    try:
        yield noted
    finally:
        _current_warnings.reset(before)


@contextlib.contextmanager
def step(name: str, **attributes: Any) -> Iterator[None]:
    """Context manager that measures the duration of a step of a batch, and records the step as a tracing span."""
    begun = time.perf_counter()
    try:
        with tracing.span(name, **attributes):
            yield
    finally:
        if (now := _current_warnings.get()) is not None:
            now.took[name] = now.took.get(name, 0.0) + time.perf_counter() - begun
