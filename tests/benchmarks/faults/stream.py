"""Reads workers' results in parallel with the service, to count batches that arrive twice and collect results to send again."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import redis

from protocol.contract import RESULTS

__all__ = ["Stream"]

KEPT = 40
Fields = dict[bytes, bytes]


class Stream:
    """A thread that reads the stream of results; a context manager."""

    def __init__(self, connect: Callable[[], redis.Redis]) -> None:
        self._connect = connect
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._seen: set[tuple[Any, ...]] = set()
        self._read: set[tuple[bytes, bytes | None]] = set()
        self._forged: list[Fields] = []
        self.latest: deque[Fields] = deque(maxlen=KEPT)
        self.batches = 0
        self.repeated = 0  # batches with samples that had arrived before

    def __enter__(self) -> Stream:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(15)

    def forge(self, store: redis.Redis, fields: Fields) -> None:
        """Appends a forged result to the stream; the forged result is not counted as a repeated batch."""
        self._forged.append(fields)
        store.xadd(RESULTS, fields)  # type: ignore[arg-type]

    def _run(self) -> None:
        last: bytes | str = "0"
        store: redis.Redis | None = None
        while not self._stop.is_set():
            try:
                store = store or self._connect()
                for _, entries in store.xread({RESULTS: last}, block=300, count=64) or []:  # type: ignore[union-attr, misc]
                    for id, fields in entries:
                        last = id
                        if (id, fields.get(b"event")) not in self._read:  # after a lost connection all entries are read again
                            self._read.add((id, fields.get(b"event")))
                            self._note(fields)
            except (redis.RedisError, OSError, ValueError):
                store = None  # Redis was killed or replaced, and entry ids start again
                last = "0"
                time.sleep(0.1)

    def _note(self, fields: Fields) -> None:
        if fields in self._forged:
            self._forged.remove(fields)
            return
        try:
            event = json.loads(fields[b"event"])
            if event["type"] != "batch":
                return
            samples = [
                (event["job"], event["frame"], *event["tile"], n) for n in range(event["first"], event["first"] + event["count"])
            ]
        except (KeyError, ValueError, TypeError):
            return
        self.latest.append(fields)
        self.batches += 1
        self.repeated += any(sample in self._seen for sample in samples)
        self._seen.update(samples)
