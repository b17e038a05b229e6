"""Tests of reading a frame's film in horizontal bands: together they equal the whole frame.

The digest computed from bands equals that of renderer.film.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from renderer import aovs
from renderer import film as film_math
from renderer.settings import Tile
from service.store import bands as bands_module
from service.store.bands import bands, digest
from service.store.films import Film
from tests.service.peer_worker import expected_sums
from tests.service.store.test_films import HEIGHT, WIDTH, make, part

WHOLE = expected_sums(Tile(0, 0, WIDTH, HEIGHT), 0, 2, 0)


@pytest.fixture
def film(tmp_path: Path) -> Film:
    film = make(tmp_path / "job.sqlite")
    film.merge([part(film, tile, 0, 2) for tile in range(len(film.tiles))])
    return film


def test_bands_make_up_frame(film: Film) -> None:
    read = list(bands(film, 0, ["color"]))
    assert [band.shape for band in read] == [(8, WIDTH, 3), (4, WIDTH, 3)]
    np.testing.assert_array_equal(np.concatenate(read), film_math.mean(WHOLE, 24))
    for name in aovs.AOVS:
        np.testing.assert_array_equal(np.concatenate(list(bands(film, 0, [name]))).squeeze(), aovs.values(WHOLE, 24, name))
    names = ["color", "depth", "normal"]
    together = np.concatenate(list(bands(film, 0, names)))
    np.testing.assert_array_equal(together, np.concatenate([np.concatenate(list(bands(film, 0, [n]))) for n in names], axis=2))


def test_tiles_without_samples_are_0(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    assert not np.concatenate(list(bands(film, 0, ["color", "error"]))).any()
    film.merge([part(film, 1, 0, 2)])
    color = np.concatenate(list(bands(film, 0, ["color"])))
    tile = film.tiles[1]
    assert color[tile.y : tile.y + tile.h, tile.x : tile.x + tile.w].all()
    assert np.count_nonzero(color) == tile.w * tile.h * 3


@pytest.mark.parametrize("in_memory", [0, 1 << 20])
def test_digest_by_bands_equals_frame_digest(film: Film, tmp_path: Path, in_memory: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bands_module, "IN_MEMORY_BYTES", in_memory or 1)
    assert digest(film, 0, tmp_path) == film_math.digest(WHOLE)
