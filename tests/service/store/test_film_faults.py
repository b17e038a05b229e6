"""Tests of faults of a film's file: temporary ones raise FilmUnavailable, permanent ones FilmLost.

After either, the film's index still equals the contents of the file.
"""

from __future__ import annotations

import errno
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from protocol.sums import pack_sums
from renderer.film import CHANNELS
from service.errors import FilmLost, FilmUnavailable
from service.store import film_file
from service.store.bands import digest
from service.store.film_faults import film_faults
from service.store.film_version import VERSION
from service.store.films import Contribution, Film
from service.store.row_folding import MAX_ROWS_UNFOLDED
from tests.service.peer_worker import expected_sums
from tests.service.store.test_films import make, part, rows_of


@pytest.fixture
def film(tmp_path: Path) -> Film:
    film = make(tmp_path / "job.sqlite")
    assert film.merge([part(film, 0, 0, 2)]) == [True]
    return film


def test_full_disk_is_temporary(film: Film) -> None:
    (pages,) = rows_of(film).execute("PRAGMA page_count").fetchone()
    rows_of(film).execute(f"PRAGMA max_page_count={pages}")
    noise = np.random.default_rng(1)
    group = []
    for tile, rect in enumerate(film.tiles):
        sums = noise.integers(0, 1 << 62, (CHANNELS, rect.h, rect.w), np.int64)
        group.append(Contribution(0, tile, 2, 1, pack_sums(sums)))
    before = film.version(0)
    with pytest.raises(FilmUnavailable, match="disk is full"):
        film.merge(group)
    assert film.version(0) == before, "of a group that does not fit as a whole, nothing is in"
    np.testing.assert_array_equal(film.tile_sums(0, 0), expected_sums(film.tiles[0], 0, 2, 0))
    rows_of(film).execute("PRAGMA max_page_count=1000000")
    assert all(film.merge(group)), "and all of it once there is room"


def test_locked_merge_fails_quickly_without_partial_count(film: Film, tmp_path: Path) -> None:
    other = sqlite3.connect(tmp_path / "job.sqlite", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    began = time.monotonic()
    with pytest.raises(FilmUnavailable, match="locked by another program"):
        film.merge([part(film, 0, 2, 2), part(film, 1, 0, 2)])
    assert time.monotonic() - began < 5.0, "not the 30 s of an ordinary connection"
    assert film.samples(0) == 2 * film.tiles[0].w * film.tiles[0].h
    assert film.tile_sums(0, 0) is not None, "reading goes on"
    other.execute("ROLLBACK")
    other.close()
    assert film.merge([part(film, 0, 2, 2), part(film, 1, 0, 2)]) == [True, True], "as if it had not been tried before"
    np.testing.assert_array_equal(film.tile_sums(0, 0), expected_sums(film.tiles[0], 0, 4, 0))


def test_film_locked_at_open_is_unavailable(film: Film, tmp_path: Path) -> None:
    film.close()
    other = sqlite3.connect(tmp_path / "job.sqlite", isolation_level=None)
    other.execute("PRAGMA locking_mode=EXCLUSIVE")
    other.execute("BEGIN EXCLUSIVE")
    again = make(tmp_path / "job.sqlite")
    with pytest.raises(FilmUnavailable):
        again.open_file()
    other.execute("ROLLBACK")
    other.close()
    again.open_file()
    assert again.coverage(0, 0).total == 2
    again.close()


def test_write_locked_film_is_readable(film: Film, tmp_path: Path) -> None:
    film.close()
    other = sqlite3.connect(tmp_path / "job.sqlite", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    again = make(tmp_path / "job.sqlite")
    np.testing.assert_array_equal(again.tile_sums(0, 0), expected_sums(again.tiles[0], 0, 2, 0))
    other.close()
    again.close()


def overwritten(path: Path) -> None:
    with path.open("r+b") as file:
        file.seek(200)
        file.write(b"\xa5" * (path.stat().st_size - 300))


def emptied_in_part(path: Path) -> None:
    with path.open("r+b") as file:
        file.truncate(40_000)


def sql(*statements: str) -> Callable[[Path], None]:
    def run(path: Path) -> None:
        database = sqlite3.connect(path)
        for statement in statements:
            database.execute(statement)
        database.commit()
        database.close()

    return run


@pytest.mark.parametrize(
    ("break_it", "why"),
    [
        (lambda path: path.write_bytes(b"no database at all" * 1000), "not a database"),
        (overwritten, "damaged"),
        (emptied_in_part, "damaged"),
        (sql("DROP TABLE part"), "no such table"),
        (sql("ALTER TABLE part RENAME COLUMN sums TO other"), "no such column"),
        (sql("UPDATE part SET sums = x'00'"), "damaged"),
        (sql("UPDATE part SET sums = NULL"), "damaged"),
        (sql("UPDATE part SET count = NULL"), "damaged"),
        (sql("UPDATE part SET tile = 99"), "damaged"),
        (
            sql("INSERT INTO part SELECT frame, tile, first + 1, count, bad, sums, checksum, workers, ranges FROM part"),
            "covered already",
        ),
        (sql("UPDATE shape SET width = 7"), "another picture"),
        (sql(f"PRAGMA user_version = {VERSION + 1}"), f"version {VERSION + 1}.*up to version {VERSION}"),
        (lambda path: (path.unlink(), path.mkdir()), "cannot be written|damaged"),
    ],
)
def test_permanent_faults_raise_film_lost(film: Film, tmp_path: Path, break_it: Callable[[Path], None], why: str) -> None:
    film.checkpoint()
    film.close()
    for suffix in ("-wal", "-shm"):
        (tmp_path / f"job.sqlite{suffix}").unlink(missing_ok=True)
    break_it(tmp_path / "job.sqlite")
    again = make(tmp_path / "job.sqlite")
    with pytest.raises(FilmLost, match=why) as lost:
        again.open_file()
        again.tile_sums(0, 0)
    assert str(lost.value).startswith("The film of this job")
    with pytest.raises(FilmLost):
        again.merge([part(again, 0, 2, 2)])
        digest(again, 0, tmp_path)
    again.close()


def test_read_only_film_is_unavailable(film: Film) -> None:
    rows_of(film).execute("PRAGMA query_only=ON")
    with pytest.raises(FilmUnavailable, match=r"is read-only\. Make it writable\. The job continues"):
        film.merge([part(film, 1, 0, 1)])
    assert film.coverage(0, 1).total == 0
    rows_of(film).execute("PRAGMA query_only=OFF")
    assert film.merge([part(film, 1, 0, 1)]) == [True]


def test_locked_film_is_waited_for_once(film: Film, tmp_path: Path) -> None:
    def patience_ms() -> int:
        return int(rows_of(film).execute("PRAGMA busy_timeout").fetchone()[0])

    known = patience_ms()
    other = sqlite3.connect(tmp_path / "job.sqlite", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    assert known > 0
    for _ in range(2):
        with pytest.raises(FilmUnavailable):
            film.merge([part(film, 1, 0, 1)])
        assert patience_ms() == 0, "the engine, which all jobs need, waits no second time"
    other.close()
    assert film.merge([part(film, 1, 0, 1)]) == [True]
    assert patience_ms() == known


def test_merge_is_reported_despite_folding_error(film: Film) -> None:
    rows_of(film).execute("CREATE TRIGGER stuck BEFORE DELETE ON part BEGIN SELECT raise(ABORT, 'stuck'); END")
    for first in range(2, 2 + MAX_ROWS_UNFOLDED):
        assert film.merge([part(film, 0, first, 1)]) == [True]
    np.testing.assert_array_equal(film.tile_sums(0, 0), expected_sums(film.tiles[0], 0, 2 + MAX_ROWS_UNFOLDED, 0))
    rows_of(film).execute("DROP TRIGGER stuck")
    film.merge([part(film, 0, 2 + MAX_ROWS_UNFOLDED, 1)])
    assert rows_of(film).execute("SELECT count(*) FROM part").fetchone() == (1,)
    np.testing.assert_array_equal(film.tile_sums(0, 0), expected_sums(film.tiles[0], 0, 3 + MAX_ROWS_UNFOLDED, 0))


def test_commit_with_unknown_result_is_checked(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    """If a commit succeeds but reports an error, parts that arrive again are recognised as stored."""
    add = film_file.FilmFile.add

    def add_and_fail(self: film_file.FilmFile, *rows: object) -> None:
        add(self, *rows)  # type: ignore[arg-type]
        raise FilmUnavailable("the disk hung")

    monkeypatch.setattr(film_file.FilmFile, "add", add_and_fail)
    with pytest.raises(FilmUnavailable):
        film.merge([part(film, 0, 2, 2)])
    monkeypatch.undo()
    assert film.merge([part(film, 0, 2, 2), part(film, 0, 4, 1)]) == [False, True]
    np.testing.assert_array_equal(film.tile_sums(0, 0), expected_sums(film.tiles[0], 0, 5, 0))


def test_folding_keeps_rows_of_other_processes(film: Film, tmp_path: Path) -> None:
    """Folding a tile's rows into one keeps rows that another process wrote, although they are not in the cached sums."""
    sneaked = part(film, 0, 2 + MAX_ROWS_UNFOLDED, 1)
    sql_rows = sqlite3.connect(tmp_path / "job.sqlite")
    sql_rows.execute("INSERT INTO part VALUES (0, 0, ?, 1, 0, ?, NULL, NULL, NULL)", (sneaked.first, sneaked.sums))
    sql_rows.commit()
    sql_rows.close()
    for first in range(2, 2 + MAX_ROWS_UNFOLDED):
        film.merge([part(film, 0, first, 1)])
    film.merge([part(film, 1, 0, 1)])
    np.testing.assert_array_equal(film.tile_sums(0, 0), expected_sums(film.tiles[0], 0, 3 + MAX_ROWS_UNFOLDED, 0))


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (errno.ENOSPC, FilmUnavailable),
        (errno.EDQUOT, FilmUnavailable),
        (errno.EIO, FilmUnavailable),
        (errno.EMFILE, FilmUnavailable),
        (errno.EACCES, FilmLost),
        (errno.EROFS, FilmUnavailable),
    ],
)
def test_os_errors_are_classified(number: int, kind: type[Exception]) -> None:
    with pytest.raises(kind), film_faults():
        raise OSError(number, "said by the system")


def test_film_of_release_0_1_0_is_migrated(film: Film, tmp_path: Path) -> None:
    film.checkpoint()
    old = sqlite3.connect(tmp_path / "old.sqlite")
    old.executescript(
        """CREATE TABLE part (
               frame INTEGER, tile INTEGER, first INTEGER, count INTEGER, bad INTEGER, sums BLOB,
               PRIMARY KEY (frame, tile, first));
           CREATE TABLE bad_sample (frame INTEGER, x INTEGER, y INTEGER, sample INTEGER);"""
    )
    old.executemany(
        "INSERT INTO part VALUES (?, ?, ?, ?, ?, ?)",
        rows_of(film).execute("SELECT frame, tile, first, count, bad, sums FROM part").fetchall(),
    )
    old.commit()
    old.close()
    again = make(tmp_path / "old.sqlite")
    assert digest(again, 0, tmp_path) == digest(film, 0, tmp_path)
    assert again.merge([part(again, 0, 2, 1)]) == [True]
    assert rows_of(again).execute("PRAGMA user_version").fetchone() == (VERSION,)
    again.close()


def test_film_files_are_private(film: Film, tmp_path: Path) -> None:
    modes = {path.name: path.stat().st_mode & 0o777 for path in tmp_path.iterdir()}
    assert modes == {"job.sqlite": 0o600, "job.sqlite-wal": 0o600, "job.sqlite-shm": 0o600}
