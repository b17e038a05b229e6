"""Classification of faults of a film's file: temporary (FilmWaits), permanent (FilmLost), or repairable by rendering again
(FilmDamaged, a FilmLost).
"""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

from renderer.sentences import Sentence, joined, with_full_stop
from service.errors import FilmDamaged, FilmLost, FilmWaits, NotFound

__all__ = ["FILM", "FilmClosed", "damaged", "film_faults", "incomplete", "owned_elsewhere"]

FILM = Sentence("film-of-job", "The film of this job")  # first words of all these error messages
AGAIN = Sentence("advice-set-running", "Set the job to running to render it again.")

# SQLite's primary result codes of temporary faults, each with the end of its message.
_LOCKED = Sentence("film-locked", "The film of this job is locked by another program")
PASSES: dict[int, str] = {
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
STAYS = {sqlite3.SQLITE_PERM, sqlite3.SQLITE_AUTH}
MOVED = sqlite3.SQLITE_READONLY_DBMOVED  # the file was replaced or removed: what is written to it is lost
# The primary codes of these are temporary, but the fault is permanent: the disk returns other bytes than were written.
DAMAGED = {sqlite3.SQLITE_IOERR_CORRUPTFS, sqlite3.SQLITE_IOERR_SHORT_READ, sqlite3.SQLITE_CANTOPEN_ISDIR}
OS_PASSES = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.ENOMEM),
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.EINTR, errno.EBUSY),
}


class FilmClosed(NotFound):
    """Raised if the film is closed during a read: its job was deleted or restarted, or the service stops."""

    def __init__(self) -> None:
        super().__init__(Sentence("film-job-changed", "The job was deleted or restarted while its picture was read."))


@contextmanager
def film_faults() -> Iterator[None]:
    """Context manager that converts errors of SQLite and the file system to FilmWaits or FilmLost."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        code = getattr(error, "sqlite_errorcode", None)
        if code is None:
            raise  # from the driver: a programming error, not a fault of the film
        raise _classified(code, str(error)) from error
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise _classified(sqlite3.SQLITE_FULL, "") from error
        if error.errno == errno.EROFS:
            raise _classified(sqlite3.SQLITE_READONLY, "") from error
        raise _classified(sqlite3.SQLITE_IOERR if error.errno in OS_PASSES else sqlite3.SQLITE_PERM, str(error)) from error


def damaged(why: str) -> FilmDamaged:
    """Returns the error for a film with invalid content. why: detail for the message."""
    return FilmDamaged(Sentence("film-damaged", "{film} is damaged ({reason}). {advice}", film=FILM, reason=why, advice=AGAIN))


def incomplete(has: int, recorded: int) -> FilmDamaged:
    """Returns the error for a film with fewer samples (`has`) than the database records."""
    if not has:
        return FilmDamaged(Sentence("film-emptied-advice", "{film} is missing or was emptied. {advice}", film=FILM, advice=AGAIN))
    return FilmDamaged(
        Sentence(
            "film-samples-missing",
            "{film} has only {found} of its {recorded} samples. Set the job to running to render the rest.",
            film=FILM,
            found=has,
            recorded=recorded,
        )
    )


def owned_elsewhere() -> FilmWaits:
    """Returns the error for a film that belongs to another service, which has taken over the farm."""
    return FilmWaits(Sentence("film-owned-elsewhere", "{film} now belongs to another service.", film=FILM))


def _classified(code: int, message: str) -> FilmWaits | FilmLost:
    primary = code & 0xFF
    why = message if primary not in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY) else ""
    if primary in PASSES and code not in DAMAGED and code != MOVED:
        return FilmWaits(
            joined(
                _with_why(PASSES[primary], why),
                Sentence("advice-job-continues", "The job continues once this is resolved."),
            )
        )
    if primary in STAYS or code == MOVED:
        return FilmLost(
            joined(
                _with_why(Sentence("film-not-writable", "The film of this job cannot be written"), why),
                Sentence("advice-repair-and-set-running", "Repair this, then set the job to running."),
            )
        )
    return damaged(message)


def _with_why(fact: str, why: str) -> str:
    return Sentence("fact-with-reason", "{fact} ({reason}).", fact=fact, reason=why) if why else with_full_stop(fact)
