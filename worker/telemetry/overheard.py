"""What is reported about a batch besides its sums: warnings of this slot while it rendered, and how long each step took.

It goes back with the batch's answer into its job's log, so nobody has to look for it on the machine.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

from worker.telemetry import tracing

__all__ = ["Listener", "Overheard", "overhear", "step"]

MOST = 10  # lines of a batch
LONGEST = 300  # characters of a line


@dataclass
class Overheard:
    """lines: warnings and errors, the first of them. took: seconds of each step."""

    lines: list[str] = field(default_factory=list)
    took: dict[str, float] = field(default_factory=dict)

    def told(self) -> dict[str, Any]:
        """What an answer says of it; nothing where there is nothing."""
        said = {"lines": self.lines, "took": {name: round(seconds, 4) for name, seconds in self.took.items()}}
        return {name: value for name, value in said.items() if value}


_now: ContextVar[Overheard | None] = ContextVar("overheard", default=None)


class Listener(logging.Handler):
    """On the root logger: notes what is warned of, where somebody wants to know."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)

    def emit(self, record: logging.LogRecord) -> None:
        """Note a line."""
        now = _now.get()
        if now is not None and len(now.lines) < MOST:
            error = record.exc_info[1] if record.exc_info else None
            said = record.getMessage().strip() + (f" ({type(error).__name__}: {error})" if error is not None else "")
            now.lines.append(f"{record.levelname.lower()}: {said}"[:LONGEST])


@contextlib.contextmanager
def overhear() -> Iterator[Overheard]:
    """Within it, what is warned of and how long steps take is noted."""
    noted = Overheard()
    before = _now.set(noted)
    try:
        yield noted
    finally:
        _now.reset(before)


@contextlib.contextmanager
def step(name: str, **attributes: Any) -> Iterator[None]:
    """A step of a batch: its seconds, and its span."""
    begun = time.perf_counter()
    try:
        with tracing.span(name, **attributes):
            yield
    finally:
        if (now := _now.get()) is not None:
            now.took[name] = now.took.get(name, 0.0) + time.perf_counter() - begun
