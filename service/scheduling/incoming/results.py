"""Reads the stream of results. An entry is deleted only after its content was stored or moved to the dead-letter list."""

from __future__ import annotations

import contextlib
import json
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import redis

from protocol.contract import RESULTS, Result
from service.scheduling.faults.repair import repair

__all__ = ["Entry", "Position", "Results"]

log = logging.getLogger(__name__)

MAX_ENTRIES = 256  # entries per read; limits the time until the queue is checked again
READ_BYTES = 64 << 20  # approximate bytes per read; limits memory

MAX_ENTRY_BYTES = 80 << 20  # bytes of an entry: the sums of a tile of 640 x 640 take 64 MiB

FIRST_READ_ENTRIES = 64  # entries of the first reads, while their size is unknown
MAX_LOST_CONNECTIONS = 2  # lost connections during the read of one entry before that entry is taken as the cause
SMOOTHING = 0.3
CURSOR, READER = "cursor", "engine"  # a temporary consumer group, which returns an entry's id without its content
# an id further ahead than a wrong clock was forged; after the largest id, Redis accepts no more entries
MAX_FUTURE_MS = 7 * 86_400_000

Position = tuple[int, int]  # position in the stream; entries at or before it were appended earlier
BEGINNING: Position = (0, 0)


@dataclass(frozen=True)
class Entry:
    """An entry of the stream. result: the parsed message; None if it cannot be parsed, for the reason `fault`."""

    id: bytes
    result: Result | None
    fault: str = ""
    fields: Mapping[bytes, bytes] | None = None

    @property
    def location(self) -> str:
        """The stream's name and the entry's id, for log lines."""
        return f"results {self.id.decode(errors='replace')}"


class Results:
    """Reads the stream of results from its beginning, each entry once.

    Entries that exist at the start of the service have not been stored yet.
    """

    def __init__(self, connection: redis.Redis, guard: Callable[[], None] = lambda: None) -> None:
        """Stores the parameters.

        guard: raises FarmError if this service may not process results, because another one owns the farm.
        """
        self._redis = connection
        self._guard = guard
        self._read_to = BEGINNING
        self._at_most = FIRST_READ_ENTRIES
        self.size = 0.0  # mean size of recent results, in bytes
        self.was_full = False  # whether the latest read was limited, so more entries may wait
        self._cut_off = 0  # consecutive reads of one entry during which the connection ended

    def read(self, block_ms: int) -> list[Entry]:
        """Returns the oldest unread entries. Waits at most `block_ms` milliseconds for one. Raises redis.RedisError.

        Redis closes the connection if a reply exceeds its output limit for clients; then fewer entries are read at a time. A
        single entry above that limit is returned without content, with a fault.
        """
        after = _text(self._read_to)
        try:
            answer: Any = self._redis.xread({RESULTS: after}, count=self._at_most, block=block_ms)
        except redis.ConnectionError:
            if self._at_most > 1:
                self._at_most //= 2
                raise
            self._cut_off += 1
            if self._cut_off < MAX_LOST_CONNECTIONS or (id := self._next_id()) is None:
                raise
            answer = {RESULTS: [(id, {})]}
        self._cut_off = 0
        self._guard()
        streams = list(answer.values()) if isinstance(answer, dict) else [entries for _, entries in answer or []]
        entries: list[Entry] = []
        for found in streams:
            # RESP3 nests a stream's entries one level deeper
            flat = found[0] if found and isinstance(found[0], list) else found
            entries += [_entry(id, fields) for id, fields in flat]
        self.was_full = len(entries) >= self._at_most
        if entries:
            self._read_to = _position(entries[-1].id)
            sizes = [len(entry.result.sums) for entry in entries if entry.result is not None and entry.result.sums]
            if sizes:
                mean = sum(sizes) / len(sizes)
                self.size += (mean - self.size) * (SMOOTHING if self.size else 1.0)
                self._at_most = int(max(1, min(MAX_ENTRIES, READ_BYTES / max(self.size, mean))))
        return entries

    def latest_position(self) -> Position:
        """Returns the position of the latest entry of the stream. Raises redis.RedisError.

        Does not use XINFO STREAM, whose reply includes the first and last entries, which may be large.
        """
        with self._redis.pipeline() as pipe:
            pipe.xgroup_destroy(RESULTS, CURSOR)
            pipe.xgroup_create(RESULTS, CURSOR, "$")
            pipe.xinfo_groups(RESULTS)
            pipe.xgroup_destroy(RESULTS, CURSOR)
            try:
                groups: Any = pipe.execute()[2]
            except redis.ResponseError:  # the stream does not exist
                return BEGINNING
        return max((_position(group["last-delivered-id"]) for group in groups), default=BEGINNING)

    def _next_id(self) -> bytes | None:
        """Returns the id of the next entry without reading its content; None if there is none. Raises redis.RedisError."""
        self._redis.xgroup_create(RESULTS, CURSOR, _text(self._read_to))
        try:
            with contextlib.suppress(redis.ConnectionError):  # Redis marks it as delivered although its content was cut off
                self._redis.xreadgroup(CURSOR, READER, {RESULTS: ">"}, count=1)
            pending: Any = self._redis.xpending_range(RESULTS, CURSOR, "-", "+", 1)
            return pending[0]["message_id"] if pending else None
        finally:
            self._redis.xgroup_destroy(RESULTS, CURSOR)

    def has_read(self, position: Position) -> bool:
        """Returns True if all entries up to this position were read."""
        return self._read_to >= position

    def length(self) -> int:
        """Returns the number of entries in the stream, read or unread. Raises redis.RedisError."""
        return int(self._redis.xlen(RESULTS))

    def repair(self) -> bool:
        """Restores a damaged stream so that it accepts entries. Returns whether that was necessary. Raises redis.RedisError.

        Deletes a key of another type, and an empty stream whose last id is far in the future.
        """
        if repair(self._redis, RESULTS, "stream"):
            self.reread()
            return True
        if self.latest_position()[0] <= time.time() * 1000 + MAX_FUTURE_MS:
            return False
        with self._redis.pipeline() as pipe:
            pipe.watch(RESULTS)
            if pipe.xlen(RESULTS):
                return False  # the entries in it are handled first
            pipe.multi()
            pipe.delete(RESULTS)
            try:
                pipe.execute()
            except redis.WatchError:
                return False
        self.reread()
        log.warning("the result stream was reset, since its last id was in the future")
        return True

    def reread(self) -> None:
        """Resets the reading position, so that the whole stream is read again."""
        self._read_to = BEGINNING

    def end_read(self) -> None:
        """Makes a blocking `read` return. Thread-safe. Errors of Redis are ignored, since they make `read` return too."""
        with contextlib.suppress(redis.RedisError):
            self._redis.xadd(RESULTS, {"event": json.dumps({"type": "wake"})})

    def delete(self, entries: list[Entry]) -> None:
        """Deletes entries whose content was stored. Raises redis.RedisError."""
        if entries:
            self._guard()
            self._redis.xdel(RESULTS, *[entry.id for entry in entries])


def _text(position: Position) -> str:
    return f"{position[0]}-{position[1]}"


def _position(id: bytes | str) -> Position:
    milliseconds, _, number = (id.decode() if isinstance(id, bytes) else id).partition("-")
    return int(milliseconds), int(number)


def _entry(id: bytes, fields: Any) -> Entry:
    size = sum(len(name) + len(value) for name, value in fields.items())
    if not fields or size > MAX_ENTRY_BYTES:
        found = f"{size:,} bytes" if fields else "more than Redis sends at once"
        return Entry(id, None, f"the entry is too large: {found}; at most {MAX_ENTRY_BYTES:,} are taken", {})
    try:
        return Entry(id, Result.from_fields(fields), "", fields)
    except Exception as error:  # invalid content must not block later entries
        return Entry(id, None, f"{type(error).__name__}: {error}", fields)
