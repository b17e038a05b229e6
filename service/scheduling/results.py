"""The one reader of the stream on which workers answer. An entry is deleted only after its content is stored."""

from __future__ import annotations

import contextlib
import json
import logging
from dataclasses import dataclass
from typing import Any

import redis

from worker.contract import RESULTS, Result

__all__ = ["WAKE", "Entry", "Results"]

log = logging.getLogger(__name__)

WAKE = "wake"  # the type of an event that says nothing else
AT_MOST = 64  # entries a read: bounds memory, and the time until the next look at the queue


@dataclass(frozen=True)
class Entry:
    """An entry of the stream; `result` is None where it cannot be understood."""

    id: bytes
    result: Result | None


class Results:
    """Reads the stream from its beginning: what is there has not been stored yet."""

    def __init__(self, connection: redis.Redis) -> None:
        self._redis = connection

    def read(self, block_ms: int) -> list[Entry]:
        """The oldest entries, waiting at most `block_ms` for one. Raises redis.RedisError."""
        answer: Any = self._redis.xread({RESULTS: "0-0"}, count=AT_MOST, block=block_ms)
        streams = list(answer.values()) if isinstance(answer, dict) else [entries for _, entries in answer or []]
        entries: list[Entry] = []
        for found in streams:
            # RESP3 nests a stream's entries one level deeper
            flat = found[0] if found and isinstance(found[0], list) else found
            entries += [Entry(id, _parse(fields)) for id, fields in flat]
        return entries

    def wake(self) -> None:
        """Let a `read` that waits return now; from any thread. Where Redis is away, the reader wakes up by itself."""
        with contextlib.suppress(redis.RedisError):
            self._redis.xadd(RESULTS, {"event": json.dumps({"type": WAKE})})

    def delete(self, entries: list[Entry]) -> None:
        """Trim what has been stored. Raises redis.RedisError; then it is read, and dropped as a duplicate, again."""
        if entries:
            self._redis.xdel(RESULTS, *[entry.id for entry in entries])


def _parse(fields: dict[bytes, bytes]) -> Result | None:
    try:
        result = Result.from_fields(fields)
        if not isinstance(result.event.get("type"), str):
            raise ValueError("no type")
    except (KeyError, ValueError, AttributeError, TypeError) as error:
        log.warning("an entry of the result stream is left out: %s", error)
        return None
    return result
