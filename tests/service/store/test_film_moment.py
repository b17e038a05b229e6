"""Tests that a snapshot of a film does not change with later merges."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from renderer.film import COLOR
from service.errors import FilmUnavailable
from service.store.bands import bands
from service.store.row_folding import MAX_ROWS_UNFOLDED
from tests.service.peer_worker import expected_sums
from tests.service.store.test_films import HEIGHT, WIDTH, make, part


def test_snapshot_is_unchanged_while_film_grows(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    film.merge([part(film, tile, 0, 1) for tile in range(len(film.tiles))])
    planes = list(range(COLOR.start, COLOR.stop))
    with film.snapshot() as moment:
        film.merge([part(film, 0, first, 1) for first in range(1, MAX_ROWS_UNFOLDED + 1)])
        assert film.coverage(0, 0).total == MAX_ROWS_UNFOLDED + 1
        assert moment.coverage(0, 0).total == 1 and moment.coverage(0, 1).total == 1
        sums = moment.tile_planes(0, 0, planes)
        assert sums is not None
        np.testing.assert_array_equal(sums[COLOR], expected_sums(film.tiles[0], 0, 1, 0)[COLOR])
        assert sum(len(band) for band in bands(moment, 0, ("color",))) == HEIGHT
    later = film.tile_sums(0, 0)
    assert later is not None and WIDTH > 0
    np.testing.assert_array_equal(later[COLOR], expected_sums(film.tiles[0], 0, MAX_ROWS_UNFOLDED + 1, 0)[COLOR])


def test_empty_film_has_no_snapshot(tmp_path: Path) -> None:
    with pytest.raises(FilmUnavailable):
        make(tmp_path / "job.sqlite").snapshot()
