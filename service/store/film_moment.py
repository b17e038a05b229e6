"""A consistent snapshot of a film, which stays readable while the film grows.

With SQLite's write-ahead log, a reader sees the file as it was when its transaction began. A snapshot is an open read
transaction: it does not slow down the writer, however slowly it is read.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol
from urllib.parse import quote

from renderer.cryptomatte import Hits, no_hits
from renderer.deep import Deep, no_deep
from renderer.film import Sums
from renderer.settings import Tile
from service.store.coverage import Coverage
from service.store.film_faults import damaged_film_error, film_faults
from service.store.film_version import sample_ranges
from service.store.tile_sums import deep_of_rows, hits_of_rows, sum_of_rows

__all__ = ["FilmSnapshotView", "ReadableFilm"]


class ReadableFilm(Protocol):
    """Interface for reading a film or a snapshot of one. Methods raise FilmUnavailable, FilmLost or FilmClosed."""

    width: int
    height: int
    film_exponent: int
    tiles: list[Tile]
    groups: tuple[str, ...]  # names of its light groups (RenderSettings.group_names)
    ranks: int  # RenderSettings.cryptomatte
    deep: int  # RenderSettings.deep
    is_transparent: bool  # RenderSettings.is_transparent: whether the last planes are those of the alpha

    def coverage(self, frame: int, tile: int) -> Coverage:
        """Returns the stored sample ranges of a tile."""

    def tile_planes(self, frame: int, tile: int, planes: Sequence[int]) -> Sums | None:
        """Returns a tile's sums, (planes, h, w) int64, or None if it has no samples.

        planes: indices of the channels to read. Other channels are undefined.
        """

    def tile_hits(self, frame: int, tile: int) -> Hits:
        """Returns Cryptomatte's counts of a tile; empty if there are none."""

    def tile_deep(self, frame: int, tile: int) -> Deep:
        """Returns the deep pixels of a tile; empty if there are none."""


class FilmSnapshotView:
    """A snapshot of a film, as a context manager: leaving the block ends the snapshot.

    May be opened in one thread and used in another, but not concurrently.
    """

    def __init__(
        self,
        path: Path,
        width: int,
        height: int,
        film_exponent: int,
        tiles: list[Tile],
        groups: tuple[str, ...] = (),
        ranks: int = 0,
        is_transparent: bool = False,
        deep: int = 0,
    ) -> None:
        """Opens a snapshot of an existing film file. Raises FilmUnavailable or FilmLost."""
        self.width, self.height, self.film_exponent, self.tiles, self.groups = width, height, film_exponent, tiles, groups
        self.ranks, self.is_transparent, self.deep = ranks, is_transparent, deep
        self._coverage: dict[tuple[int, int], Coverage] | None = None
        with film_faults():
            self._database = sqlite3.connect(
                f"file:{quote(str(path))}?mode=ro", uri=True, check_same_thread=False, isolation_level=None, timeout=0.1
            )
            try:
                self._database.execute("BEGIN")
                self._database.execute("SELECT 1 FROM part LIMIT 1").fetchall()  # the transaction begins with the first read
            except BaseException:
                self._database.close()
                raise

    def __enter__(self) -> FilmSnapshotView:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the snapshot's transaction."""
        self._database.close()

    def coverage(self, frame: int, tile: int) -> Coverage:
        """Returns the sample ranges that the snapshot has of a tile."""
        if self._coverage is None:
            self._coverage = {}
            try:
                with film_faults():
                    rows = self._database.execute("SELECT frame, tile, first, count, ranges FROM part").fetchall()
                for of_frame, of_tile, *samples in rows:
                    for span in sample_ranges(*samples):
                        self._coverage.setdefault((of_frame, of_tile), Coverage()).add(*span)
            except (ValueError, TypeError) as error:
                raise damaged_film_error(str(error)) from error
        return self._coverage.get((frame, tile)) or Coverage()

    def tile_planes(self, frame: int, tile: int, planes: Sequence[int]) -> Sums | None:
        """Returns a tile's sums, (channels, h, w) int64; None if it has no samples. Channels not in `planes` are undefined."""
        rows = self._packed_rows(frame, tile)
        return sum_of_rows(rows, self.tiles[tile], planes) if rows else None

    def tile_hits(self, frame: int, tile: int) -> Hits:
        """Returns Cryptomatte's counts of a tile; empty if there are none."""
        return hits_of_rows(self._packed_rows(frame, tile), self.tiles[tile]) or no_hits()

    def tile_deep(self, frame: int, tile: int) -> Deep:
        """Returns the deep pixels of a tile; empty if there are none."""
        return deep_of_rows(self._packed_rows(frame, tile), self.tiles[tile]) or no_deep(self.deep)

    def _packed_rows(self, frame: int, tile: int) -> list[bytes]:
        with film_faults():
            rows = self._database.execute("SELECT sums FROM part WHERE frame = ? AND tile = ?", (frame, tile)).fetchall()
        return [packed for (packed,) in rows]
