"""Tests that a film stores each sample once, for any repetition, order and partition of the parts."""

from __future__ import annotations

import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.sums import pack_sums
from renderer import film as film_math
from renderer.film import BadSample
from service.errors import FilmLost
from service.store.bands import digest
from service.store.film_faults import FilmClosed
from service.store.films import Contribution, Film
from service.store.tile_cache import TileCache
from tests.service.peer_worker import expected_sums

WIDTH, HEIGHT, TILE = 20, 12, 8


def make(path: Path, cache_bytes: int = 1 << 20) -> Film:
    return Film(path, WIDTH, HEIGHT, TILE, 24, TileCache(cache_bytes))


def rows_of(film: Film) -> sqlite3.Connection:
    assert film._file is not None
    return film._file._database


def part(film: Film, tile: int, first: int, count: int, **more: object) -> Contribution:
    sums = expected_sums(film.tiles[tile], first, count, 0)
    return Contribution(0, tile, first, count, pack_sums(sums), **more)  # type: ignore[arg-type]


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 5), st.integers(0, 11), st.integers(1, 5)), max_size=24), st.integers(1, 5), st.booleans()
)
def test_film_equals_sum_of_accepted_batches(batches: list[tuple[int, int, int]], group: int, small_cache: bool) -> None:
    with tempfile.TemporaryDirectory() as folder:
        film = make(Path(folder) / "job.sqlite", 2000 if small_cache else 1 << 20)
        model: dict[int, set[int]] = {tile: set() for tile in range(len(film.tiles))}
        for at in range(0, len(batches), group):
            some = batches[at : at + group]
            taken = film.merge([part(film, *batch) for batch in some])
            before = {tile: set(samples) for tile, samples in model.items()}
            for (tile, first, count), was_taken in zip(some, taken, strict=True):
                model[tile] |= set(range(first, first + count)) if was_taken else set()
            for (tile, first, count), was_taken in zip(some, taken, strict=True):
                samples = set(range(first, first + count))
                assert was_taken or model[tile] & samples, "what does not overlap is taken"
                assert not was_taken or samples - before[tile], "and what brings nothing new is not"
        again = make(Path(folder) / "job.sqlite")
        for tile, samples in model.items():
            rect = film.tiles[tile]
            expected = sum(
                (expected_sums(rect, s, 1, 0) for s in samples), np.zeros((film_math.CHANNELS, rect.h, rect.w), np.int64)
            )
            for each in (film, again):
                sums = each.tile_sums(0, tile)
                np.testing.assert_array_equal(np.zeros_like(expected) if sums is None else sums, expected)
        assert digest(film, 0, Path(folder)) == digest(again, 0, Path(folder))
        assert film.version(0) == again.version(0)
        assert film.samples(0) == sum(len(s) * film.tiles[t].w * film.tiles[t].h for t, s in model.items())
        film.close()
        again.close()


def test_film_with_fewer_planes_is_continued(tmp_path: Path) -> None:
    planes = 15
    film = make(tmp_path / "job.sqlite")
    old = expected_sums(film.tiles[0], 0, 2, 0)[:planes]
    film.merge([part(film, 0, 0, 2)])
    film.close()
    with closing(sqlite3.connect(tmp_path / "job.sqlite")) as database, database:
        database.execute("UPDATE part SET sums = ?, checksum = NULL", (pack_sums(old),))
    database.close()
    film = make(tmp_path / "job.sqlite")
    sums = film.tile_sums(0, 0)
    assert sums is not None
    np.testing.assert_array_equal(sums[:planes], old)
    assert not sums[planes:].any()
    assert film.merge([part(film, 0, 2, 2)]) == [True]
    np.testing.assert_array_equal(film.tile_sums(0, 0), expected_sums(film.tiles[0], 0, 4, 0))
    # Sums of a worker must be of this release, and complete.
    assert film.merge([Contribution(0, 1, 0, 2, pack_sums(expected_sums(film.tiles[1], 0, 2, 0)[:planes]))]) == [False]
    film.close()


def test_folding_keeps_digest(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    for first in range(20):
        film.merge([part(film, 0, first, 1, bad=[BadSample(1, 2, first)], bad_count=2)])
    rows = rows_of(film).execute("SELECT count(*) FROM part").fetchone()[0]
    assert rows < 8
    again = make(tmp_path / "job.sqlite")
    np.testing.assert_array_equal(again.tile_sums(0, 0), expected_sums(film.tiles[0], 0, 20, 0))
    count, kept = again.bad_samples(0)
    assert count == 40
    assert kept[:2] == [BadSample(1, 2, 0), BadSample(1, 2, 1)]
    film.close()
    again.close()


def test_consecutive_parts_become_one_row(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    bad = [BadSample(1, 2, 3)]
    parts = [
        part(film, 1, 4, 3, bad_count=2),
        part(film, 0, 0, 1),
        part(film, 1, 0, 4, bad=bad, bad_count=1),
        part(film, 1, 9, 1),
    ]
    assert film.merge([*parts, part(film, 1, 5, 1)]) == [True] * 4 + [False]
    rows = rows_of(film).execute("SELECT tile, first, count, bad FROM part ORDER BY tile, first").fetchall()
    assert rows == [(0, 0, 1, 0), (1, 0, 7, 3), (1, 9, 1, 0)]
    assert film.bad_samples(0) == (3, bad)
    assert film.merge(parts) == [False] * 4, "what came twice is known, whatever it was joined with"
    film.close()


def test_damaged_sums_and_unknown_tiles_are_dropped(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    good = part(film, 0, 0, 1)
    other_size = part(film, 5, 0, 1)
    assert film.tiles[0][2:] != film.tiles[5][2:]
    assert film.merge(
        [
            Contribution(0, 0, 0, 1, b"nonsense"),
            Contribution(0, 0, 0, 1, other_size.sums),
            Contribution(0, 99, 0, 1, good.sums),
            good,
        ]
    ) == [
        *(False, False, False),
        True,
    ]
    film.close()


def test_failed_merge_adds_nothing(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    film.open_file(create=True)
    rows_of(film).execute("CREATE TRIGGER full BEFORE INSERT ON part WHEN NEW.tile = 1 BEGIN SELECT raise(ABORT, 'a fault'); END")
    with pytest.raises(FilmLost, match="a fault"):
        film.merge([part(film, 0, 0, 1), part(film, 1, 0, 1)])
    assert film.samples(0) == 0
    rows_of(film).execute("DROP TRIGGER full")
    assert film.merge([part(film, 0, 0, 1), part(film, 1, 0, 1)]) == [True, True]
    film.close()


@pytest.mark.parametrize("cache_bytes", [1, 1 << 20])
def test_reading_some_planes_bypasses_cache(tmp_path: Path, cache_bytes: int) -> None:
    film = make(tmp_path / "job.sqlite", cache_bytes)
    film.merge([part(film, 0, first, 1) for first in (0, 1, 2)])
    film.merge([part(film, 1, 0, 1)])
    expected = expected_sums(film.tiles[0], 0, 3, 0)
    remembered = set(film._cache._items)
    planes = film.tile_planes(0, 0, [0, 2, 13])
    assert planes is not None
    np.testing.assert_array_equal(planes[[0, 2, 13]], expected[[0, 2, 13]])
    assert set(film._cache._items) == remembered
    np.testing.assert_array_equal(film.tile_sums(0, 0), expected)
    assert film.tile_planes(0, 5, [0]) is None
    film.close()


def test_closed_film_raises_error_in_reader(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    film.merge([part(film, 0, 0, 2)])
    assert film.tile_sums(0, 0) is not None
    film.close()
    with pytest.raises(FilmClosed) as refusal:
        film.tile_planes(0, 0, [0])
    assert "deleted" in str(refusal.value)
