"""Exceptions for readers that fail: SceneError for a fault of the file, MachineError for one of this machine."""

from __future__ import annotations

import logging
import os
import signal
from dataclasses import dataclass
from typing import Any

from renderer.confine.limits import amount, callers_limit
from renderer.errors import MachineError, RayfarmError, SceneError

__all__ = ["Bounds", "TooLargeError", "error_of", "how_it_ended", "too_slow"]

log = logging.getLogger(__name__)

_OF_ALLOCATION = (signal.SIGABRT, signal.SIGSEGV, signal.SIGBUS, signal.SIGTRAP, signal.SIGILL)  # of failed allocations


@dataclass(frozen=True)
class Bounds:
    """Limits of a reader, and the phrases of its error messages.

    memory_bytes: beyond the memory at its start. seconds: of work. subject: the beginning of sentences. granted: the continuation
    of "needs more than the 4.0 GiB". longer, smaller: advice if the time or the memory is insufficient.
    """

    memory_bytes: int
    seconds: float
    subject: str = "The file"
    granted: str = "that this machine has free"
    longer: str = "Make it smaller, or split it into several."
    smaller: str = "Simplify it."


class TooLargeError(MachineError):
    """A file needs more memory than its reader may use."""


def error_of(message: dict[str, Any], bounds: Bounds) -> RayfarmError:
    """Returns the exception for a reader's `error` message."""
    sentence = str(message["error"])
    if message.get("machine"):
        return MachineError(sentence)
    if sentence == "memory":
        return _out_of_memory(bounds)
    if sentence == "size":
        limit = callers_limit("-f")
        what = f"{limit} is too small. Raise it." if limit else "its temporary files are too large for it."
        return MachineError(f"{bounds.subject} cannot be read on this machine: {what}")
    if "trace" in message:
        log.warning("%s: %s", bounds.subject, message["trace"])
    if message.get("rest"):
        return SceneError(f"{bounds.subject} {sentence}")
    return _kinds().get(str(message.get("kind")), SceneError)(sentence)


def _kinds() -> dict[str, type[RayfarmError]]:
    """Returns the exception classes that this process knows, by name."""
    found: dict[str, type[RayfarmError]] = {}
    waiting = [RayfarmError]
    while waiting:
        kind = waiting.pop()
        found[f"{kind.__module__}.{kind.__qualname__}"] = kind
        waiting += kind.__subclasses__()
    return found


def _out_of_memory(bounds: Bounds) -> MachineError:
    if (limit := callers_limit("-v")) is not None:
        return MachineError(f"{bounds.subject} cannot be read on this machine: {limit} is too small. Raise it.")
    return TooLargeError(
        f"{bounds.subject} needs more than the {bounds.memory_bytes / 2**30:.1f} GiB {bounds.granted}. {bounds.smaller}"
    )


def how_it_ended(status: int, bounds: Bounds, room: int | None = None, needed: int = 0) -> RayfarmError:
    """Returns the error for a reader that ended without a result. status: from `os.wait`.

    room: bytes that it could allocate. needed: bytes that an importer may need. A crash with less room than that is taken for a
    failed allocation, which importers seldom check: a MachineError, so that a machine with more memory can try.
    """
    subject = bounds.subject
    if not os.WIFSIGNALED(status):
        return SceneError(f"{subject} cannot be read: its importer ended without a result. It may be damaged; export it anew.")
    number = os.WTERMSIG(status)
    if number == signal.SIGXCPU:
        if (limit := callers_limit("-t")) is not None:
            return MachineError(f"{subject} cannot be read on this machine: {limit} is too small. Raise it.")
        return too_slow(bounds)
    if number == signal.SIGKILL:
        return MachineError(
            f"{subject} cannot be read on this machine: its reader was killed (signal 9), as when memory runs out."
        )
    name = signal.Signals(number).name if number in set(signal.Signals) else ""
    if number in _OF_ALLOCATION and room is not None and room < needed:
        limit = callers_limit("-v")
        return MachineError(
            f"{subject} cannot be read on this machine: its importer crashed (signal {number}, {name}) "
            f"with {amount(room)} of memory, and may need {amount(needed)}. {f'Raise {limit}.' if limit else bounds.smaller}"
        )
    return SceneError(
        f"{subject} cannot be read: its importer crashed (signal {number}{', ' if name else ''}{name}). "
        "It may be damaged; export it anew."
    )


def too_slow(bounds: Bounds) -> SceneError:
    """Returns the error for a reader that exceeded its time limit."""
    return SceneError(f"{bounds.subject} took longer than {bounds.seconds:.0f} seconds. {bounds.longer}")
