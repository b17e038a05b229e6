"""Films on disk: the exact sums of every batch, each taken once.

A job's film is one SQLite file. A merged batch is one row: its tile, its range of sample numbers, and its packed sums as
they came. The row is the sums and the record that they are in, in one write, so nothing can be half merged; and the order
of rows does not matter, since integers add exactly. Tiles with many rows are folded into one.
"""

from __future__ import annotations

import hashlib
import sqlite3
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer import aovs, film
from renderer.film import CHANNELS, BadSample, Sums
from renderer.settings import Tile, tiles_of
from service.api.problem import Problem
from service.store.coverage import Coverage
from worker.contract import pack_sums, unpack_sums

__all__ = ["Film", "FilmClosed", "Part", "TileCache"]

FOLD_AT = 8  # rows of a tile
IN_MEMORY_BYTES = 256 << 20
MAX_BAD_KEPT = 1000

SCHEMA = """
CREATE TABLE IF NOT EXISTS part (
    frame INTEGER, tile INTEGER, first INTEGER, count INTEGER, bad INTEGER, sums BLOB,
    PRIMARY KEY (frame, tile, first));
CREATE TABLE IF NOT EXISTS bad_sample (frame INTEGER, x INTEGER, y INTEGER, sample INTEGER);
"""


class FilmClosed(Problem):
    """The film was closed under its reader: its job was deleted, or the service ends."""

    def __init__(self) -> None:
        super().__init__(404, "The job was deleted while its picture was read.")


@dataclass(frozen=True)
class Part:
    """A batch's contribution: samples first ... first + count - 1 of a tile (by its index), packed by worker.contract."""

    frame: int
    tile: int
    first: int
    count: int
    sums: bytes
    bad: list[BadSample] = field(default_factory=list)
    bad_count: int = 0


class TileCache:
    """Sums of the tiles used latest, of all films together. The arrays are read-only, so readers need no lock."""

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self._bytes = 0
        self._items: OrderedDict[tuple[str, int, int], Sums] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: tuple[str, int, int]) -> Sums | None:
        """The sums, or None where they were forgotten."""
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

    def forget(self, name: str, frame: int | None = None, tile: int | None = None) -> None:
        """Forget a film's tiles, or one of them."""
        with self._lock:
            for key in [k for k in self._items if k[0] == name and (frame is None or k[1:] == (frame, tile))]:
                self._bytes -= self._items.pop(key).nbytes


class Film:
    """The film of a job: its frames' tiles, which samples of them are in, and their sums. Safe to use from several threads."""

    def __init__(self, path: Path, width: int, height: int, tile_size: int, film_exponent: int, cache: TileCache) -> None:
        self.path = path
        self.width = width
        self.height = height
        self.film_exponent = film_exponent
        self.tiles = tiles_of(width, height, tile_size)
        self._index = {tile: i for i, tile in enumerate(self.tiles)}
        self._cache = cache
        self._lock = threading.RLock()
        self._is_closed = False
        self._database = sqlite3.connect(path, check_same_thread=False, isolation_level=None, timeout=30)
        # NORMAL: a killed process loses nothing; a power cut may lose the latest parts, which are then rendered again.
        # Large pages and rare checkpoints, since rows are large: three times less work a row (measured).
        for pragma in ("page_size=32768", "journal_mode=WAL", "synchronous=NORMAL", "wal_autocheckpoint=2000"):
            self._database.execute(f"PRAGMA {pragma}")
        self._database.executescript(SCHEMA)
        self._coverage: dict[tuple[int, int], Coverage] = {}
        self._rows: dict[tuple[int, int], int] = {}
        self._load_coverage()

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._is_closed = True
            self._database.close()
            self._cache.forget(self.path.stem)

    def settle(self) -> None:
        """Bring all into the one file, where the film is likely to rest."""
        with self._lock:
            self._database.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def index_of(self, tile: Tile) -> int | None:
        """A tile's place in `tiles`, or None where the film has no such tile."""
        return self._index.get(tile)

    def coverage(self, frame: int, tile: int) -> Coverage:
        """Which samples of a tile are in; a copy."""
        with self._lock:
            return Coverage((a, b - a) for a, b in self._cover(frame, tile).ranges)

    def samples(self, frame: int) -> int:
        """The samples of a frame that are in, all pixels together, bad ones included."""
        with self._lock:
            return sum(c.total * self.tiles[t].w * self.tiles[t].h for (f, t), c in self._coverage.items() if f == frame)

    def version(self, frame: int) -> str:
        """A name for the frame's content: it changes with every sample that is added."""
        with self._lock:
            covered = sorted((t, c.ranges) for (f, t), c in self._coverage.items() if f == frame)
        return hashlib.sha256(repr(covered).encode()).hexdigest()[:20]

    def bad_samples(self, frame: int) -> tuple[int, list[BadSample]]:
        """How many samples were NaN or infinite and left out, and the first of them."""
        with self._lock:
            (count,) = self._database.execute("SELECT coalesce(sum(bad), 0) FROM part WHERE frame = ?", (frame,)).fetchone()
            rows = self._database.execute("SELECT x, y, sample FROM bad_sample WHERE frame = ? LIMIT 64", (frame,)).fetchall()
        return int(count), [BadSample(*row) for row in rows]

    def merge(self, parts: Iterable[Part]) -> list[bool]:
        """Add parts in one transaction; for each, whether it was taken.

        A part that overlaps what is in the film is dropped: it came twice, or a part of it did. So is one whose tile the
        film does not have or whose sums are damaged.
        """
        with self._lock:
            taken = [self._stage(part) for part in parts]
            new = [s for s in taken if s is not None]
            if not new:
                return [False] * len(taken)
            try:
                with self._transaction():
                    self._insert([part for part, _ in new])
            except BaseException:
                self._load_coverage()
                raise
            for part, sums in new:
                self._remember(part, sums)
            for key in {(part.frame, part.tile) for part, _ in new}:
                if self._rows[key] >= FOLD_AT:
                    self._fold(*key)
            return [s is not None for s in taken]

    def tile_sums(self, frame: int, tile: int) -> Sums | None:
        """A tile's sums (CHANNELS, h, w) int64, read-only; None where no sample is in yet. Raises FilmClosed."""
        key = (self.path.stem, frame, tile)
        with self._lock:
            if self._is_closed:
                raise FilmClosed
            if not self._cover(frame, tile).ranges:
                return None
            sums = self._cache.get(key)
            if sums is None:
                sums = self._read(frame, tile)
                self._cache.put(key, sums)
            return sums

    def channel(self, frame: int, channel: slice | int = film.COLOR) -> npt.NDArray[np.float32]:
        """The frame's mean of a channel, as renderer.film.mean; 0 where no sample is."""
        size = (self.height, self.width)
        out = np.zeros(size if isinstance(channel, int) else (*size, 3), np.float32)
        return self.each(frame, lambda sums: film.mean(sums, self.film_exponent, channel), out)

    def aov(self, frame: int, name: str) -> npt.NDArray[np.float32]:
        """The frame's plane of this name, as renderer.aovs.values; 0 where no sample is."""
        out = np.zeros((self.height, self.width, 3) if name in aovs.VECTORS else (self.height, self.width), np.float32)
        return self.each(frame, lambda sums: aovs.values(sums, self.film_exponent, name), out)

    def each(self, frame: int, of: Callable[[Sums], npt.NDArray[Any]], out: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Fill `out` (h, w, ...) tile by tile with a function of their sums; tiles without samples stay as they are."""
        for i, tile in enumerate(self.tiles):
            sums = self.tile_sums(frame, i)
            if sums is not None:
                out[tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] = of(sums)
        return out

    def digest(self, frame: int) -> str:
        """renderer.film.digest of the whole frame. Frames that are large for the memory are laid out in a file."""
        shape = (CHANNELS, self.height, self.width)
        if CHANNELS * self.height * self.width * 8 <= IN_MEMORY_BYTES:
            return film.digest(self._fill(frame, np.zeros(shape, np.int64)))
        with tempfile.TemporaryFile(dir=self.path.parent) as file:
            sums = self._fill(frame, np.memmap(file, np.int64, "w+", shape=shape))
            digest = hashlib.sha256()
            for plane in sums:
                digest.update(np.ascontiguousarray(plane, "<i8").data)
            return digest.hexdigest()

    def _fill(self, frame: int, out: Sums) -> Sums:
        for i, tile in enumerate(self.tiles):
            sums = self.tile_sums(frame, i)
            if sums is not None:
                out[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] = sums
        return out

    def _cover(self, frame: int, tile: int) -> Coverage:
        return self._coverage.setdefault((frame, tile), Coverage())

    def _load_coverage(self) -> None:
        self._coverage.clear()
        self._rows.clear()
        for frame, tile, first, count in self._database.execute("SELECT frame, tile, first, count FROM part"):
            self._cover(frame, tile).add(first, count)
            self._rows[frame, tile] = self._rows.get((frame, tile), 0) + 1

    def _stage(self, part: Part) -> tuple[Part, Sums] | None:
        """Check a part and claim its range; None where it is not to be taken."""
        if not 0 <= part.tile < len(self.tiles) or part.first < 0 or part.count < 1:
            return None
        coverage = self._cover(part.frame, part.tile)
        if coverage.overlaps(part.first, part.count):
            return None
        try:
            sums = unpack_sums(part.sums, self.tiles[part.tile])
        except ValueError:
            return None
        coverage.add(part.first, part.count)
        return part, sums

    def _insert(self, parts: list[Part]) -> None:
        self._database.executemany(
            "INSERT INTO part VALUES (?, ?, ?, ?, ?, ?)",
            [(p.frame, p.tile, p.first, p.count, p.bad_count, p.sums) for p in parts],
        )
        bad = [(p.frame, *sample) for p in parts for sample in p.bad]
        if bad:
            (kept,) = self._database.execute("SELECT count(*) FROM bad_sample").fetchone()
            self._database.executemany("INSERT INTO bad_sample VALUES (?, ?, ?, ?)", bad[: max(0, MAX_BAD_KEPT - kept)])

    def _remember(self, part: Part, sums: Sums) -> None:
        where = (part.frame, part.tile)
        key = (self.path.stem, *where)
        self._rows[where] = self._rows.get(where, 0) + 1
        old = self._cache.get(key)
        if old is not None:
            self._cache.put(key, old + sums)
        elif self._rows[where] == 1:
            self._cache.put(key, sums)

    def _read(self, frame: int, tile: int) -> Sums:
        total: Sums | None = None
        rows = self._database.execute("SELECT sums FROM part WHERE frame = ? AND tile = ?", (frame, tile))
        for (packed,) in rows:
            sums = unpack_sums(packed, self.tiles[tile], stored=True)
            total = sums if total is None else total + sums
        assert total is not None
        return total

    def _fold(self, frame: int, tile: int) -> None:
        """Make one row of a tile's rows. Only where its samples are one run: a row is one range."""
        ranges = self._cover(frame, tile).ranges
        if len(ranges) != 1:
            return
        sums = self.tile_sums(frame, tile)
        assert sums is not None
        where = (frame, tile)
        with self._transaction():
            (bad,) = self._database.execute("SELECT sum(bad) FROM part WHERE frame = ? AND tile = ?", where).fetchone()
            self._database.execute("DELETE FROM part WHERE frame = ? AND tile = ?", where)
            first, end = ranges[0]
            self._database.execute(
                "INSERT INTO part VALUES (?, ?, ?, ?, ?, ?)", (*where, first, end - first, bad, pack_sums(sums))
            )
        self._rows[where] = 1

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._database.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")
