"""Tests of the recorded senders of a film's samples: folding keeps them, and the samples of one sender can be removed."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from protocol.sums import pack_sums
from service.store.contributions import Contribution
from service.store.film_check import film_samples, readable_rows
from service.store.film_copy import FilmCopy
from service.store.film_version import FilmShape
from service.store.films import Film
from service.store.row_folding import MAX_ROWS_APART, MAX_ROWS_UNFOLDED
from service.store.senders import MAX_NAMES, senders_of, senders_text, shares_of
from service.store.tile_cache import TileCache
from tests.service.peer_worker import expected_sums

SHAPE = FilmShape(8, 8, 8, 24)


def make(path: Path) -> Film:
    return Film(path, 8, 8, 8, 24, TileCache(1 << 20))


@pytest.fixture
def film(tmp_path: Path) -> Iterator[Film]:
    film = make(tmp_path / "job.sqlite")
    film.separates_senders = True
    yield film
    film.close()


def sent(film: Film, worker: str, first: int, count: int = 1) -> None:
    sums = pack_sums(expected_sums(film.tiles[0], first, count, 0))
    assert film.merge([Contribution(0, 0, first, count, sums, workers={worker: count})]) == [True]


def rows(film: Film) -> list[tuple[str, int]]:
    assert film._file is not None
    return sorted((str(head.workers), head.count) for head in film._file.row_heads())


def test_rows_of_senders_are_folded_and_deleted_separately(film: Film, tmp_path: Path) -> None:
    for first in range(2 * MAX_ROWS_UNFOLDED):
        sent(film, "ab"[first % 2], first)
    assert rows(film) == [('["a"]', MAX_ROWS_UNFOLDED), ('["b"]', MAX_ROWS_UNFOLDED)]
    again = make(tmp_path / "job.sqlite")  # as after a restart of the service
    for each in (film, again):
        np.testing.assert_array_equal(each.tile_sums(0, 0), expected_sums(film.tiles[0], 0, 2 * MAX_ROWS_UNFOLDED, 0))
        assert each.coverage(0, 0).ranges == [(0, 2 * MAX_ROWS_UNFOLDED)]
    with film.snapshot() as moment:
        assert moment.coverage(0, 0).ranges == [(0, 2 * MAX_ROWS_UNFOLDED)]
    assert film_samples(tmp_path / "job.sqlite", SHAPE) == {0: 64 * 2 * MAX_ROWS_UNFOLDED}
    again.close()
    assert film.delete_samples_of("b") == 64 * MAX_ROWS_UNFOLDED
    assert film.coverage(0, 0).ranges == [(first, first + 1) for first in range(0, 2 * MAX_ROWS_UNFOLDED, 2)]
    odd = [expected_sums(film.tiles[0], first, 1, 0) for first in range(0, 2 * MAX_ROWS_UNFOLDED, 2)]
    np.testing.assert_array_equal(film.tile_sums(0, 0), sum(odd))
    for first in range(1, 2 * MAX_ROWS_UNFOLDED, 2):
        sent(film, "c", first)
    np.testing.assert_array_equal(film.tile_sums(0, 0), expected_sums(film.tiles[0], 0, 2 * MAX_ROWS_UNFOLDED, 0))


def test_folded_row_survives_copy_and_recovery(film: Film, tmp_path: Path) -> None:
    for first in range(2 * MAX_ROWS_UNFOLDED):
        sent(film, "ab"[first % 2], first)
    film.checkpoint()
    with FilmCopy(tmp_path / "copy.sqlite", SHAPE) as made:
        assert made.copy_frames(tmp_path / "job.sqlite", [0], 2 * MAX_ROWS_UNFOLDED) == {0: 64 * 2 * MAX_ROWS_UNFOLDED}
    saved = make(tmp_path / "saved.sqlite")
    saved.add_recovered(readable_rows(tmp_path / "copy.sqlite", SHAPE))
    assert saved.coverage(0, 0).ranges == [(0, 2 * MAX_ROWS_UNFOLDED)]
    assert saved.delete_samples_of("a") == 64 * MAX_ROWS_UNFOLDED
    saved.close()


def test_mixed_row_names_all_senders(film: Film) -> None:
    film.separates_senders = False
    for first in range(MAX_ROWS_UNFOLDED):
        sent(film, f"w{first % 3}", first)
    assert rows(film) == [('{"w0": 3, "w1": 3, "w2": 2}', MAX_ROWS_UNFOLDED)]
    sent(film, "w0", MAX_ROWS_UNFOLDED, 2)
    assert film.worker_shares(0) == [(10, {"w0": 5, "w1": 3, "w2": 2})]
    assert film.delete_samples_of("w3") == 0
    assert film.delete_samples_of("w1") == 64 * MAX_ROWS_UNFOLDED
    assert film.worker_shares(0) == [(2, {"w0": 2})]


def test_rows_per_tile_are_bounded(film: Film) -> None:
    for first in range(MAX_ROWS_APART + MAX_ROWS_UNFOLDED):
        sent(film, f"w{first}", first)
    assert len(rows(film)) <= MAX_ROWS_APART
    np.testing.assert_array_equal(film.tile_sums(0, 0), expected_sums(film.tiles[0], 0, MAX_ROWS_APART + MAX_ROWS_UNFOLDED, 0))


def test_row_with_too_many_senders_matches_any_worker() -> None:
    few, many = (senders_text({f"w{n}": 1 for n in range(names)}) for names in (MAX_NAMES, MAX_NAMES + 1))
    assert ("w1" in senders_of(few), "x" in senders_of(few)) == (True, False)
    assert "x" in senders_of(many)
    assert "x" in senders_of(senders_text({**shares_of(many, 1), "y": 1})), "what is added to it stays anybody's"
    assert senders_text({"": 4}) is None
    assert "x" not in senders_of(None)
    assert "x" not in senders_of("{damaged")


def test_film_without_senders_is_continued(film: Film, tmp_path: Path) -> None:
    sent(film, "", 0, 2)
    film.close()
    with closing(sqlite3.connect(tmp_path / "job.sqlite")) as database, database:
        database.execute("ALTER TABLE part DROP COLUMN workers")
        database.execute("ALTER TABLE part DROP COLUMN ranges")
        database.execute("PRAGMA user_version = 2")
    database.close()
    assert film_samples(tmp_path / "job.sqlite", SHAPE) == {0: 128}
    again = make(tmp_path / "job.sqlite")
    sent(again, "a", 2)
    assert rows(again) == [("None", 2), ('["a"]', 1)]
    assert again.delete_samples_of("a") == 64
    again.close()


def test_numbers_of_older_rows_stay_unknown() -> None:
    """A list of several names, as in films of version 3, has no numbers; one name has all samples."""
    assert shares_of('["a", "b"]', 8) == {"a": 0, "b": 0}
    assert shares_of('["a"]', 8) == {"a": 8}
    text = senders_text({"a": 0, "b": 3})
    assert (shares_of(text, 11), set(senders_of(text))) == ({"a": 0, "b": 3}, {"a", "b"})
    assert shares_of(senders_text({"a": 3, "": 5}), 8) == {"a": 3}, "samples without a known worker are not counted as a's"
