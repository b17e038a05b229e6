"""Tests that only the service that owns the farm writes a film, and that writes of an earlier owner are refused."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from service.errors import FilmUnavailable
from service.store.films import Film
from service.store.tile_cache import TileCache
from tests.service.store.test_films import HEIGHT, TILE, WIDTH, part


def film(path: Path, epoch: int | None) -> Film:
    return Film(path, WIDTH, HEIGHT, TILE, 24, TileCache(1 << 20), epoch)


def test_merge_of_earlier_owner_is_rejected(tmp_path: Path) -> None:
    old, new = film(tmp_path / "job.sqlite", 7), film(tmp_path / "job.sqlite", 8)
    assert old.merge([part(old, 0, 0, 2)]) == [True]
    new.open_file(create=True)
    assert new.merge([part(new, 0, 0, 2), part(new, 0, 2, 2)]) == [False, True]
    for batch in ((0, 2, 2), (1, 0, 1)):
        with pytest.raises(FilmUnavailable, match="belongs to another service"):
            old.merge([part(old, *batch)])
    assert old.merge([part(old, 0, 3, 2)]) == [False], "by now it knows of what the other has merged"
    with pytest.raises(FilmUnavailable):
        old.delete_frames(0)
    assert new.merge([part(new, 1, 0, 1)]) == [True]
    old.close()
    new.close()
    again = film(tmp_path / "job.sqlite", 9)
    assert [again.coverage(0, tile).ranges for tile in (0, 1)] == [[(0, 4)], [(0, 1)]]
    again.close()


def test_new_owner_knows_earlier_merges(tmp_path: Path) -> None:
    """A new owner of the farm knows the samples that the earlier owner merged, also if it had opened the film before."""
    old, new = film(tmp_path / "job.sqlite", 7), film(tmp_path / "job.sqlite", 8)
    old.merge([part(old, 0, 0, 2)])
    assert new.samples(0) > 0
    old.merge([part(old, 0, 2, 2)])
    assert new.merge([part(new, 0, 2, 2), part(new, 0, 3, 2)]) == [False, False]
    assert new.coverage(0, 0).ranges == [(0, 4)]
    old.close()
    new.close()


def test_reading_does_not_claim_film_and_writing_does(tmp_path: Path) -> None:
    path = tmp_path / "job.sqlite"
    plain = film(path, None)  # written by a release without owners
    plain.merge([part(plain, 0, 0, 2)])
    plain.close()

    def epochs() -> list[tuple[int]] | None:
        with closing(sqlite3.connect(path)) as database, database:
            has_table = database.execute("SELECT 1 FROM sqlite_master WHERE name = 'owner'").fetchone()
            found = database.execute("SELECT epoch FROM owner").fetchall() if has_table else None
        database.close()
        return found

    looking = film(path, 5)
    assert looking.tile_sums(0, 0) is not None
    assert epochs() is None
    looking.merge([part(looking, 0, 2, 2)])
    assert epochs() == [(5,)]
    looking.close()
    plain = film(path, None)
    assert plain.merge([part(plain, 0, 4, 2)]) == [True], "an older release goes on with it"
    plain.close()
