"""Creates a film from rows of other films.

Rows are copied, not shared, so that each film can grow, be repaired and be deleted independently.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from renderer.sentences import Sentence
from renderer.settings import tiles_of
from service.errors import FilmLost, FilmUnavailable
from service.store.atomic_files import rename_synced
from service.store.film_check import open_film_file
from service.store.film_faults import FILM, damaged_film_error, damaged_samples_error
from service.store.film_file import ROWS, FilmFile
from service.store.film_version import FilmShape, matches_checksum, sample_ranges

__all__ = ["COPY_SUFFIX", "FilmCopy"]

COPY_SUFFIX = ".new"  # suffix of the file name until the copy is complete

ROWS_PER_TRANSACTION = 64  # rows written in one transaction
BYTES_AT_ONCE = 32 << 20  # or fewer if they exceed this size: a row of a shot's frame may take ten megabytes


class FilmCopy:
    """Context manager that builds a film in a temporary file.

    If the block ends without an error and rows were copied, the file is renamed to its final name.
    """

    def __init__(self, target: Path, shape: FilmShape) -> None:
        self._target = target
        self._made = target.with_name(target.name + COPY_SUFFIX)
        self._tiles = tiles_of(shape.width, shape.height, shape.tile_size)
        self._file = FilmFile(self._made, shape)
        self._has_any = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            if kind is None and self._has_any:
                self._file.checkpoint()
        finally:
            self._file.close()
        try:
            if kind is None and self._has_any:
                if self._made.with_name(f"{self._made.name}-wal").exists():
                    raise FilmUnavailable(
                        Sentence("film-copy-failed", "{film} cannot be copied at the moment. Try again.", film=FILM)
                    )
                rename_synced(self._made, self._target)
        finally:
            self._remove()

    def copy_frames(self, source: Path, frames: Collection[int], sample_limit: int) -> dict[int, int]:
        """Copies frames of another film in one read transaction. Returns their numbers of samples, over all pixels.

        source: file of the other film. frames: keys. sample_limit: frames with sample numbers >= this limit are skipped, as are
        frames without samples. Raises FilmUnavailable, or FilmLost if the source is missing or a row does not match its
        checksum; then none of these frames is copied.
        """
        if not source.exists():
            raise FilmLost(Sentence("film-missing", "{film} is missing.", film=FILM))
        taken = {}
        try:
            with closing(open_film_file(source)) as database:
                database.execute("BEGIN")
                for frame in frames:
                    parts = database.execute("SELECT first, count, ranges FROM part WHERE frame = ?", (frame,)).fetchall()
                    if 0 < _highest_sample(parts) <= sample_limit:
                        taken[frame] = self._copy(database, frame)
        except BaseException:
            for frame in frames:
                self._file.delete_frames([frame])
            raise
        self._has_any = self._has_any or bool(taken)
        return taken

    def _copy(self, database: sqlite3.Connection, frame: int) -> int:
        samples = 0
        for rows in _row_batches(database.execute(f"{ROWS} WHERE frame = ?", (frame,))):
            samples += sum(self._samples(row) for row in rows)
            self._file.add([row[:8] for row in rows], [])
        bad = database.execute("SELECT frame, x, y, sample FROM bad_sample WHERE frame = ?", (frame,)).fetchall()
        if bad:
            self._file.add([], bad)
        return samples

    def _samples(self, row: tuple[Any, ...]) -> int:
        _, tile, first, count, *_ = row
        if not isinstance(tile, int) or not 0 <= tile < len(self._tiles) or not matches_checksum(row[:8], row[8]):
            raise damaged_samples_error(first, tile)
        return int(count) * self._tiles[tile].w * self._tiles[tile].h

    def _remove(self) -> None:
        for suffix in ("", "-wal", "-shm"):
            with suppress(OSError):
                self._made.with_name(self._made.name + suffix).unlink(missing_ok=True)


def _row_batches(rows: sqlite3.Cursor) -> Iterator[list[tuple[Any, ...]]]:
    hand, size = [], 0
    for row in rows:
        hand.append(row)
        size += len(row[5]) if isinstance(row[5], bytes) else 0
        if len(hand) >= ROWS_PER_TRANSACTION or size >= BYTES_AT_ONCE:
            yield hand
            hand, size = [], 0
    if hand:
        yield hand


def _highest_sample(parts: list[tuple[int, int, str | None]]) -> int:
    try:
        return max((first + count for part in parts for first, count in sample_ranges(*part)), default=0)
    except (ValueError, TypeError) as error:
        raise damaged_film_error(str(error)) from error
