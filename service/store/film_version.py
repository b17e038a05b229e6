"""The versions of a film's file. One of an older release is brought up to date when it is opened.

0   release 0.1.0: parts and bad samples, and no word about which picture they are of
1   the film says its picture's size, its tiles' and its fixed point, so that another job's film is not taken for this one
2   every part has a checksum; parts of before have none until they are folded
"""

from __future__ import annotations

import sqlite3
import zlib
from dataclasses import astuple, dataclass

from service.errors import FilmLost
from service.store.film_faults import damaged

__all__ = ["VERSION", "FilmShape", "Row", "bring_up_to_date", "checksum", "is_up_to_date", "is_whole"]

VERSION = 2

Row = tuple[int, int, int, int, int, bytes]  # frame, tile, first, count, bad, sums

# `part`: a merged batch. Its samples first ... first + count - 1, and their packed sums. Columns are only ever added at the end.
SCHEMA = (
    """CREATE TABLE IF NOT EXISTS part (
        frame INTEGER, tile INTEGER, first INTEGER, count INTEGER, bad INTEGER, sums BLOB,
        PRIMARY KEY (frame, tile, first))""",
    "ALTER TABLE part ADD COLUMN checksum INTEGER",
    "CREATE TABLE IF NOT EXISTS bad_sample (frame INTEGER, x INTEGER, y INTEGER, sample INTEGER)",
)
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
    if version == 0:
        database.execute("INSERT INTO shape VALUES (?, ?, ?, ?)", astuple(shape))
    database.execute(f"PRAGMA user_version = {VERSION}")


def checksum(row: Row) -> int:
    """Of all that a part says: a disk that gives back other bytes than were written is found out."""
    *numbers, sums = row
    return zlib.crc32(sums, zlib.crc32(repr(numbers).encode()))


def is_whole(row: Row, known: int | None) -> bool:
    """Whether a part is what was written; `known`: its checksum, None where a release before has left none."""
    return known is None or (isinstance(row[5], bytes) and checksum(row) == known)
