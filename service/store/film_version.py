"""Versions of the film file format. A film of an older release is migrated when it is opened.

0   release 0.1.0: rows with sums, and bad samples, without a record of the image to which they belong
1   stores image size, tile size and fixed-point exponent, so that another job's film is rejected
2   each row has a checksum; older rows have none until they are folded
3   each row names the workers whose sums it contains, and may have several sample ranges
4   a row with sums of several workers has the number of samples of each
"""

from __future__ import annotations

import json
import sqlite3
import zlib
from dataclasses import astuple, dataclass

from renderer.sentences import Sentence
from service.errors import FilmLost
from service.store.film_faults import damaged_film_error

__all__ = [
    "VERSION",
    "FilmShape",
    "Row",
    "checksum",
    "create_or_migrate",
    "is_up_to_date",
    "matches_checksum",
    "sample_ranges",
    "select_rows",
]

VERSION = 4

Row = tuple[int, int, int, int, int, bytes, str | None, str | None]  # frame, tile, first, count, bad, sums, workers, ranges

# `part`: one merged batch or several: the packed sums, the number of samples per pixel, and the first sample. The samples are
# first ... first + count - 1, or those in `ranges` if it is set: [[first, count], ...]. `workers`: as service/store/senders.py
# encodes them; NULL: unknown.
SCHEMA = (
    """CREATE TABLE IF NOT EXISTS part (
        frame INTEGER, tile INTEGER, first INTEGER, count INTEGER, bad INTEGER, sums BLOB,
        PRIMARY KEY (frame, tile, first))""",
    "CREATE TABLE IF NOT EXISTS bad_sample (frame INTEGER, x INTEGER, y INTEGER, sample INTEGER)",
)
VERSION_OF_COLUMN = {"checksum": 2, "workers": 3, "ranges": 3}  # columns of `part`, and the version that added each
SHAPE = "CREATE TABLE IF NOT EXISTS shape (width INTEGER, height INTEGER, tile_size INTEGER, film_exponent INTEGER)"


@dataclass(frozen=True)
class FilmShape:
    """Image size, tile size and fixed-point exponent: the layout of a film's sums."""

    width: int
    height: int
    tile_size: int
    film_exponent: int


def is_up_to_date(database: sqlite3.Connection, shape: FilmShape) -> bool:
    """Returns True if a film has the format version of this release. Writes nothing.

    Raises FilmLost for a newer version, or for a film with another shape.
    """
    (version,) = database.execute("PRAGMA user_version").fetchone()
    if version > VERSION:
        raise FilmLost(
            Sentence(
                "film-version-newer",
                "The film of this job has version {version}, but this release of Rayfarm reads films up "
                "to version {newest}. Start the newer release, or make a new job.",
                version=version,
                newest=VERSION,
            )
        )
    if version:
        found = database.execute("SELECT width, height, tile_size, film_exponent FROM shape").fetchall()
        if found != [astuple(shape)]:
            raise damaged_film_error(
                Sentence(
                    "film-of-another-picture",
                    "it belongs to another picture: {found} instead of {expected}",
                    found=str(found),
                    expected=str(astuple(shape)),
                )
            )
    return bool(version == VERSION)


def create_or_migrate(database: sqlite3.Connection, shape: FilmShape) -> None:
    """Creates or migrates the tables of a film, within the caller's transaction."""
    (version,) = database.execute("PRAGMA user_version").fetchone()
    for statement in (*SCHEMA, SHAPE):
        database.execute(statement)
    for column, since in VERSION_OF_COLUMN.items():
        if version < since:
            database.execute(f"ALTER TABLE part ADD COLUMN {column} {'INTEGER' if column == 'checksum' else 'TEXT'}")
    if version == 0:
        database.execute("INSERT INTO shape VALUES (?, ?, ?, ?)", astuple(shape))
    database.execute(f"PRAGMA user_version = {VERSION}")


def select_rows(version: int = VERSION) -> str:
    """Returns the SQL query for all rows of a film of this version: the columns of a Row and its checksum."""
    later = [name if VERSION_OF_COLUMN[name] <= version else "NULL" for name in ("workers", "ranges", "checksum")]
    return f"SELECT frame, tile, first, count, bad, sums, {', '.join(later)} FROM part"


def sample_ranges(first: int, count: int, ranges: str | None) -> list[tuple[int, int]]:
    """Returns the sample ranges of a row as (first, count). Raises ValueError or TypeError if they are invalid.

    first, count: first sample, and total number. ranges: JSON text with several ranges; None for one contiguous range.
    """
    if ranges is None:
        return [(first, count)]
    found = [(int(a), int(n)) for a, n in json.loads(ranges)]
    if not found or found[0][0] != first or sum(n for _, n in found) != count:
        raise ValueError(f"a part of {count} samples from {first} on is said to have {ranges[:100]}")
    return found


def checksum(row: Row) -> int:
    """Returns the CRC-32 of all columns of a row, which detects bytes that have changed on the disk."""
    columns = [*row[:5], *(each for each in row[6:] if each is not None)]
    return zlib.crc32(row[5], zlib.crc32(repr(columns).encode()))


def matches_checksum(row: Row, expected: int | None) -> bool:
    """Returns True if a row matches its checksum `expected`, or if that is None, as for rows of older releases."""
    return expected is None or (isinstance(row[5], bytes) and checksum(row) == expected)
