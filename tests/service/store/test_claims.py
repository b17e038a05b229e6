"""Tests that a film accepts each sample once, even if a batch arrives both by itself and within sums of several batches."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from renderer.film import BadSample
from service.store.films import Film
from tests.service.peer_worker import expected_sums
from tests.service.store.test_films import make, part, rows_of


def assert_film_has(film: Film, tile: int, samples: int) -> None:
    """Asserts that a film has exactly the first `samples` samples of a tile, with the expected sums.

    This is asserted for the given Film object, and for another one that reads the same file.
    """
    again = make(film._path)
    for each in (film, again):
        np.testing.assert_array_equal(each.tile_sums(0, tile), expected_sums(film.tiles[tile], 0, samples, 0))
        assert each.coverage(0, tile).ranges == [(0, samples)]
    again.close()


@pytest.mark.parametrize("alone", [[(4, 2)], [(0, 2)], [(8, 4)], [(0, 2), (6, 2), (10, 2)]])
def test_combined_contribution_replaces_its_parts(tmp_path: Path, alone: list[tuple[int, int]]) -> None:
    film = make(tmp_path / "job.sqlite")
    for first, count in alone:
        bad = [BadSample(1, 2, first), BadSample(1, 3, first + 1)]
        assert film.merge([part(film, 0, first, count, bad=bad, bad_count=2)]) == [True]
    assert film.merge([part(film, 1, 0, 12)]) == [True], "of another tile"
    film.tile_sums(0, 0)  # a read tile is not mistaken for a stored one
    bad = [BadSample(1, 2, 4), BadSample(3, 3, 11)]
    assert film.merge([part(film, 0, 0, 12, bad=bad, bad_count=2)]) == [True]
    assert_film_has(film, 0, 12)
    assert_film_has(film, 1, 12)
    assert film.bad_samples(0) == (2, bad)
    assert film.bad_count(0) == 2
    assert film.merge([part(film, 0, first, count) for first, count in alone]) == [False] * len(alone)
    assert rows_of(film).execute("SELECT first, count FROM part WHERE tile = 0").fetchall() == [(0, 12)]
    film.close()


def test_largest_of_overlapping_contributions_is_accepted(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    parts = [part(film, 0, 4, 2), part(film, 0, 0, 12), part(film, 0, 0, 12), part(film, 0, 10, 4), part(film, 0, 12, 3)]
    assert film.merge(parts) == [False, True, False, False, True]
    assert_film_has(film, 0, 15)
    film.close()


def test_only_damaged_contribution_is_dropped(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    parts = [part(film, 0, first, 2) for first in range(0, 8, 2)]
    damaged = [*parts[:2], replace(parts[2], sums=parts[2].sums[:-1]), parts[3]]
    assert film.merge([*damaged, parts[2]]) == [True, True, False, True, True]
    assert_film_has(film, 0, 8)
    film.close()


def test_partly_overlapping_contribution_is_dropped(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    assert film.merge([part(film, 0, 0, 4)]) == [True]
    assert film.merge([part(film, 0, 2, 10)]) == [False], "of a row the film does not know one half from the other"
    assert film.merge([part(film, 0, 0, 4)]) == [False], "nothing new"
    assert film.merge([part(film, 0, 4, 2), part(film, 0, 7, 2)]) == [True, True]
    assert film.merge([part(film, 0, 4, 6)]) == [True]
    assert_film_has(film, 0, 10)
    film.close()


def test_separate_senders_prevent_replacement(tmp_path: Path) -> None:
    film = make(tmp_path / "job.sqlite")
    film.separates_senders = True
    assert film.merge([part(film, 0, 4, 2, workers={"honest": 2})]) == [True]
    assert film.merge([part(film, 0, 0, 12, workers={"another": 12})]) == [False]
    assert film.has_sums_of("honest")
    film.close()
