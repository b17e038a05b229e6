"""Reads a frame of a film from top to bottom, one row of tiles at a time, so that a large frame is never in memory as a whole."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from renderer import aovs, cryptomatte
from renderer import deep as deep_math
from renderer import film as film_math
from renderer.deep_samples import DeepRows, deep_rows
from renderer.film import Gain, Sums, plane_count
from renderer.settings import Tile
from service.store.film_faults import film_faults
from service.store.film_moment import ReadableFilm
from service.store.films import Film

__all__ = ["bands", "deep_bands", "digest", "digest_memory"]

F32 = npt.NDArray[np.float32]
IN_MEMORY_BYTES = 32 << 20


def bands(
    film: ReadableFilm,
    frame: int,
    names: Sequence[str],
    names_of_ids: Mapping[str, Sequence[str]] = MappingProxyType({}),
    gains: Sequence[Gain] = (),
) -> Iterator[F32]:
    """Yields a frame as bands from top to bottom, one per row of tiles: (h, width, channels) float32.

    names: "color" and names of AOVs, whose channels are concatenated along the last axis. Pixels of tiles without samples are
    0. names_of_ids: of objects and materials, for Cryptomatte. gains: of the film's light groups, for the colour (film.mixed);
    empty for the colour as rendered. Raises FilmUnavailable, FilmLost or FilmClosed.
    """
    read = (name for name in names if name != "color" or not gains)
    wanted = sorted({plane for name in read for plane in aovs.planes(name, film.groups)} | set(_mixed_planes(gains)))
    size = sum(map(aovs.size, names))

    def values(tile: Tile, sums: Sums) -> F32:
        found = [
            _cryptomatte_planes(film, frame, tile, sums, names_of_ids)
            if aovs.is_matte(name)
            else _channel_means(sums, film, name, gains)
            for name in names
        ]
        return np.dstack(found) if len(found) > 1 else found[0].reshape(*sums.shape[1:], -1)

    for row, sums_of in _rows(film, frame, wanted):
        band = np.zeros((row[0].h, film.width, size), np.float32)
        for tile, sums in sums_of:
            band[:, tile.x : tile.x + tile.w] = values(tile, sums)
        yield band


def _cryptomatte_planes(film: ReadableFilm, frame: int, tile: Tile, sums: Sums, names: Mapping[str, Sequence[str]]) -> F32:
    hits = film.tile_hits(frame, film.tiles.index(tile))
    return cryptomatte.layers(hits, sums[film_math.SAMPLES], film.ranks, names)


def deep_bands(film: ReadableFilm, frame: int) -> Iterator[DeepRows]:
    """Yields the deep picture of a frame as bands from top to bottom, one per row of tiles. Raises as `bands` does."""
    count = plane_count(len(film.groups), film.is_transparent)
    wanted = [film_math.SAMPLES, *range(film_math.alpha_plane(len(film.groups)), count)]
    for row, sums_of in _rows(film, frame, wanted):
        sums = np.zeros((count, row[0].h, film.width), np.int64)
        parts = [deep_math.no_deep(film.deep)]
        for tile, found in sums_of:
            sums[wanted, :, tile.x : tile.x + tile.w] = found[wanted]
            deep = film.tile_deep(frame, film.tiles.index(tile))
            parts.append(deep_math.moved(deep, tile.x, 0, tile.w, film.width))
        yield deep_rows(deep_math.merged(parts), sums, film.film_exponent, len(film.groups), film.is_transparent)


def _mixed_planes(gains: Sequence[Gain]) -> Iterator[int]:
    """Yields the planes that film.mixed reads for these gains of the light groups."""
    if gains:
        yield film_math.SAMPLES
    for group, gain in enumerate(gains):
        if any(gain):
            planes = film_math.group_planes(group)
            yield from range(planes.start, planes.stop)


def _channel_means(sums: Sums, film: ReadableFilm, name: str, gains: Sequence[Gain]) -> F32:
    exponent = film.film_exponent
    if name != "color":
        return aovs.values(sums, exponent, name, film.groups)
    return film_math.mixed(sums, exponent, gains) if gains else film_math.mean(sums, exponent)


def digest(film: Film, frame: int, folder: Path) -> str:
    """Returns the digest of a whole frame, as defined by `renderer.film.digest`.

    The hash is computed plane by plane, so the whole planes are first gathered: in memory if they are smaller than
    IN_MEMORY_BYTES, else in a temporary file in `folder`.
    """
    planes = plane_count(len(film.groups), film.is_transparent)
    with film_faults():
        is_small = planes * film.height * film.width * 8 <= IN_MEMORY_BYTES
        digest = _hash_in_memory(film, frame, planes) if is_small else _hash_by_file(film, frame, planes, folder)
        if film.ranks:
            hits = (
                cryptomatte.moved(film.tile_hits(frame, i), tile.x, tile.y, tile.w, film.width)
                for i, tile in enumerate(film.tiles)
            )
            digest.update(film_math.bytes_of_hits(cryptomatte.merged(hits)))
        if film.deep:
            for _, numbers in groupby(range(len(film.tiles)), lambda i: film.tiles[i].y):
                digest.update(film_math.bytes_of_deep(_deep_of_band(film, frame, numbers)))
        return digest.hexdigest()


def _hash_in_memory(film: Film, frame: int, planes: int) -> hashlib._Hash:
    sums = film.tile_planes(frame, 0, range(planes)) if len(film.tiles) == 1 else None
    if sums is None:
        sums = np.zeros((planes, film.height, film.width), "<i8")
        for _, sums_of in _rows(film, frame, range(planes)):
            for tile, part in sums_of:
                sums[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] = part
    return hashlib.sha256(np.ascontiguousarray(sums[:planes], "<i8").data)


def _hash_by_file(film: Film, frame: int, planes: int, folder: Path) -> hashlib._Hash:
    with tempfile.TemporaryFile(dir=str(folder)) as file:
        for row, sums_of in _rows(film, frame, range(planes)):
            band = np.zeros((planes, row[0].h, film.width), "<i8")
            for tile, sums in sums_of:
                band[:, :, tile.x : tile.x + tile.w] = sums
            for i, plane in enumerate(band):
                file.seek((i * film.height + row[0].y) * film.width * 8)
                file.write(plane.data)
        file.seek(0)
        return hashlib.file_digest(file, "sha256")


def _deep_of_band(film: Film, frame: int, tiles: Iterable[int]) -> deep_math.Deep:
    """Returns the deep pixels of a row of tiles, given by their indices, with pixel indices in the frame."""
    known = ((film.tiles[i], film.tile_deep(frame, i)) for i in tiles)
    return deep_math.merged(deep_math.moved(deep, tile.x, tile.y, tile.w, film.width) for tile, deep in known)


def digest_memory(film: Film) -> int:
    """Returns the approximate peak memory of `digest`, in bytes."""
    return IN_MEMORY_BYTES + 2 * plane_count(len(film.groups), film.is_transparent) * film.tiles[0].h * film.width * 8


def _rows(film: ReadableFilm, frame: int, planes: Sequence[int]) -> Iterator[tuple[list[Tile], Iterator[tuple[Tile, Sums]]]]:
    """Yields, for each row of tiles, all its tiles and an iterator of (tile, sums) over those that have samples.

    planes: indices of the channels of the sums to read.
    """
    for _, group in groupby(range(len(film.tiles)), lambda i: film.tiles[i].y):
        row = list(group)
        found = ((film.tiles[i], film.tile_planes(frame, i, planes)) for i in row)
        yield [film.tiles[i] for i in row], ((tile, sums) for tile, sums in found if sums is not None)
