"""A film's file: an SQLite database of rows, each with the sums of samples of one tile.

Every change is one transaction. Every fault is raised as FilmUnavailable or FilmLost.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sqlite3
import weakref
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from renderer.sentences import Sentence
from service.errors import FarmError
from service.store.film_faults import damaged_film_error, damaged_samples_error, film_faults, owned_elsewhere_error
from service.store.film_version import (
    FilmShape,
    Row,
    checksum,
    create_or_migrate,
    is_up_to_date,
    matches_checksum,
    sample_ranges,
    select_rows,
)

__all__ = ["FilmFile", "RowHead", "head_sample_ranges"]

LOCK_TIMEOUT_S = 0.1  # seconds; the engine's thread must not wait longer for one film
MAX_BAD_KEPT = 1000
FRAMES_PER_DELETION = 100  # frames deleted in one transaction
MAX_BAD_SHOWN = 64

PRAGMAS = ("page_size=32768", "journal_mode=WAL", "synchronous=NORMAL", "wal_autocheckpoint=2000", "secure_delete=OFF")

ROWS = select_rows()
COLUMNS = "frame, tile, first, count, bad, sums, workers, ranges, checksum"
PART = f"INSERT INTO part ({COLUMNS}) VALUES ({', '.join('?' * 9)})"

log = logging.getLogger(__name__)


class RowHead(NamedTuple):
    """The metadata of a film's row: its columns without sums and checksum (see service/store/film_version.py)."""

    frame: int
    tile: int
    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which is unused
    bad: int
    workers: str | None
    ranges: str | None


class FilmFile:
    """One connection to a film's file. Not thread-safe."""

    def __init__(self, path: Path, shape: FilmShape, epoch: int | None = None) -> None:
        """Opens the file; creates or migrates it if needed.

        shape: layout of the film's sums. epoch: number of this service's ownership of the farm. Writes raise FilmUnavailable
        after a service with a greater epoch has written; None: no such check. Raises FilmUnavailable or FilmLost.
        """
        self._is_held = False  # whether another program held the lock at the last try
        self._epoch = epoch
        self._is_claimed = epoch is None
        with film_faults():
            os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600))  # -wal and -shm get the same mode
            self._database = sqlite3.connect(path, check_same_thread=False, isolation_level=None, timeout=LOCK_TIMEOUT_S)
            self._close = weakref.finalize(self, self._database.close)
            try:
                # NORMAL loses nothing when the process is killed; a power cut may lose the latest parts, which are then rendered
                # again. Large pages and rare checkpoints suit large rows: three times less work per row (measured).
                # secure_delete, on in some builds of SQLite, would overwrite all folded rows with zeros.
                for pragma in PRAGMAS:
                    self._database.execute(f"PRAGMA {pragma}").close()
                if not is_up_to_date(self._database, shape):
                    with self._transaction():
                        create_or_migrate(self._database, shape)
            except BaseException:
                self.close()
                raise

    def claim(self) -> bool:
        """Writes this service's epoch to the file, so that services with a smaller epoch can no longer write.

        Returns True in the first call; then cached contents of the film must be read again. Raises FilmUnavailable, also if a
        service with a greater epoch owns the film.
        """
        if self._is_claimed:
            return False
        with film_faults(), self._transaction():
            pass
        return True

    def close(self) -> None:
        """Closes the file. If its write-ahead log cannot be merged now, the log file remains, and no committed row is lost."""
        with contextlib.suppress(sqlite3.Error):
            self._close()

    def checkpoint(self) -> None:
        """Merges the write-ahead log into the database file if possible. A failure is only logged."""
        try:
            with film_faults():
                self._database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        except FarmError as error:
            log.info("the write-ahead log of a film cannot be merged: %s", error)

    def row_heads(self) -> list[RowHead]:
        """Returns the heads of all rows."""
        with film_faults():
            found = self._database.execute("SELECT frame, tile, first, count, bad, workers, ranges FROM part").fetchall()
        return [RowHead(*head) for head in found]

    def sums(self, frame: int, tile: int) -> Iterator[bytes]:
        """Yields the packed sums of a tile's rows. Raises FilmLost if a row does not match its checksum."""
        with film_faults():
            for row in self._database.execute(f"{ROWS} WHERE frame = ? AND tile = ?", (frame, tile)):
                yield _sums(row)

    def sums_of(self, heads: Iterable[RowHead]) -> Iterator[bytes]:
        """Yields the packed sums of the rows with these heads, all of one tile.

        Raises FilmLost if a row is missing or does not match its checksum.
        """
        with film_faults():
            for head in heads:
                where = head[:3]
                row = self._database.execute(f"{ROWS} WHERE frame = ? AND tile = ? AND first = ?", where).fetchone()
                if row is None:
                    raise damaged_film_error(
                        Sentence(
                            "film-samples-lost",
                            "samples from {first} on of tile {tile} are missing",
                            first=head.first,
                            tile=head.tile,
                        )
                    )
                yield _sums(row)

    def bad_samples(self, frame: int) -> tuple[int, list[tuple[int, int, int]]]:
        """Returns the number of bad samples (NaN or infinite) of a frame, and (x, y, sample) of up to MAX_BAD_SHOWN of them."""
        with film_faults():
            (count,) = self._database.execute("SELECT coalesce(sum(bad), 0) FROM part WHERE frame = ?", (frame,)).fetchone()
            first = self._database.execute(
                "SELECT x, y, sample FROM bad_sample WHERE frame = ? LIMIT ?", (frame, MAX_BAD_SHOWN)
            ).fetchall()
        return int(count), first

    def add(
        self,
        rows: list[Row],
        bad: list[tuple[int, int, int, int]],
        replaced: Sequence[tuple[RowHead, tuple[int, int, int, int]]] = (),
    ) -> None:
        """Adds rows, and the records of bad samples (frame, x, y, sample), in one transaction.

        replaced: rows to delete in the same transaction, each with its tile's (x, y, w, h); the records of their bad samples
        are deleted too. At most MAX_BAD_KEPT records are stored.
        """
        with film_faults(), self._transaction():
            if replaced:
                self._delete_rows([head for head, _ in replaced])
            for head, area in replaced:
                for span in sample_ranges(head.first, head.count, head.ranges):
                    self._delete_bad_samples(head.frame, area, *span)
            self._database.executemany(PART, [(*row, checksum(row)) for row in rows])
            if bad:
                (kept,) = self._database.execute("SELECT count(*) FROM bad_sample").fetchone()
                self._database.executemany("INSERT INTO bad_sample VALUES (?, ?, ?, ?)", bad[: max(0, MAX_BAD_KEPT - kept)])

    def fold_rows(self, heads: Sequence[RowHead], row: Row, are_all: bool) -> bool:
        """Replaces the rows with these heads by one row. Returns False, and changes nothing, if they are not all stored.

        are_all: whether to require also that these are all rows of the tile.
        """
        with film_faults(), self._transaction():
            there = self._database.execute("SELECT first, count FROM part WHERE frame = ? AND tile = ?", row[:2]).fetchall()
            folded = {head[2:4] for head in heads}
            if not folded <= set(there) or (are_all and len(there) != len(heads)):
                return False
            self._delete_rows(heads)
            self._database.execute(PART, (*row, checksum(row)))
        return True

    def delete_frames(self, frames: Iterable[int]) -> None:
        """Deletes the rows and bad samples of these frames, in transactions of FRAMES_PER_DELETION frames."""
        left = iter([(frame,) for frame in frames])
        while some := list(islice(left, FRAMES_PER_DELETION)):
            with film_faults(), self._transaction():
                self._database.executemany("DELETE FROM part WHERE frame = ?", some)
                self._database.executemany("DELETE FROM bad_sample WHERE frame = ?", some)

    def row(self, frame: int, tile: int, first: int) -> Row | None:
        """Returns the row of a tile that begins with sample `first`; None if it is missing or does not match its checksum.

        Raises FilmLost if the file cannot be read there.
        """
        with film_faults():
            where = (frame, tile, first)
            found = self._database.execute(f"{ROWS} WHERE frame = ? AND tile = ? AND first = ?", where).fetchone()
        return found[:8] if found is not None and matches_checksum(found[:8], found[8]) else None

    def delete_rows(self, heads: Iterable[RowHead]) -> None:
        """Deletes the rows with these heads."""
        with film_faults(), self._transaction():
            self._delete_rows(heads)

    def _delete_rows(self, heads: Iterable[RowHead]) -> None:
        where = [head[:3] for head in heads]
        self._database.executemany("DELETE FROM part WHERE frame = ? AND tile = ? AND first = ?", where)

    def delete_bad_samples(self, frame: int, area: tuple[int, int, int, int], first: int, count: int) -> None:
        """Deletes the records of bad samples first ... first + count - 1 of the pixels in `area` (x, y, w, h)."""
        with film_faults(), self._transaction():
            self._delete_bad_samples(frame, area, first, count)

    def _delete_bad_samples(self, frame: int, area: tuple[int, int, int, int], first: int, count: int) -> None:
        x, y, w, h = area
        bounds = (frame, x, x + w - 1, y, y + h - 1, first, first + count - 1)
        self._database.execute(
            "DELETE FROM bad_sample WHERE frame = ? AND x BETWEEN ? AND ? AND y BETWEEN ? AND ? AND sample BETWEEN ? AND ?",
            bounds,
        )

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._begin()
        try:
            if self._epoch is not None:
                self._fence(self._epoch)
            yield
            self._database.execute("COMMIT")
            self._is_claimed = True
        except BaseException:
            with contextlib.suppress(sqlite3.Error):  # after some faults SQLite has already rolled back
                self._database.rollback()
            raise

    def _fence(self, epoch: int) -> None:
        """Checks that this service may write to the film, and stores its epoch. Called within a transaction.

        Raises FilmUnavailable if a service with a greater epoch owns the film.
        """
        if not self._is_claimed:
            self._database.execute("CREATE TABLE IF NOT EXISTS owner (epoch INTEGER)")
        found = self._database.execute("SELECT epoch FROM owner").fetchone()
        if found is not None and found[0] > epoch:
            raise owned_elsewhere_error()
        if found is None or found[0] < epoch:
            self._database.execute("DELETE FROM owner")
            self._database.execute("INSERT INTO owner VALUES (?)", (epoch,))

    def _begin(self) -> None:
        """Begins a writing transaction.

        If the film was locked in the previous attempt, does not wait for the lock. Otherwise many locked films would block the
        engine's thread.
        """
        try:
            self._database.execute("BEGIN IMMEDIATE")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY and not self._is_held:
                self._set_lock_timeout(0.0)
            raise
        if self._is_held:
            self._set_lock_timeout(LOCK_TIMEOUT_S)

    def _set_lock_timeout(self, seconds: float) -> None:
        self._is_held = not seconds
        self._database.execute(f"PRAGMA busy_timeout={round(seconds * 1000)}").close()


def _sums(row: tuple[Any, ...]) -> bytes:
    if not matches_checksum(row[:8], row[8]):
        raise damaged_samples_error(row[2], row[1])
    sums: bytes = row[5]
    return sums


def head_sample_ranges(head: RowHead) -> list[tuple[int, int]]:
    """Returns the sample ranges of a row, as (first, count). Raises FilmLost if they are invalid."""
    try:
        return sample_ranges(head.first, head.count, head.ranges)
    except (ValueError, TypeError) as error:
        raise damaged_film_error(str(error)) from error
