"""A film as it is at one moment, read while it grows on.

SQLite's write-ahead log lets a reader see the file as it was when its transaction began, whatever is written meanwhile. So the
moment is taken by beginning a transaction, which costs the writer nothing, and may be read as slowly as its reader likes.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol
from urllib.parse import quote

from renderer.film import Sums
from renderer.settings import Tile
from service.store.added import added_up
from service.store.coverage import Coverage
from service.store.film_faults import damaged, film_faults
from service.store.film_version import spans

__all__ = ["FilmMoment", "Readable"]


class Readable(Protocol):
    """What is read of a film, or of a moment of it. Whatever reads raises FilmWaits, FilmLost or FilmClosed."""

    width: int
    height: int
    film_exponent: int
    tiles: list[Tile]

    def coverage(self, frame: int, tile: int) -> Coverage:
        """Which samples of a tile are in."""

    def tile_planes(self, frame: int, tile: int, planes: Sequence[int]) -> Sums | None:
        """These planes of a tile's sums (CHANNELS, h, w) int64; None where no sample is in."""


class FilmMoment:
    """Begun in one thread and read in another, by one at a time. A context: in the end the moment is let go."""

    def __init__(self, path: Path, width: int, height: int, film_exponent: int, tiles: list[Tile]) -> None:
        """Of a film's file that is there. Raises FilmWaits or FilmLost."""
        self.width, self.height, self.film_exponent, self.tiles = width, height, film_exponent, tiles
        self._coverage: dict[tuple[int, int], Coverage] | None = None
        with film_faults():
            self._database = sqlite3.connect(
                f"file:{quote(str(path))}?mode=ro", uri=True, check_same_thread=False, isolation_level=None, timeout=0.1
            )
            try:
                self._database.execute("BEGIN")
                self._database.execute("SELECT 1 FROM part LIMIT 1").fetchall()  # only what reads begins the moment
            except BaseException:
                self._database.close()
                raise

    def __enter__(self) -> FilmMoment:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Let the moment go."""
        self._database.close()

    def coverage(self, frame: int, tile: int) -> Coverage:
        """See Readable."""
        if self._coverage is None:
            self._coverage = {}
            try:
                with film_faults():
                    rows = self._database.execute("SELECT frame, tile, first, count, ranges FROM part").fetchall()
                for of_frame, of_tile, *samples in rows:
                    for span in spans(*samples):
                        self._coverage.setdefault((of_frame, of_tile), Coverage()).add(*span)
            except (ValueError, TypeError) as error:
                raise damaged(str(error)) from error
        return self._coverage.get((frame, tile)) or Coverage()

    def tile_planes(self, frame: int, tile: int, planes: Sequence[int]) -> Sums | None:
        """See Readable."""
        with film_faults():
            rows = self._database.execute("SELECT sums FROM part WHERE frame = ? AND tile = ?", (frame, tile)).fetchall()
        return added_up((packed for (packed,) in rows), self.tiles[tile], planes) if rows else None
