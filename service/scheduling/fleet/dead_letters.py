"""Dead-letter list: messages from workers that could not be handled. All are counted; the latest are stored in a file."""

from __future__ import annotations

import json
import logging
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from service.store.atomic_files import write_atomically
from telemetry.log_lines import ids

__all__ = ["FILE", "DeadLetters"]

FILE = "put-aside.jsonl"  # in the data folder
MAX_KEPT = 100
MAX_CHARACTERS = 2000  # characters of a message or a reason
LOG_EVERY_S = 1.0

log = logging.getLogger(__name__)


class DeadLetters:
    """A bounded dead-letter list. Used only by the engine's thread, except `count`, which any thread may read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._latest: deque[str] = deque(maxlen=MAX_KEPT)
        self._is_written = True
        self._logged = float("-inf")
        self._unlogged = 0
        self.count = 0  # since the service started

    def add(self, where: str, why: object, content: object, error: BaseException | None = None) -> None:
        """Adds a message. where: its Redis key or stream entry. why: the fault, as a text or an exception.

        content: the message. error: an unexpected error, which is logged with its traceback.
        """
        self.count += 1
        reason = f"{type(why).__name__}: {why}" if isinstance(why, BaseException) else str(why)
        letter = {
            "time": round(time.time(), 3),
            "where": where,
            "why": reason[:MAX_CHARACTERS],
            "message": _readable_message(content),
        }
        self._latest.append(json.dumps(letter))
        self._is_written = False
        now = time.monotonic()
        if now - self._logged < LOG_EVERY_S:
            self._unlogged += 1
            return
        more = f" ({self._unlogged} others since the last line)" if self._unlogged else ""
        self._logged, self._unlogged = now, 0
        log.warning(
            "a message was moved to the dead letters (%s): %.500s%s", where, reason, more, exc_info=error, extra=ids(owner=where)
        )

    def flush(self) -> None:
        """Writes the list to its file if it has changed. A failure to write is only logged."""
        if self._is_written:
            return
        self._is_written = True
        try:
            write_atomically(self._path, "".join(f"{line}\n" for line in self._latest).encode())
        except OSError as error:
            log.warning("the dead letters cannot be written: %s", error)


def _readable_message(content: object) -> Any:
    """Returns a message in a readable, shortened form. Binary fields are truncated and described by their size."""
    if isinstance(content, Mapping):
        fields = list(content.items())[:20]
        return {_text(name, 100): _text(value, MAX_CHARACTERS) for name, value in fields}
    return _text(content, MAX_CHARACTERS)


def _text(value: object, longest: int) -> str:
    if isinstance(value, bytes):
        start = value[:longest].decode("utf-8", "backslashreplace")
        if not start.isprintable():
            start = repr(value[:64])
        return start if len(value) <= longest else f"{start[:200]}... ({len(value):,} bytes)"
    text = value if isinstance(value, str) else repr(value)
    return text.encode("utf-8", "backslashreplace").decode()[:longest]
