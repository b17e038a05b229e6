"""Creates exceptions for failed readers: SceneError if the file is at fault, MachineError if this machine is."""

from __future__ import annotations

import inspect
import logging
import os
import signal
from dataclasses import dataclass
from typing import Any

from renderer.confine.limits import callers_limit_phrase, size_text
from renderer.errors import MachineError, RayfarmError, SceneError
from renderer.sentences import Sentence, joined_sentences

__all__ = ["Bounds", "TooLargeError", "error_of", "error_of_exit", "timeout_error"]

log = logging.getLogger(__name__)

_ALLOCATION_SIGNALS = (signal.SIGABRT, signal.SIGSEGV, signal.SIGBUS, signal.SIGTRAP, signal.SIGILL)  # of failed allocations


@dataclass(frozen=True)
class Bounds:
    """The limits of a reader, and phrases for error messages about them.

    memory_bytes: beyond the memory in use when the reader starts. seconds: time limit. subject: the beginning of sentences.
    granted: the phrase that follows "needs more than the 4.0 GiB". longer, smaller: advice if the time or the memory is
    insufficient.
    """

    memory_bytes: int
    seconds: float
    subject: str = Sentence("subject-file", "The file")
    granted: str = Sentence("memory-free-here", "that this machine has free")
    longer: str = Sentence("advice-shrink-or-split", "Make it smaller, or split it into several.")
    smaller: str = Sentence("advice-simplify", "Simplify it.")


class TooLargeError(MachineError):
    """Raised if a file needs more memory than its reader may use."""


def error_of(message: dict[str, Any], bounds: Bounds) -> RayfarmError:
    """Returns the exception for a reader's `error` message."""
    sentence: str = str(message["error"])
    if message.get("machine"):
        return MachineError(sentence)
    if sentence == "memory":
        return _out_of_memory(bounds)
    if sentence == "size":
        limit = callers_limit_phrase("-f")
        what = (
            Sentence("advice-raise-limit-too-small", "{limit} is too small. Raise it.", limit=limit)
            if limit
            else Sentence("reader-temporary-files-too-large", "its temporary files are too large for it.")
        )
        return MachineError(
            Sentence(
                "file-unreadable-here", "{subject} cannot be read on this machine: {fault}", subject=bounds.subject, fault=what
            )
        )
    if "trace" in message:
        log.warning("%s: %s", bounds.subject, message["trace"])
    if message.get("rest"):
        return SceneError(joined_sentences(bounds.subject, sentence))
    return _exception_classes().get(str(message.get("kind")), SceneError)(sentence)


def _exception_classes() -> dict[str, type[RayfarmError]]:
    """Returns exception class name -> class, for imported RayfarmErrors that can be created from a sentence alone."""
    found: dict[str, type[RayfarmError]] = {}
    waiting = [RayfarmError]
    while waiting:
        kind = waiting.pop()
        if _takes_sentence(kind):
            found[f"{kind.__module__}.{kind.__qualname__}"] = kind
        waiting += kind.__subclasses__()
    return found


def _takes_sentence(kind: type[RayfarmError]) -> bool:
    try:
        inspect.signature(kind).bind("")
    except TypeError:
        return False
    return True


def _out_of_memory(bounds: Bounds) -> MachineError:
    if (limit := callers_limit_phrase("-v")) is not None:
        return MachineError(
            Sentence(
                "file-unreadable-limit-too-small",
                "{subject} cannot be read on this machine: {limit} is too small. Raise it.",
                subject=bounds.subject,
                limit=limit,
            )
        )
    return TooLargeError(
        Sentence(
            "reader-out-of-memory",
            "{subject} needs more than the {gib} GiB {granted}. {advice}",
            subject=bounds.subject,
            gib=f"{bounds.memory_bytes / 2**30:.1f}",
            granted=bounds.granted,
            advice=bounds.smaller,
        )
    )


def error_of_exit(status: int, bounds: Bounds, memory: int | None = None, needed: int = 0) -> RayfarmError:
    """Returns the exception for a reader that ended without a result. status: from `os.wait`.

    memory: bytes that the reader could allocate. needed: bytes that an importer may need. If `memory` is less than `needed`, a
    crash is taken for a failed allocation, which importers seldom check: the result is a MachineError, so that a machine with
    more memory can try.
    """
    subject = bounds.subject
    if not os.WIFSIGNALED(status):
        return SceneError(
            Sentence(
                "importer-ended-without-result",
                "{subject} cannot be read: its importer ended without a result. It may be damaged; export it again.",
                subject=subject,
            )
        )
    number = os.WTERMSIG(status)
    if number == signal.SIGXCPU:
        if (limit := callers_limit_phrase("-t")) is not None:
            return MachineError(
                Sentence(
                    "file-unreadable-limit-too-small",
                    "{subject} cannot be read on this machine: {limit} is too small. Raise it.",
                    subject=subject,
                    limit=limit,
                )
            )
        return timeout_error(bounds)
    if number == signal.SIGKILL:
        return MachineError(
            Sentence(
                "reader-killed",
                "{subject} cannot be read on this machine: its reader was killed (signal 9); memory may have run out.",
                subject=subject,
            )
        )
    name = signal.Signals(number).name if number in set(signal.Signals) else ""
    if number in _ALLOCATION_SIGNALS and memory is not None and memory < needed:
        limit = callers_limit_phrase("-v")
        return MachineError(
            Sentence(
                "importer-crashed-low-memory",
                "{subject} cannot be read on this machine: its importer crashed (signal {number}, "
                "{name}) with {granted} of memory, and may need {needed}. {advice}",
                subject=subject,
                number=number,
                name=name,
                granted=size_text(memory),
                needed=size_text(needed),
                advice=Sentence("advice-raise-limit", "Raise {limit}.", limit=limit) if limit else bounds.smaller,
            )
        )
    return SceneError(
        Sentence(
            "importer-crashed",
            "{subject} cannot be read: its importer crashed (signal {number}). It may be damaged; export it again.",
            subject=subject,
            number=f"{number}, {name}" if name else number,
        )
    )


def timeout_error(bounds: Bounds) -> SceneError:
    """Returns the error for a reader that exceeded its time limit."""
    return SceneError(
        Sentence(
            "reader-timeout",
            "{subject} took longer than {seconds} seconds. {advice}",
            subject=bounds.subject,
            seconds=f"{bounds.seconds:.0f}",
            advice=bounds.longer,
        )
    )
