"""The versions of a film's file. One of an older release is brought up to date when it is opened.

0   release 0.1.0: parts and bad samples, and no word about which picture they are of
1   the film says its picture's size, its tiles' and its fixed point, so that another job's film is not taken for this one
2   every part has a checksum; parts of before have none until they are folded
3   every part names the workers whose sums are in it, and may have several ranges of samples
"""

from __future__ import annotations

import json
import sqlite3
import zlib
from dataclasses import astuple, dataclass

from service.errors import FilmLost
from service.store.film_faults import damaged

__all__ = ["VERSION", "FilmShape", "Row", "bring_up_to_date", "checksum", "is_up_to_date", "is_whole", "select_rows", "spans"]

VERSION = 3

Row = tuple[int, int, int, int, int, bytes, str | None, str | None]  # frame, tile, first, count, bad, sums, workers, ranges

# `part`: a merged batch, or some of them: its packed sums, how many samples of a pixel they have, and their first. They are
# first ... first + count - 1, unless `ranges` has them: [[first, count], ...]. `workers`: a list of names; none: nobody knows.
SCHEMA = (
    """CREATE TABLE IF NOT EXISTS part (
        frame INTEGER, tile INTEGER, first INTEGER, count INTEGER, bad INTEGER, sums BLOB,
        PRIMARY KEY (frame, tile, first))""",
    "CREATE TABLE IF NOT EXISTS bad_sample (frame INTEGER, x INTEGER, y INTEGER, sample INTEGER)",
)
ADDED = {"checksum": 2, "workers": 3, "ranges": 3}  # columns of `part`, and the version that brought each
SHAPE = "CREATE TABLE IF NOT EXISTS shape (width INTEGER, height INTEGER, tile_size INTEGER, film_exponent INTEGER)"


@dataclass(frozen=True)
class FilmShape:
    """What a film's sums are laid out by."""

    width: int
    height: int
    tile_size: int
    film_exponent: int


def is_up_to_date(database: sqlite3.Connection, shape: FilmShape) -> bool:
    """Whether the film is of this version; writes nothing. Raises FilmLost for one that this release cannot read."""
    (version,) = database.execute("PRAGMA user_version").fetchone()
    if version > VERSION:
        raise FilmLost(
            f"The film of this job is of version {version}, and this release of Rayfarm reads films up to version {VERSION}. "
            "Start the newer release again, or make a new job."
        )
    if version:
        found = database.execute("SELECT width, height, tile_size, film_exponent FROM shape").fetchall()
        if found != [astuple(shape)]:
            raise damaged(f"it is of another picture: {found}, not {astuple(shape)}")
    return bool(version == VERSION)


def bring_up_to_date(database: sqlite3.Connection, shape: FilmShape) -> None:
    """Make or migrate the tables of a film of an older version, within the caller's transaction."""
    (version,) = database.execute("PRAGMA user_version").fetchone()
    for statement in (*SCHEMA, SHAPE):
        database.execute(statement)
    for column, since in ADDED.items():
        if version < since:
            database.execute(f"ALTER TABLE part ADD COLUMN {column} {'INTEGER' if column == 'checksum' else 'TEXT'}")
    if version == 0:
        database.execute("INSERT INTO shape VALUES (?, ?, ?, ?)", astuple(shape))
    database.execute(f"PRAGMA user_version = {VERSION}")


def select_rows(version: int = VERSION) -> str:
    """SQL for the parts of a film of some version: a Row each, and its checksum."""
    later = [name if ADDED[name] <= version else "NULL" for name in ("workers", "ranges", "checksum")]
    return f"SELECT frame, tile, first, count, bad, sums, {', '.join(later)} FROM part"


def spans(first: int, count: int, ranges: str | None) -> list[tuple[int, int]]:
    """The samples of a part, as (first, count). Raises ValueError or TypeError where they make no sense."""
    if ranges is None:
        return [(first, count)]
    found = [(int(a), int(n)) for a, n in json.loads(ranges)]
    if not found or found[0][0] != first or sum(n for _, n in found) != count:
        raise ValueError(f"a part of {count} samples from {first} on is said to have {ranges[:100]}")
    return found


def checksum(row: Row) -> int:
    """Of all that a part says: a disk that gives back other bytes than were written is found out."""
    told = [*row[:5], *(each for each in row[6:] if each is not None)]
    return zlib.crc32(row[5], zlib.crc32(repr(told).encode()))


def is_whole(row: Row, known: int | None) -> bool:
    """Whether a part is what was written; `known`: its checksum, None where a release before has left none."""
    return known is None or (isinstance(row[5], bytes) and checksum(row) == known)
