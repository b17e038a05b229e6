"""Adds up the packed sums of a tile's rows in a film."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from protocol.sums import add_sums, merge_deep, merge_hits, unpack_sums
from renderer.cryptomatte import Hits
from renderer.deep import Deep
from renderer.film import Sums
from renderer.sentences import Sentence
from renderer.settings import Tile
from service.store.film_faults import damaged_film_error

__all__ = ["deep_of_rows", "hits_of_rows", "sum_of_rows"]


def sum_of_rows(rows: Iterable[bytes], tile: Tile, planes: Sequence[int] | None = None) -> Sums:
    """Returns the sum of a tile's packed rows, (planes, h, w) int64.

    rows: packed sums as stored in the film. planes: channels to add; None: all. Other channels are undefined.
    Raises FilmDamaged if `rows` is empty or a row cannot be unpacked.
    """
    total: Sums | None = None
    for packed in rows:
        try:
            if total is None:
                total = unpack_sums(packed, tile, stored=True, planes=planes)
            else:
                add_sums(total, packed, tile, stored=True, planes=planes)
        except (ValueError, TypeError) as error:
            raise damaged_film_error(str(error)) from error
    if total is None:
        raise damaged_film_error(Sentence("film-rows-missing", "rows are missing"))
    return total


def hits_of_rows(rows: Iterable[bytes], tile: Tile) -> Hits | None:
    """Returns the sum of Cryptomatte's counts of a tile's packed rows; None without any. Raises FilmDamaged if one is damaged."""
    try:
        return merge_hits(rows, tile, stored=True)
    except ValueError as error:
        raise damaged_film_error(str(error)) from error


def deep_of_rows(rows: Iterable[bytes], tile: Tile) -> Deep | None:
    """Returns the sum of the deep pixels of a tile's packed rows; None without any. Raises FilmDamaged if one is damaged."""
    try:
        return merge_deep(rows, tile, stored=True)
    except ValueError as error:
        raise damaged_film_error(str(error)) from error
