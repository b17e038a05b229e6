"""Tests that a film notices damage to its file, and keeps the rows of sums that are intact."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from protocol.sums import pack_sums
from renderer.film import CHANNELS, BadSample
from renderer.settings import RenderSettings, View
from service.errors import FilmDamaged
from service.store.film_check import film_samples
from service.store.film_store import FilmFolder
from service.store.films import Contribution, Film
from service.store.row_folding import MAX_ROWS_UNFOLDED
from tests.service.peer_worker import expected_sums
from tests.service.store.test_films import HEIGHT, TILE, WIDTH, part

SETTINGS = RenderSettings(view=View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)), width=WIDTH, height=HEIGHT)
SPP = 3


def create_film(folder: Path) -> FilmFolder:
    """Returns a folder with one film: each tile has three rows of one sample each.

    Tile 1 has more rows, which are folded into one.
    """
    films = FilmFolder(folder, 1 << 20)
    film = films.open("job", SETTINGS, TILE, pin=True)
    for tile in range(len(film.tiles)):
        for first in range(SPP):
            film.merge([part(film, tile, first, 1, bad=[BadSample(film.tiles[tile].x, 0, first)])])
    film.merge([part(film, 1, first, 1) for first in range(SPP, MAX_ROWS_UNFOLDED)])
    films.close()
    return FilmFolder(folder, 1 << 20)


def flip_bit(path: Path, tile: int, first: int) -> None:
    """Flips one bit in the stored sums of the film's row at (tile, first), which can still be decompressed afterwards."""
    database = sqlite3.connect(path)
    (sums,) = database.execute("SELECT sums FROM part WHERE tile = ? AND first = ?", (tile, first)).fetchone()
    turned = bytearray(sums)
    turned[3] ^= 1  # value of a plane of equal pixels
    database.execute("UPDATE part SET sums = ? WHERE tile = ? AND first = ?", (bytes(turned), tile, first))
    database.commit()
    database.close()


def assert_film_has(film: Film, missing: set[tuple[int, int]]) -> None:
    """Asserts that a film has the expected samples of all tiles, except those in `missing`: pairs (tile, sample number)."""
    for tile, area in enumerate(film.tiles):
        samples = [s for s in range(MAX_ROWS_UNFOLDED if tile == 1 else SPP) if (tile, s) not in missing]
        assert film.coverage(0, tile).total == len(samples)
        expected = sum(expected_sums(area, s, 1, 0) for s in samples)
        np.testing.assert_array_equal(film.tile_sums(0, tile), expected)


def test_flipped_bit_loses_one_row(tmp_path: Path) -> None:
    films = create_film(tmp_path)
    path = tmp_path / "job.sqlite"
    film = films.open("job", SETTINGS, TILE)
    whole = film_samples(path, film._shape)
    assert whole == films.verify("job", SETTINGS, TILE)
    flip_bit(path, 2, 1)
    with pytest.raises(FilmDamaged, match="samples from 1 on of tile 2 differ from what was written"):
        films.verify("job", SETTINGS, TILE)
    with pytest.raises(FilmDamaged, match="differ from what was written"):
        film.tile_planes(0, 2, [0])
    films.delete_damaged("job", SETTINGS, TILE)
    film = films.open("job", SETTINGS, TILE)
    assert_film_has(film, {(2, 1)})
    assert BadSample(film.tiles[2].x, 0, 1) not in film.bad_samples(0)[1]
    assert film.merge([part(film, 2, 1, 1)]) == [True]
    assert_film_has(film, set())
    assert films.verify("job", SETTINGS, TILE) == whole


def test_intact_rows_of_damaged_film_are_kept(tmp_path: Path) -> None:
    settings = replace(SETTINGS, width=64, height=64)
    films = FilmFolder(tmp_path, 1 << 20)
    film = films.open("job", settings, 32, pin=True)
    noise = np.random.default_rng(1)
    for tile in range(4):
        for first in range(SPP):
            film.merge([Contribution(0, tile, first, 1, pack_sums(noise.integers(0, 1 << 62, (CHANNELS, 32, 32), np.int64)))])
    films.close()
    path = tmp_path / "job.sqlite"
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2)
        file.write(b"\xa5" * 32768)
    films = FilmFolder(tmp_path, 1 << 20)
    with pytest.raises(FilmDamaged):
        films.verify("job", settings, 32)
    films.delete_damaged("job", settings, 32)
    film = films.open("job", settings, 32)
    kept = sum(film.coverage(0, tile).total for tile in range(4))
    assert 4 * SPP - 2 <= kept < 4 * SPP, "one page is of one row, or of two"
    assert films.verify("job", settings, 32)[0] == kept * 32 * 32
    films.delete("job")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"no film at all" * 999])
def test_unreadable_film_becomes_empty(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "job.sqlite").write_bytes(content)
    films = FilmFolder(tmp_path, 1 << 20)
    assert films.size("job") == len(content)
    films.delete_damaged("job", SETTINGS, TILE)
    assert films.open("job", SETTINGS, TILE).is_empty


def test_film_without_checksums_is_accepted(tmp_path: Path) -> None:
    films = create_film(tmp_path)
    with closing(sqlite3.connect(tmp_path / "job.sqlite")) as database, database:
        database.execute("UPDATE part SET checksum = NULL")
    database.close()
    film = films.open("job", SETTINGS, TILE)
    assert film.delete_damaged() == 0
    assert_film_has(film, set())
    assert films.verify("job", SETTINGS, TILE)[0] == film.samples(0)
