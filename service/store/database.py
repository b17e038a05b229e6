"""The connection to the database: SQLite in WAL mode by default, PostgreSQL by its URL."""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from pydantic_core import from_json
from sqlalchemy import Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import DataError, DBAPIError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.orm import Session, sessionmaker

from service.errors import Invalid, Unavailable
from service.store.room import no_room
from service.store.turns import Turns
from service.store.upgrade import upgrade
from service.store.whole import PRIVATE

__all__ = ["Fence", "Sessions", "close_database", "connect", "faults", "open_database"]

LOCK_PATIENCE_S = 5.0
PATIENCE = "patience_ms"  # option of an execution, and what a connection of SQLite's is set to
POOL, OVERFLOW = 10, 60  # connections: of 40 threads that answer requests, each may need two, and the engine always needs one

Fence = Callable[[Session], None]  # raises FarmError for a transaction that may not be


class Sessions:
    """Makes sessions: `sessions()` to read, `sessions.begin()` for one transaction that writes.

    Raises NoRoom where the disk is full, Unavailable where the database is locked or away, Invalid for what it cannot have.
    patience_s: how long a lock of SQLite's is waited for. fence: asked at the beginning of each transaction that writes.
    """

    def __init__(
        self,
        engine: Engine,
        patience_s: float = LOCK_PATIENCE_S,
        fence: Fence | None = None,
        turns: Turns | None = None,
        is_urgent: bool = False,
    ) -> None:
        """turns: shared by all who write to this database in this process. is_urgent: goes before the others."""
        self._engine = engine
        self._fence = fence
        self._patience_s = patience_s
        self._turns = turns or Turns()
        self._is_urgent = is_urgent
        self._is_sqlite = engine.dialect.name == "sqlite"
        options = {PATIENCE: round(patience_s * 1000)}
        self._readers = sessionmaker(engine.execution_options(**options), expire_on_commit=False)
        self._writers = sessionmaker(engine.execution_options(writes=True, **options), expire_on_commit=False)

    def with_patience(self, seconds: float) -> Sessions:
        """The same database, for whoever must not wait so long: it writes before all others that wait."""
        return Sessions(self._engine, seconds, self._fence, self._turns, is_urgent=True)

    def fenced(self, fence: Fence) -> Sessions:
        """The same database, with the usual patience, for whoever writes only as long as `fence` lets it."""
        return Sessions(self._engine, fence=fence, turns=self._turns)

    @contextmanager
    def __call__(self) -> Iterator[Session]:
        """A session for reading."""
        with faults(), self._readers() as session:
            yield session

    @contextmanager
    def begin(self) -> Iterator[Session]:
        """A transaction: committed at its end, or rolled back where an exception leaves it."""
        turn = self._turns.taken(self._patience_s, self._is_urgent) if self._is_sqlite else nullcontext()
        with faults(), turn, self._writers.begin() as session:
            if self._fence is not None:
                self._fence(session)
            yield session


def connect(url: str) -> tuple[Engine, Sessions]:
    """The engine, its tables made or brought up to date, and the maker of sessions."""
    engine = open_database(url)
    upgrade(engine)
    return engine, Sessions(engine)


def open_database(url: str) -> Engine:
    """The engine, its tables as they are."""
    is_sqlite = url.startswith("sqlite")
    engine = create_engine(
        url,
        pool_pre_ping=not is_sqlite,
        connect_args={"timeout": LOCK_PATIENCE_S} if is_sqlite else {},
        json_deserializer=_json_or_nothing,
        pool_size=POOL,
        max_overflow=OVERFLOW,
        pool_timeout=LOCK_PATIENCE_S,
    )
    if is_sqlite:
        _make_private(make_url(url).database)
        event.listen(engine, "connect", _tune_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def close_database(engine: Engine) -> None:
    """Close all connections for good: those in use as soon as they are given back, as a request or a thread that outlives its
    farm still may."""

    def close(_: Any, record: Any) -> None:
        record.invalidate()

    def refuse(*_: Any) -> None:
        raise Unavailable("The service is going down.", advice="Try again when it is back.")

    event.listen(engine.pool, "checkin", close)
    event.listen(engine, "do_connect", refuse)
    engine.dispose()


def _json_or_nothing(text: str | bytes) -> Any:
    """A column's value; None for one that is damaged: it must not keep all other rows from being read."""
    try:
        return from_json(text)  # three times as fast as json.loads, and most of what reading many jobs takes
    except ValueError:
        pass
    try:
        return json.loads(text)  # half of a surrogate pair, from a file's name, is read by this alone
    except ValueError:
        return None


@contextmanager
def faults() -> Iterator[None]:
    """Raises NoRoom and Unavailable as `Sessions` does, for whoever asks the database without one."""
    try:
        yield
    except PoolTimeoutError as error:
        raise Unavailable("Too much is asked of the database at once.", advice="Try again in a moment.") from error
    except DBAPIError as error:
        if getattr(error.orig, "sqlite_errorcode", 0) in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE):
            raise no_room() from error
        if isinstance(error, DataError):  # of PostgreSQL, which takes no character 0
            raise Invalid("What is asked for has a character or a number that the database cannot have. Leave it out.") from error
        if isinstance(error, OperationalError):
            raise Unavailable(f"The database does not answer ({error.orig}).", advice="Try again.") from error
        raise


def _make_private(database: str | None) -> None:
    """SQLite gives what it makes beside the database the database's own mode."""
    if database and database != ":memory:":
        path = Path(database)
        os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, PRIVATE))
        for suffix in ("", "-wal", "-shm"):
            with contextlib.suppress(OSError):  # not there; or another's, and then as private as they made it
                path.with_name(path.name + suffix).chmod(PRIVATE)


def _tune_sqlite(connection: Any, _: Any) -> None:
    # In WAL mode NORMAL loses nothing when a process dies. When the machine itself loses power, FULL also keeps what was
    # acknowledged, and scenes and jobs are few.
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON"):
        connection.execute(f"PRAGMA {pragma}")
    connection.isolation_level = None  # the driver begins no transactions by itself: `_begin_sqlite` does


def _begin_sqlite(connection: Connection) -> None:
    # A transaction that reads and then writes must hold the lock from its beginning: else another writer may come between,
    # and what was decided by the reading is no longer true (or SQLite gives up with "database is locked").
    options = connection.get_execution_options()
    writes, patience_ms = options.get("writes"), options.get(PATIENCE, round(LOCK_PATIENCE_S * 1000))
    if connection.info.get(PATIENCE) != patience_ms:  # the connection is pooled; its last use may have had another
        connection.exec_driver_sql(f"PRAGMA busy_timeout={patience_ms}")
        connection.info[PATIENCE] = patience_ms
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
