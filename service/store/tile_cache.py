"""LRU cache of the unpacked sums of tiles, shared by all films.

Samples added to a cached tile stay pending, and are added up when the tile is read. A tile with too many pending additions is
evicted. So a film that grows without being read causes no additions.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable

from renderer.film import Sums

__all__ = ["TileCache"]

MAX_PENDING = 4

Key = tuple[str, int, int]  # film, frame, tile
AddPending = Callable[[Sums], None]  # adds pending samples to a tile's sums, in place


class TileCache:
    """An LRU cache limited in bytes. Its arrays are read-only, so readers need no lock."""

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self._bytes = 0
        self._items: OrderedDict[Key, Sums] = OrderedDict()
        self._pending: dict[Key, list[tuple[AddPending, int]]] = {}
        self._lock = threading.Lock()

    def get(self, key: Key) -> Sums | None:
        """Returns the sums of a tile, after adding its pending samples; None if they are not cached.

        key: film, frame and tile. Must not be called concurrently for the same tile.
        """
        with self._lock:
            sums, pending = self._items.get(key), self._pending.get(key, ())
            if sums is not None:
                self._items.move_to_end(key)
        if sums is None or not pending:
            return sums
        sums = sums.copy()
        for add, _ in pending:
            add(sums)
        self.put(key, sums)
        return sums

    def put(self, key: Key, sums: Sums) -> None:
        """Caches the sums of a tile, and evicts the least recently used tiles."""
        sums.flags.writeable = False
        with self._lock:
            self._remove(key)
            self._items[key] = sums
            self._bytes += sums.nbytes
            self._evict()

    def add_samples(self, key: Key, add: AddPending, size: int) -> None:
        """Adds samples to a cached tile in its next `get`. Does nothing if the tile is not cached.

        add: adds the samples to a tile's sums in place. size: bytes of memory that `add` occupies.
        """
        with self._lock:
            if key in self._items:
                pending = self._pending.setdefault(key, [])
                pending.append((add, size))
                self._bytes += size
                if len(pending) > MAX_PENDING:
                    self._remove(key)
                self._evict()

    def evict(self, key: Key) -> None:
        """Evicts one tile."""
        with self._lock:
            self._remove(key)

    def evict_film(self, film: str) -> None:
        """Evicts all tiles of a film."""
        with self._lock:
            for key in [k for k in self._items if k[0] == film]:
                self._remove(key)

    def _evict(self) -> None:
        while self._bytes > self.max_bytes and len(self._items) > 1:
            self._remove(next(iter(self._items)))

    def _remove(self, key: Key) -> None:
        if (sums := self._items.pop(key, None)) is not None:
            self._bytes -= sums.nbytes + sum(size for _, size in self._pending.pop(key, ()))
