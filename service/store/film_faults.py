"""Classifies faults of a film's file.

FilmUnavailable   temporary
FilmLost          permanent
FilmDamaged       a FilmLost that is repaired by rendering again
"""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

from renderer.library_messages import library_message
from renderer.sentences import Sentence, joined_sentences, with_full_stop
from service.errors import FilmDamaged, FilmLost, FilmUnavailable, NotFound

__all__ = [
    "FILM",
    "FilmClosed",
    "damaged_film_error",
    "damaged_samples_error",
    "film_faults",
    "incomplete_film_error",
    "owned_elsewhere_error",
]

FILM = Sentence("film-of-job", "The film of this job")  # first words of all these error messages
RENDER_AGAIN_ADVICE = Sentence("advice-set-running", "Set the job to running to render it again.")

# SQLite's primary result codes of temporary faults, each with the end of its message.
_LOCKED = Sentence("film-locked", "The film of this job is locked by another program")
TEMPORARY_SQLITE_ERRORS: dict[int, str] = {
    sqlite3.SQLITE_BUSY: _LOCKED,
    sqlite3.SQLITE_LOCKED: _LOCKED,
    sqlite3.SQLITE_PROTOCOL: _LOCKED,
    sqlite3.SQLITE_NOMEM: Sentence("film-memory-exhausted", "The film of this job does not fit into the free memory"),
    sqlite3.SQLITE_INTERRUPT: Sentence("film-access-interrupted", "Access to the film of this job was interrupted"),
    sqlite3.SQLITE_IOERR: Sentence("film-io-error", "The film of this job cannot be read or written at the moment"),
    sqlite3.SQLITE_CANTOPEN: Sentence("film-not-openable", "The film of this job cannot be opened at the moment"),
    sqlite3.SQLITE_READONLY: Sentence(
        "film-read-only", "The film of this job cannot be written: the file or its disk is read-only. Make it writable"
    ),
    sqlite3.SQLITE_FULL: Sentence(
        "film-disk-full",
        "The film of this job cannot be written: the disk is full. Delete scenes or jobs that are no longer needed",
    ),
}
PERMANENT_SQLITE_ERRORS = {sqlite3.SQLITE_PERM, sqlite3.SQLITE_AUTH}
FILE_REPLACED = sqlite3.SQLITE_READONLY_DBMOVED  # the file was replaced or removed: what is written to it is lost
# The primary codes of these are temporary, but the fault is permanent: the disk returns other bytes than were written.
DAMAGED = {sqlite3.SQLITE_IOERR_CORRUPTFS, sqlite3.SQLITE_IOERR_SHORT_READ, sqlite3.SQLITE_CANTOPEN_ISDIR}
TEMPORARY_OS_ERRORS = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.ENOMEM),
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.EINTR, errno.EBUSY),
}


class FilmClosed(NotFound):
    """Raised if the film is closed during a read, because its job was deleted or restarted, or because the service stops."""

    def __init__(self) -> None:
        super().__init__(Sentence("film-job-changed", "The job was deleted or restarted while its picture was read. Reload it."))


@contextmanager
def film_faults() -> Iterator[None]:
    """Context manager that converts errors of SQLite and the file system to FilmUnavailable or FilmLost."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        code = getattr(error, "sqlite_errorcode", None)
        if code is None:
            raise  # from the driver: a programming error, not a fault of the film
        raise _classify_error(code, library_message(error)) from error
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise _classify_error(sqlite3.SQLITE_FULL, "") from error
        if error.errno == errno.EROFS:
            raise _classify_error(sqlite3.SQLITE_READONLY, "") from error
        raise _classify_error(
            sqlite3.SQLITE_IOERR if error.errno in TEMPORARY_OS_ERRORS else sqlite3.SQLITE_PERM, library_message(error)
        ) from error


def damaged_film_error(detail: str) -> FilmDamaged:
    """Returns the error for a film with invalid content. detail: a sentence, or the error text of a library."""
    return FilmDamaged(
        Sentence("film-damaged", "{film} is damaged ({reason}). {advice}", film=FILM, reason=detail, advice=RENDER_AGAIN_ADVICE)
    )


def damaged_samples_error(first: int, tile: int) -> FilmDamaged:
    """Returns the error for a row of a film that does not match its checksum.

    first: first sample of the row. tile: index of its tile.
    """
    return damaged_film_error(
        Sentence(
            "film-samples-damaged", "samples from {first} on of tile {tile} differ from what was written", first=first, tile=tile
        )
    )


def incomplete_film_error(found: int, recorded: int) -> FilmDamaged:
    """Returns the error for a film with `found` samples, fewer than the `recorded` ones in the database."""
    if not found:
        return FilmDamaged(
            Sentence("film-emptied-advice", "{film} is missing or was emptied. {advice}", film=FILM, advice=RENDER_AGAIN_ADVICE)
        )
    return FilmDamaged(
        Sentence(
            "film-samples-missing",
            "{film} has only {found} of its {recorded} samples. Set the job to running to render the rest.",
            film=FILM,
            found=found,
            recorded=recorded,
        )
    )


def owned_elsewhere_error() -> FilmUnavailable:
    """Returns the error for a film that another service owns because it has taken over the farm."""
    return FilmUnavailable(Sentence("film-owned-elsewhere", "{film} now belongs to another service.", film=FILM))


def _classify_error(code: int, message: str) -> FilmUnavailable | FilmLost:
    primary = code & 0xFF
    detail = message if primary not in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY) else ""
    if primary in TEMPORARY_SQLITE_ERRORS and code not in DAMAGED and code != FILE_REPLACED:
        return FilmUnavailable(
            joined_sentences(
                _with_reason(TEMPORARY_SQLITE_ERRORS[primary], detail),
                Sentence("advice-job-continues", "The job continues once this is resolved."),
            )
        )
    if primary in PERMANENT_SQLITE_ERRORS or code == FILE_REPLACED:
        return FilmLost(
            joined_sentences(
                _with_reason(Sentence("film-not-writable", "The film of this job cannot be written"), detail),
                Sentence("advice-repair-and-set-running", "Repair this, then set the job to running."),
            )
        )
    return damaged_film_error(message)


def _with_reason(fact: str, detail: str) -> str:
    return Sentence("fact-with-reason", "{fact} ({reason}).", fact=fact, reason=detail) if detail else with_full_stop(fact)
