"""Verifies a film's file against its checksums while others use it, and reads the intact rows of a damaged film."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from renderer.settings import tiles_of
from service.errors import FarmError
from service.store.film_faults import damaged_samples_error, film_faults
from service.store.film_version import FilmShape, Row, is_up_to_date, matches_checksum, select_rows

__all__ = ["film_samples", "open_film_file", "readable_rows"]

LOCK_TIMEOUT_S = 5.0


def film_samples(path: Path, shape: FilmShape) -> Counter[int]:
    """Reads and verifies a whole film. Returns the number of samples of each frame, by key, summed over its pixels.

    Rows without a checksum (films of older releases) are accepted. Raises FilmDamaged, FilmLost or FilmUnavailable.
    """
    tiles = tiles_of(shape.width, shape.height, shape.tile_size)
    found: Counter[int] = Counter()
    with film_faults(), closing(open_film_file(path)) as database:
        is_up_to_date(database, shape)
        for *row, known in database.execute(select_rows(_version(database))):
            frame, tile, first, count = row[:4]
            if not isinstance(tile, int) or not 0 <= tile < len(tiles) or not matches_checksum(tuple(row), known):
                raise damaged_samples_error(first, tile)
            found[frame] += count * tiles[tile].w * tiles[tile].h
    return found


def readable_rows(path: Path, shape: FilmShape) -> Iterator[Row]:
    """Yields the rows of a damaged film that are readable and match their checksums. Yields none if the file is unreadable."""
    try:
        with closing(open_film_file(path)) as database:
            is_up_to_date(database, shape)
            rows = select_rows(_version(database))
            (last,) = database.execute("SELECT coalesce(max(rowid), 0) FROM part").fetchone()
            for rowid in range(1, last + 1):
                try:
                    found = database.execute(f"{rows} WHERE rowid = ?", (rowid,)).fetchone()
                except sqlite3.DatabaseError:
                    continue
                if found is not None and found[8] is not None and matches_checksum(found[:8], found[8]):
                    yield found[:8]
    except (sqlite3.DatabaseError, FarmError):
        return


def open_film_file(path: Path) -> sqlite3.Connection:
    """Opens an additional connection to an existing film file."""
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", uri=True, timeout=LOCK_TIMEOUT_S)


def _version(database: sqlite3.Connection) -> int:
    (version,) = database.execute("PRAGMA user_version").fetchone()
    return int(version)
