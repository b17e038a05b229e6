"""The only reader of the stream on which workers answer. An entry is deleted only after its content is stored."""

from __future__ import annotations

import contextlib
import json
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import redis

from worker.protocol.contract import RESULTS, Result

__all__ = ["Entry", "Position", "Results"]

log = logging.getLogger(__name__)

AT_MOST = 256  # entries a read: bounds the time until the next look at the queue
BYTES = 64 << 20  # a read, about: bounds memory

FIRST_READ = 64  # entries, before their size is known
SMOOTHING = 0.3

Position = tuple[int, int]  # in the stream: what lies at or before it was appended earlier
BEGINNING: Position = (0, 0)


@dataclass(frozen=True)
class Entry:
    """An entry of the stream; `result` is None where it cannot be understood."""

    id: bytes
    result: Result | None


class Results:
    """Reads the stream from its beginning, each entry once: what is there at the start has not been stored yet."""

    def __init__(self, connection: redis.Redis, guard: Callable[[], None] = lambda: None) -> None:
        """guard: raises FarmError where nothing may be taken in: what is not stored here another stores."""
        self._redis = connection
        self._guard = guard
        self._read_to = BEGINNING
        self._at_most = FIRST_READ
        self.size = 0.0  # bytes of a result, over the latest
        self.was_full = False  # whether the latest read found all that it could take: more may wait

    def read(self, block_ms: int) -> list[Entry]:
        """The oldest entries that were not read yet, waiting at most `block_ms` for one. Raises redis.RedisError."""
        after = f"{self._read_to[0]}-{self._read_to[1]}"
        answer: Any = self._redis.xread({RESULTS: after}, count=self._at_most, block=block_ms)
        self._guard()
        streams = list(answer.values()) if isinstance(answer, dict) else [entries for _, entries in answer or []]
        entries: list[Entry] = []
        for found in streams:
            # RESP3 nests a stream's entries one level deeper
            flat = found[0] if found and isinstance(found[0], list) else found
            entries += [Entry(id, _parse(fields)) for id, fields in flat]
        self.was_full = len(entries) >= self._at_most
        if entries:
            self._read_to = _position(entries[-1].id)
            sizes = [len(entry.result.sums) for entry in entries if entry.result is not None and entry.result.sums]
            if sizes:
                mean = sum(sizes) / len(sizes)
                self.size += (mean - self.size) * (SMOOTHING if self.size else 1.0)
                self._at_most = int(max(1, min(AT_MOST, BYTES / max(self.size, mean))))
        return entries

    def end(self) -> Position:
        """The position of the latest entry. Raises redis.RedisError."""
        try:
            about: Any = self._redis.xinfo_stream(RESULTS)
        except redis.ResponseError:  # there is no stream
            return BEGINNING
        return _position(about["last-generated-id"])

    def has_read(self, position: Position) -> bool:
        """Whether all up to there was read."""
        return self._read_to >= position

    def length(self) -> int:
        """How many entries are in the stream, read or not. Raises redis.RedisError."""
        return int(self._redis.xlen(RESULTS))

    def start_over(self) -> None:
        """Read all that is in the stream again."""
        self._read_to = BEGINNING

    def wake(self) -> None:
        """Let a `read` that waits return now; from any thread. Where Redis is away, the reader wakes up by itself."""
        with contextlib.suppress(redis.RedisError):
            self._redis.xadd(RESULTS, {"event": json.dumps({"type": "wake"})})

    def delete(self, entries: list[Entry]) -> None:
        """Trim what has been stored. Raises redis.RedisError."""
        if entries:
            self._guard()
            self._redis.xdel(RESULTS, *[entry.id for entry in entries])


def _position(id: bytes | str) -> Position:
    milliseconds, _, number = (id.decode() if isinstance(id, bytes) else id).partition("-")
    return int(milliseconds), int(number)


def _parse(fields: dict[bytes, bytes]) -> Result | None:
    try:
        return Result.from_fields(fields)
    except (KeyError, ValueError, AttributeError, TypeError, RecursionError) as error:
        log.warning("an entry of the result stream is left out: %s", error)
        return None
