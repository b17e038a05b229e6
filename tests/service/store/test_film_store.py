"""Tests that there is one Film object per job, however long it is held."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import numpy as np
import pytest

from renderer.settings import RenderSettings, View
from service.errors import FilmLost
from service.store import film_store
from service.store.film_faults import FilmClosed
from service.store.film_snapshots import FilmSnapshots
from service.store.film_store import MAX_OPEN, FilmFolder
from service.store.films import Film
from service.store.row_folding import MAX_ROWS_UNFOLDED
from tests.service.peer_worker import expected_sums
from tests.service.store.test_films import HEIGHT, TILE, WIDTH, part, rows_of

SETTINGS = RenderSettings(view=View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)), width=WIDTH, height=HEIGHT)


def snapshots(folder: Path) -> FilmSnapshots:
    return FilmSnapshots(folder / "snapshots", 1 << 20, 0)


@pytest.fixture
def films(tmp_path: Path) -> FilmFolder:
    return FilmFolder(tmp_path / "films", 1 << 20, snapshots(tmp_path))


def pin_films(films: FilmFolder, job: str = "job") -> Film:
    film = films.open(job, SETTINGS, TILE, pin=True)
    film.open_file(create=True)  # as for its first batch
    return film


def test_film_file_is_created_with_first_batch(films: FilmFolder, tmp_path: Path) -> None:
    film = films.open("job", SETTINGS, TILE, pin=True)
    assert (film.has_file, film.is_empty, film.samples(0)) == (False, True, 0)
    assert not list((tmp_path / "films").iterdir())
    assert film.merge([part(film, 0, 0, 1)]) == [True]
    assert film.has_file
    assert (tmp_path / "films" / "job.sqlite").exists()


@pytest.mark.long
def test_open_film_files_are_limited(films: FilmFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film_store, "MAX_FILES", 3)

    def open_files() -> int:
        links = list(Path("/proc/self/fd").iterdir())
        return sum(link.is_symlink() and str(tmp_path) in str(link.readlink()) for link in links)

    all_films = [pin_films(films, f"job{i}") for i in range(20)]
    for first in range(3):
        for film in all_films:
            assert film.merge([part(film, 0, first, 1)]) == [True]
        assert open_files() <= 9
    assert [film.merge([part(film, 0, 2, 1)]) for film in all_films] == [[False]] * 20, "each takes it once"
    assert all(film.coverage(0, 0).total == 3 for film in all_films)
    films.close()
    again = films.open("job7", SETTINGS, TILE)
    assert again.coverage(0, 0).total == 3


def test_viewer_and_renderer_share_film_object(films: FilmFolder) -> None:
    """A film that a viewer holds is also the object that rendering merges into, even after other films evict it from the store.

    With two objects for one job, each would fold rows by an outdated index.
    """
    watched = pin_films(films)
    watched.merge([part(watched, 0, first, 1) for first in range(MAX_ROWS_UNFOLDED - 1)])
    films.unpin("job")
    for other in range(MAX_OPEN + 1):
        films.open(f"other{other}", SETTINGS, TILE)
    rendered = pin_films(films)
    rendered.merge([part(rendered, 0, MAX_ROWS_UNFOLDED - 1, 1)])
    rendered.merge([part(rendered, 0, MAX_ROWS_UNFOLDED, 1)])
    assert watched.merge([part(watched, 0, MAX_ROWS_UNFOLDED - 1, 1)]) == [False], "whoever holds it knows what is in"
    for film in (watched, rendered):
        np.testing.assert_array_equal(film.tile_sums(0, 0), expected_sums(film.tiles[0], 0, MAX_ROWS_UNFOLDED + 1, 0))
    assert watched is rendered


@pytest.mark.long
def test_unused_film_is_closed(films: FilmFolder) -> None:
    film = pin_films(films)
    database = rows_of(film)
    films.unpin("job")
    del film
    for other in range(MAX_OPEN + 1):
        films.open(f"other{other}", SETTINGS, TILE)
    gc.collect()
    with pytest.raises(Exception, match="closed"):
        database.execute("SELECT 1")


@pytest.mark.long
def test_pinned_film_stays_open(films: FilmFolder) -> None:
    database = rows_of(pin_films(films))
    for other in range(MAX_OPEN + 1):
        films.open(f"other{other}", SETTINGS, TILE)
    gc.collect()
    database.execute("SELECT 1")


def test_reading_creates_no_film(films: FilmFolder, tmp_path: Path) -> None:
    film = films.open("job", SETTINGS, TILE)
    assert film.samples(0) == 0
    assert film.tile_sums(0, 0) is None
    assert film.bad_samples(0) == (0, [])
    assert list((tmp_path / "films").iterdir()) == []
    assert film.merge([part(film, 0, 0, 1)]) == [True], "until there is something to write"


def test_film_with_missing_samples_raises_error(films: FilmFolder, tmp_path: Path) -> None:
    film = pin_films(films)
    film.merge([part(film, 0, 0, 2)])
    has = film.samples(0)
    assert films.open("job", SETTINGS, TILE, recorded=has) is film
    with pytest.raises(FilmLost, match=f"only {has} of its {has + 1} samples"):
        films.open("job", SETTINGS, TILE, recorded=has + 1)
    films.close()
    (tmp_path / "films" / "job.sqlite").write_bytes(b"")
    with pytest.raises(FilmLost, match="missing or was emptied"):
        FilmFolder(tmp_path / "films", 0, snapshots(tmp_path)).open("job", SETTINGS, TILE, recorded=has)
    (tmp_path / "films" / "job.sqlite").unlink()
    with pytest.raises(FilmLost, match="missing or was emptied"):
        FilmFolder(tmp_path / "films", 0, snapshots(tmp_path)).open("job", SETTINGS, TILE, recorded=has)


def test_damaged_film_is_renamed_and_job_starts_again(films: FilmFolder, tmp_path: Path) -> None:
    (tmp_path / "films" / "job.sqlite").write_bytes(b"nonsense" * 100)
    with pytest.raises(FilmLost):
        pin_films(films)
    films.quarantine("job")
    film = pin_films(films)
    assert film.merge([part(film, 0, 0, 1)]) == [True]
    assert (tmp_path / "films" / "job.sqlite.lost").read_bytes() == b"nonsense" * 100
    films.quarantine("job")
    with pytest.raises(FilmClosed):
        film.tile_sums(0, 0)
    films.quarantine("job")  # does nothing without a film
    films.delete("job")
    assert list((tmp_path / "films").iterdir()) == []


def test_film_may_be_deleted_during_size_query(films: FilmFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = films._path("gone")
    path.write_bytes(b"film")
    look = Path.stat

    def looked(self: Path, **options: bool) -> os.stat_result:
        found = look(self, **options)
        if self == path:
            path.unlink()
        return found

    monkeypatch.setattr(Path, "stat", looked)
    assert films.size("gone") == 4
    assert films.size("gone") == 0


def test_sweep_deletes_films_of_deleted_jobs(films: FilmFolder, tmp_path: Path) -> None:
    for job in ("kept", "gone", "lost"):
        pin_films(films, job)
    films.quarantine("lost")
    films.close()
    FilmFolder(tmp_path / "films", 0, snapshots(tmp_path)).sweep({"kept"})
    assert {path.name.partition(".")[0] for path in (tmp_path / "films").iterdir()} == {"kept"}


def test_sweep_deletes_only_interrupted_copies(films: FilmFolder, tmp_path: Path) -> None:
    pin_films(films, "source").merge([part(pin_films(films, "source"), 0, 0, 1)])
    left = [tmp_path / "films" / f"killed.sqlite.new{suffix}" for suffix in ("", "-wal", "-shm")]
    for path in left:
        path.write_bytes(b"half of it")
    begun = FilmFolder(tmp_path / "films", 0, snapshots(tmp_path))
    with begun.copy("copy", SETTINGS, TILE) as take:
        take("source", [0], 8)
        begun.sweep({"source"})
        assert not any(path.exists() for path in left)
    assert begun.open("copy", SETTINGS, TILE).samples(0) > 0
    begun.sweep({"source"})
    assert begun.open("copy", SETTINGS, TILE).samples(0) > 0, "its job is about to be recorded"
