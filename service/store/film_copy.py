"""A film made of what another has. Its rows are copied, not shared: each may grow, be healed or deleted without the other."""

from __future__ import annotations

from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from renderer.settings import Tile, tiles_of
from service.errors import FilmLost, FilmWaits
from service.store.film_check import opened
from service.store.film_faults import FILM, damaged
from service.store.film_file import ROWS, FilmFile
from service.store.film_version import FilmShape, is_whole, spans
from service.store.whole import move_whole

__all__ = ["copy_film"]

AT_ONCE = 64  # rows, of which each may take a megabyte


def copy_film(source: Path, target: Path, shape: FilmShape, most: int) -> int:
    """Copy what a film has of frame 0, as it is at one moment; returns the samples, all pixels together.

    The copy has its name once it is whole. Raises FilmLost where the film has samples from number `most` on, where a row is not
    what was written, or where there is none, and FilmWaits.
    """
    if not source.exists():
        raise FilmLost(f"{FILM} is missing.")
    tiles = tiles_of(shape.width, shape.height, shape.tile_size)
    made = target.with_name(f"{target.name}.new")
    samples = 0
    try:
        with closing(opened(source)) as database:
            database.execute("BEGIN")
            end = _end(database.execute("SELECT first, count, ranges FROM part WHERE frame = 0").fetchall())
            if not 0 < end <= most:
                raise FilmLost(f"{FILM} has {end} samples of a pixel, and {most} are wanted.")
            file = FilmFile(made, shape)
            try:
                rows = database.execute(f"{ROWS} WHERE frame = 0")
                while found := rows.fetchmany(AT_ONCE):
                    samples += sum(_samples(row, tiles) for row in found)
                    file.add([row[:8] for row in found], [])
                file.add([], database.execute("SELECT frame, x, y, sample FROM bad_sample WHERE frame = 0").fetchall())
                file.settle()
            finally:
                file.close()
        if made.with_name(f"{made.name}-wal").exists():
            raise FilmWaits(f"{FILM} cannot be copied now.")
        move_whole(made, target)
    finally:
        for suffix in ("", "-wal", "-shm"):
            with suppress(OSError):
                made.with_name(made.name + suffix).unlink(missing_ok=True)
    return samples


def _end(parts: list[tuple[int, int, str | None]]) -> int:
    try:
        return max((first + count for part in parts for first, count in spans(*part)), default=0)
    except (ValueError, TypeError) as error:
        raise damaged(str(error)) from error


def _samples(row: tuple[Any, ...], tiles: list[Tile]) -> int:
    _, tile, first, count, *_ = row
    if not isinstance(tile, int) or not 0 <= tile < len(tiles) or not is_whole(row[:8], row[8]):
        raise damaged(f"samples from {first} on of tile {tile} are not what was written")
    return int(count) * tiles[tile].w * tiles[tile].h
