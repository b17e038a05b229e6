"""A film's file: the rows of one SQLite database. Every change is one transaction; every fault is FilmWaits or FilmLost."""

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

from service.errors import FarmError
from service.store.film_faults import another_has_it, damaged, film_faults
from service.store.film_version import FilmShape, Row, bring_up_to_date, checksum, is_up_to_date, is_whole, select_rows, spans

__all__ = ["FilmFile", "Head", "head_spans"]

LOCK_PATIENCE_S = 0.1  # the engine's thread waits no longer for one film
MAX_BAD_KEPT = 1000
FORGOTTEN_AT_ONCE = 100  # frames
BAD_SHOWN = 64

TUNED = ("page_size=32768", "journal_mode=WAL", "synchronous=NORMAL", "wal_autocheckpoint=2000", "secure_delete=OFF")

ROWS = select_rows()
COLUMNS = "frame, tile, first, count, bad, sums, workers, ranges, checksum"
PART = f"INSERT INTO part ({COLUMNS}) VALUES ({', '.join('?' * 9)})"

log = logging.getLogger(__name__)


class Head(NamedTuple):
    """All that a row says but its sums; service/store/film_version.py has what each means."""

    frame: int
    tile: int
    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which nobody needs
    bad: int
    workers: str | None
    ranges: str | None


class FilmFile:
    """One connection. Not safe to use from several threads at a time."""

    def __init__(self, path: Path, shape: FilmShape, epoch: int | None = None) -> None:
        """Open the file, and make it where it is not there. epoch: whoever writes with a lesser one than another has is refused;
        None: nobody asks."""
        self._is_held = False  # by another program, at the last try
        self._epoch = epoch
        self._is_claimed = epoch is None
        with film_faults():
            os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600))  # SQLite makes its -wal and -shm alike
            self._database = sqlite3.connect(path, check_same_thread=False, isolation_level=None, timeout=LOCK_PATIENCE_S)
            self._close = weakref.finalize(self, self._database.close)
            try:
                # NORMAL: a killed process loses nothing; a power cut may lose the latest parts, which are then rendered
                # again. Large pages and rare checkpoints, since rows are large: three times less work a row (measured). Some
                # builds of SQLite write zeros over what is deleted: that is all that was folded, a second time.
                for pragma in TUNED:
                    self._database.execute(f"PRAGMA {pragma}").close()
                if not is_up_to_date(self._database, shape):
                    with self._transaction():
                        bring_up_to_date(self._database, shape)
            except BaseException:
                self.close()
                raise

    def claim(self) -> bool:
        """See to it that nobody of a lesser epoch writes into the film from now on; False where that was so already.

        What is known of the film is to be read anew then. Raises FilmWaits also where it is another's.
        """
        if self._is_claimed:
            return False
        with film_faults(), self._transaction():
            pass
        return True

    def close(self) -> None:
        """Close the file. What was written is written: where it cannot be tidied up any more, it stays as it is."""
        with contextlib.suppress(sqlite3.Error):
            self._close()

    def settle(self) -> None:
        """Bring all into the one file, where that is possible now."""
        try:
            with film_faults():
                self._database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        except FarmError as error:
            log.info("a film keeps its log beside it: %s", error)

    def heads(self) -> list[Head]:
        """Of every row all but its sums."""
        with film_faults():
            found = self._database.execute("SELECT frame, tile, first, count, bad, workers, ranges FROM part").fetchall()
        return [Head(*head) for head in found]

    def sums(self, frame: int, tile: int) -> Iterator[bytes]:
        """The packed sums of a tile's rows. Raises FilmLost where one is not what was written."""
        with film_faults():
            for row in self._database.execute(f"{ROWS} WHERE frame = ? AND tile = ?", (frame, tile)):
                yield _sums(row)

    def sums_of(self, heads: Iterable[Head]) -> Iterator[bytes]:
        """The packed sums of these rows, of one tile. Raises FilmLost where one is not what was written, or gone."""
        with film_faults():
            for head in heads:
                where = head[:3]
                row = self._database.execute(f"{ROWS} WHERE frame = ? AND tile = ? AND first = ?", where).fetchone()
                if row is None:
                    raise damaged(f"samples from {head.first} on of tile {head.tile} are gone")
                yield _sums(row)

    def bad_samples(self, frame: int) -> tuple[int, list[tuple[int, int, int]]]:
        """How many samples were left out, and (x, y, sample) of the first of them."""
        with film_faults():
            (count,) = self._database.execute("SELECT coalesce(sum(bad), 0) FROM part WHERE frame = ?", (frame,)).fetchone()
            first = self._database.execute(
                "SELECT x, y, sample FROM bad_sample WHERE frame = ? LIMIT ?", (frame, BAD_SHOWN)
            ).fetchall()
        return int(count), first

    def add(
        self,
        rows: list[Row],
        bad: list[tuple[int, int, int, int]],
        instead: Sequence[tuple[Head, tuple[int, int, int, int]]] = (),
    ) -> None:
        """Add rows, and the bad samples (frame, x, y, sample) among them: all or none.

        instead: rows in whose place they come, each with its tile's x, y, w, h."""
        with film_faults(), self._transaction():
            if instead:
                self._remove([head for head, _ in instead])
            for head, area in instead:
                for span in spans(head.first, head.count, head.ranges):
                    self._forget_bad(head.frame, area, *span)
            self._database.executemany(PART, [(*row, checksum(row)) for row in rows])
            if bad:
                (kept,) = self._database.execute("SELECT count(*) FROM bad_sample").fetchone()
                self._database.executemany("INSERT INTO bad_sample VALUES (?, ?, ?, ?)", bad[: max(0, MAX_BAD_KEPT - kept)])

    def fold(self, heads: Sequence[Head], row: Row, are_all: bool) -> bool:
        """Put one row in these rows' place, where they are what they were; else say so and change nothing.

        are_all: they are to be all of the tile's."""
        with film_faults(), self._transaction():
            there = self._database.execute("SELECT first, count FROM part WHERE frame = ? AND tile = ?", row[:2]).fetchall()
            folded = {head[2:4] for head in heads}
            if not folded <= set(there) or (are_all and len(there) != len(heads)):
                return False
            self._remove(heads)
            self._database.execute(PART, (*row, checksum(row)))
        return True

    def forget(self, frames: Iterable[int]) -> None:
        """Remove the rows of some frames, and their bad samples; of many, some at a time."""
        left = iter([(frame,) for frame in frames])
        while some := list(islice(left, FORGOTTEN_AT_ONCE)):
            with film_faults(), self._transaction():
                self._database.executemany("DELETE FROM part WHERE frame = ?", some)
                self._database.executemany("DELETE FROM bad_sample WHERE frame = ?", some)

    def row(self, frame: int, tile: int, first: int) -> Row | None:
        """A row as it was written; None where it is not that any more. Raises FilmLost where the file cannot be read there."""
        with film_faults():
            where = (frame, tile, first)
            found = self._database.execute(f"{ROWS} WHERE frame = ? AND tile = ? AND first = ?", where).fetchone()
        return found[:8] if found is not None and is_whole(found[:8], found[8]) else None

    def remove(self, heads: Iterable[Head]) -> None:
        """Remove rows."""
        with film_faults(), self._transaction():
            self._remove(heads)

    def _remove(self, heads: Iterable[Head]) -> None:
        where = [head[:3] for head in heads]
        self._database.executemany("DELETE FROM part WHERE frame = ? AND tile = ? AND first = ?", where)

    def forget_bad(self, frame: int, area: tuple[int, int, int, int], first: int, count: int) -> None:
        """Forget the bad samples first ... first + count - 1 of the pixels x, y, w, h."""
        with film_faults(), self._transaction():
            self._forget_bad(frame, area, first, count)

    def _forget_bad(self, frame: int, area: tuple[int, int, int, int], first: int, count: int) -> None:
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
            with contextlib.suppress(sqlite3.Error):  # after some faults SQLite has rolled back by itself
                self._database.rollback()
            raise

    def _fence(self, epoch: int) -> None:
        """Within a transaction: see that it is this service's to write, and let that be known to those before it."""
        if not self._is_claimed:
            self._database.execute("CREATE TABLE IF NOT EXISTS owner (epoch INTEGER)")
        found = self._database.execute("SELECT epoch FROM owner").fetchone()
        if found is not None and found[0] > epoch:
            raise another_has_it()
        if found is None or found[0] < epoch:
            self._database.execute("DELETE FROM owner")
            self._database.execute("INSERT INTO owner VALUES (?)", (epoch,))

    def _begin(self) -> None:
        """Begin to write. A film that was held is not waited for again: many would leave the engine no time for other jobs."""
        try:
            self._database.execute("BEGIN IMMEDIATE")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY and not self._is_held:
                self._wait_for_locks(0.0)
            raise
        if self._is_held:
            self._wait_for_locks(LOCK_PATIENCE_S)

    def _wait_for_locks(self, seconds: float) -> None:
        self._is_held = not seconds
        self._database.execute(f"PRAGMA busy_timeout={round(seconds * 1000)}").close()


def _sums(row: tuple[Any, ...]) -> bytes:
    if not is_whole(row[:8], row[8]):
        raise damaged(f"samples from {row[2]} on of tile {row[1]} are not what was written")
    sums: bytes = row[5]
    return sums


def head_spans(head: Head) -> list[tuple[int, int]]:
    """The runs of samples that are in a row: first and count. Raises FilmLost."""
    try:
        return spans(head.first, head.count, head.ranges)
    except (ValueError, TypeError) as error:
        raise damaged(str(error)) from error
