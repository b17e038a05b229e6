"""A service process that wants to own the farm: takes a free farm at once, and otherwise waits as a standby.

An owner is dead if it has released the farm, if its lock on the folder is free, or if its process no longer exists on this
machine. A hanging owner shows none of these. So the candidate requests an answer through the database, and takes over the farm
after `lease_s` seconds without one. Later writes of the old owner are rejected (ownership.py).
"""

from __future__ import annotations

import logging
import secrets
import socket
import sqlite3
import time
from collections.abc import Callable

from sqlalchemy import inspect
from sqlalchemy.exc import DatabaseError

from renderer.library_messages import library_message
from renderer.sentences import Sentence
from service.errors import StartupError, Unavailable
from service.ownership import rows
from service.ownership.folder_lock import FolderLock
from service.ownership.owner_timeout import OwnerTimeout
from service.ownership.ownership import CHECK_EVERY_S, Ownership
from service.ownership.process import is_gone, is_stopped, kill_process, this_process
from service.settings import Settings
from service.store.database import Sessions, open_database, translated_faults
from service.store.models import FarmOwner
from service.store.reserve import Reserve
from service.store.upgrade import refuse_newer, upgrade

__all__ = ["Candidate", "take_farm"]

PATIENCE_S = 1.0  # timeout for a locked database, in seconds

log = logging.getLogger(__name__)


class Candidate:
    """Attempts to become the owner of the farm. Not thread-safe.

    Raises StartupError if this service cannot use the settings or the database.
    """

    def __init__(self, settings: Settings, clock: Callable[[], float] = time.monotonic) -> None:
        settings.make_folders()
        self._settings = settings
        self._clock = clock
        self._lock = FolderLock(settings.data)
        self._reserve = Reserve(settings.data / "reserve")
        self._engine = open_database(settings.database)
        self._sessions = Sessions(self._engine, PATIENCE_S)
        place = f"{socket.gethostname()}:{settings.port}"
        self._me = rows.Claimant(secrets.token_hex(8), place, settings.own_url, settings.instance_id(), this_process())
        self._silence = OwnerTimeout(settings.lease_s, clock)
        self._has_table = False
        self._looks_at = 0.0  # the row is not read again before this time
        self._stuck_since: float | None = None
        self.known: FarmOwner | None = None  # the row as last read

    def attempt(self) -> Ownership | None:
        """Returns the ownership if the farm is free or its owner is dead; else None.

        Fast enough to be called often. Raises Unavailable and StartupError.
        """
        has_lock = self._lock.attempt()
        if self._clock() < self._looks_at and not (has_lock and self._lock_proves_death()):
            self._lock.release()
            return None
        self._looks_at = self._clock() + CHECK_EVERY_S
        try:
            # On a full disk the reserve lets a restarted service record its ownership, without which nothing could be deleted.
            # With the folder's lock, no other service uses the reserve.
            epoch = self._reserve.run_deletion(lambda: self._guarded_epoch(True)) if has_lock else self._guarded_epoch(False)
        except BaseException as error:
            self._lock.release()
            if isinstance(error, DatabaseError) and _is_damage(error):
                raise StartupError(
                    Sentence(
                        "database-damaged",
                        "The database is damaged ({error}). `rayfarm doctor --data {data}` says more; `rayfarm restore` "
                        "makes a new folder of a backup.",
                        error=library_message(error.orig or error),
                        data=self._settings.data,
                    )
                ) from error
            raise
        if epoch is None:
            self._lock.release()
            return None
        return Ownership(self._engine, self._sessions, self._lock, epoch, self._settings.lease_s, self._clock)

    def close(self) -> None:
        """Stops being a candidate, and closes the database."""
        self._lock.release()
        self._engine.dispose()

    def _lock_proves_death(self) -> bool:
        """Returns True if a free lock on the data folder proves that the owner is dead, because the owner held that lock.

        Also returns True while the owner's database row has not been read.
        """
        return self.known is None or self.known.locked

    def _guarded_epoch(self, has_lock: bool) -> int | None:
        with translated_faults():
            return self._try_for_epoch(has_lock)

    def _try_for_epoch(self, has_lock: bool) -> int | None:
        if not self._has_owner_table():
            if not has_lock:
                return None  # the owner's release uses only the folder's lock
            upgrade(self._engine)
        row = self.known = rows.current_owner(self._sessions)
        if row is not None and not self._is_free(row, has_lock):
            return None
        refuse_newer(self._engine)
        epoch = rows.take_ownership(self._sessions, row, self._me, has_lock)
        if epoch is not None:
            if row is not None and row.owner is not None:
                log.warning("takes over from %s, which has ended or does not answer", row.place)
            upgrade(self._engine)
        return epoch

    def _has_owner_table(self) -> bool:
        self._has_table = self._has_table or inspect(self._engine).has_table(FarmOwner.__tablename__)
        return self._has_table

    def _is_free(self, row: FarmOwner, has_lock: bool) -> bool:
        # A database inside the folder may be a copy, whose row then describes the original farm.
        is_of_this_folder = row.folder == self._me.folder or not self._settings.database_url
        if row.owner is None or (has_lock and row.locked and is_of_this_folder) or is_gone(row.process):
            return True
        if self._silence.is_request_due(row):
            if not is_of_this_folder and self._silence.has_answered(row):
                raise StartupError(
                    Sentence(
                        "database-in-use",
                        "Another service ({place}) uses this database with films in another folder. Give "
                        "this one the same folder (RAYFARM_DATA), or a database of its own (RAYFARM_DATABASE_URL).",
                        place=row.place,
                    )
                )
            self._request_answer(row)
        return self._silence.has_expired

    def _request_answer(self, row: FarmOwner) -> None:
        try:
            self._silence.record_request(row.epoch, rows.request_answer(self._sessions, self._me.place))
        except Unavailable:
            self._kill_stopped_lock_holder(row)
            raise
        self._stuck_since = None

    def _kill_stopped_lock_holder(self, row: FarmOwner) -> None:
        """Kills the owner's process if it is suspended while it holds SQLite's write lock."""
        now = self._clock()
        self._stuck_since = self._stuck_since if self._stuck_since is not None else now
        if now - self._stuck_since > self._settings.lease_s and is_stopped(row.process) and kill_process(row.process or {}):
            log.warning("killed %s, which was suspended while it locked the database", row.place)


def _is_damage(error: DatabaseError) -> bool:
    """Returns True if a database error means that the file is corrupt. Other errors are bugs."""
    return getattr(error.orig, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT)


def take_farm(settings: Settings, patience_s: float) -> Ownership:
    """Takes the farm for a service that does not run as a standby. Raises StartupError if another service owns it.

    patience_s: maximum time to wait for an earlier service to end, in seconds.
    """
    candidate = Candidate(settings)
    deadline = time.monotonic() + patience_s
    try:
        while (found := candidate.attempt()) is None:
            if time.monotonic() > deadline:
                raise StartupError(
                    Sentence(
                        "data-folder-in-use",
                        "Another service uses {data}. Stop it, or set RAYFARM_DATA to a folder of its own.",
                        data=settings.data,
                    )
                )
            time.sleep(0.1)
    except BaseException:
        candidate.close()
        raise
    return found
