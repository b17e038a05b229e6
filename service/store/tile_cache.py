"""Sums of the tiles used latest, of all films together."""

from __future__ import annotations

import threading
from collections import OrderedDict

from renderer.film import Sums

__all__ = ["TileCache"]


class TileCache:
    """An LRU bounded in bytes. The arrays are read-only, so readers need no lock."""

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self._bytes = 0
        self._items: OrderedDict[tuple[str, int, int], Sums] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: tuple[str, int, int]) -> Sums | None:
        """The sums of (film, frame, tile), or None where they were forgotten."""
        with self._lock:
            if key in self._items:
                self._items.move_to_end(key)
            return self._items.get(key)

    def put(self, key: tuple[str, int, int], sums: Sums) -> None:
        """Keep sums, and forget what was not used longest."""
        sums.flags.writeable = False
        with self._lock:
            old = self._items.pop(key, None)
            self._items[key] = sums
            self._bytes += sums.nbytes - (0 if old is None else old.nbytes)
            while self._bytes > self.max_bytes and len(self._items) > 1:
                self._bytes -= self._items.popitem(last=False)[1].nbytes

    def forget(self, film: str) -> None:
        """Forget a film's tiles."""
        with self._lock:
            for key in [k for k in self._items if k[0] == film]:
                self._bytes -= self._items.pop(key).nbytes
