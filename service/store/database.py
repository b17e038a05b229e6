"""The database connection: SQLite in WAL mode by default, or PostgreSQL by its URL."""

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

from renderer.library_messages import library_message
from renderer.sentences import Sentence
from service.errors import Invalid, Unavailable
from service.store.atomic_files import PRIVATE
from service.store.disk_space import disk_full_error
from service.store.upgrade import upgrade
from service.store.writer_queue import WriterQueue

__all__ = ["Fence", "Sessions", "close_database", "connect", "open_database", "translated_faults"]

LOCK_TIMEOUT_S = 5.0
LOCK_TIMEOUT_OPTION = (
    "patience_ms"  # execution option with the lock timeout of a statement; also the key of a connection's current setting
)
POOL, OVERFLOW = 10, 60  # pooled and extra connections: each of 40 request threads may need two, and the engine needs one

Fence = Callable[[Session], None]  # raises FarmError if the transaction must not be made


class Sessions:
    """Factory of database sessions: `sessions()` for reading, `sessions.begin()` for a writing transaction.

    Sessions raise OutOfSpace if the disk is full, Unavailable if the database is locked or unreachable, and Invalid for values
    that the database cannot store.
    """

    def __init__(
        self,
        engine: Engine,
        lock_timeout_s: float = LOCK_TIMEOUT_S,
        fence: Fence | None = None,
        writer_queue: WriterQueue | None = None,
        is_urgent: bool = False,
    ) -> None:
        """Stores the options. lock_timeout_s: timeout of SQLite's lock in seconds.

        fence: called at the start of each writing transaction; raises FarmError to reject it. writer_queue: queue of all
        writers to this database in this process. is_urgent: whether this factory's transactions precede the others in the
        queue.
        """
        self._engine = engine
        self._fence = fence
        self._lock_timeout_s = lock_timeout_s
        self._writer_queue = writer_queue or WriterQueue()
        self._is_urgent = is_urgent
        self._is_sqlite = engine.dialect.name == "sqlite"
        options = {LOCK_TIMEOUT_OPTION: round(lock_timeout_s * 1000)}
        self._readers = sessionmaker(engine.execution_options(**options), expire_on_commit=False)
        self._writers = sessionmaker(engine.execution_options(writes=True, **options), expire_on_commit=False)

    def with_lock_timeout(self, seconds: float) -> Sessions:
        """Returns a factory whose sessions wait at most `seconds` for SQLite's lock.

        Its writing transactions precede all others in this process's queue.
        """
        return Sessions(self._engine, seconds, self._fence, self._writer_queue, is_urgent=True)

    def fenced(self, fence: Fence) -> Sessions:
        """Returns a factory whose writing transactions first call `fence`, which raises FarmError to reject them.

        It has the default timeout of the lock.
        """
        return Sessions(self._engine, fence=fence, writer_queue=self._writer_queue)

    @contextmanager
    def __call__(self) -> Iterator[Session]:
        """Opens a session for reading."""
        with translated_faults(), self._readers() as session:
            yield session

    @contextmanager
    def begin(self) -> Iterator[Session]:
        """Opens a writing transaction, which is committed on exit, or rolled back if an exception leaves the block."""
        turn = self._writer_queue.wait_for_turn(self._lock_timeout_s, self._is_urgent) if self._is_sqlite else nullcontext()
        with translated_faults(), turn, self._writers.begin() as session:
            if self._fence is not None:
                self._fence(session)
            yield session


def connect(url: str) -> tuple[Engine, Sessions]:
    """Opens the database, creates or migrates its tables, and returns the engine and a session factory."""
    engine = open_database(url)
    try:
        upgrade(engine)
    except BaseException:
        engine.dispose()
        raise
    return engine, Sessions(engine)


def open_database(url: str) -> Engine:
    """Returns an engine for `url`. Does not create or migrate tables."""
    is_sqlite = url.startswith("sqlite")
    engine = create_engine(
        url,
        pool_pre_ping=not is_sqlite,
        connect_args={"timeout": LOCK_TIMEOUT_S} if is_sqlite else {},
        json_deserializer=_json_or_nothing,
        pool_size=POOL,
        max_overflow=OVERFLOW,
        pool_timeout=LOCK_TIMEOUT_S,
    )
    if is_sqlite:
        _make_private(make_url(url).database)
        event.listen(engine, "connect", _tune_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def close_database(engine: Engine) -> None:
    """Closes all connections, and rejects new ones.

    Connections in use are closed when they are returned to the pool, since a request or thread may outlive the service.
    """

    def close(_: Any, record: Any) -> None:
        record.invalidate()

    def raise_unavailable(*_: Any) -> None:
        raise Unavailable(
            Sentence("service-stopping", "The service is shutting down."),
            advice=Sentence("advice-retry-when-back", "Try again when it is back."),
        )

    event.listen(engine.pool, "checkin", close)
    event.listen(engine, "do_connect", raise_unavailable)
    engine.dispose()


def _json_or_nothing(text: str | bytes) -> Any:
    """Returns the JSON value of a column, or None if it is damaged, so that the other rows stay readable."""
    try:
        return from_json(text)  # three times as fast as json.loads, and most of the time of reading many jobs
    except ValueError:
        pass
    try:
        return json.loads(text)  # only this parser accepts lone surrogates, which file names can contain
    except ValueError:
        return None


@contextmanager
def translated_faults() -> Iterator[None]:
    """Context manager that converts database errors to OutOfSpace, Unavailable or Invalid, as `Sessions` does.

    For code that uses a connection directly.
    """
    try:
        yield
    except PoolTimeoutError as error:
        raise Unavailable(
            Sentence("database-overloaded", "The database is overloaded."),
            advice=Sentence("advice-retry-soon", "Try again in a moment."),
        ) from error
    except DBAPIError as error:
        if getattr(error.orig, "sqlite_errorcode", 0) in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE):
            raise disk_full_error() from error
        if isinstance(error, DataError):  # from PostgreSQL, which does not accept NUL characters
            raise Invalid(
                Sentence(
                    "database-value-invalid",
                    "The request contains a character or number that the database cannot store. Leave it out.",
                )
            ) from error
        if isinstance(error, OperationalError):
            raise Unavailable(
                Sentence(
                    "database-not-reachable",
                    "The database does not answer ({error}).",
                    error=library_message(error.orig or error),
                ),
                advice=Sentence("advice-retry", "Try again."),
            ) from error
        raise


def _make_private(database: str | None) -> None:
    """Makes the SQLite database and its -wal and -shm files accessible only to their owner.

    SQLite creates further such files with the same mode.
    """
    if database and database != ":memory:":
        path = Path(database)
        os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, PRIVATE))
        for suffix in ("", "-wal", "-shm"):
            with contextlib.suppress(OSError):  # it does not exist, or another user owns it
                path.with_name(path.name + suffix).chmod(PRIVATE)


def _tune_sqlite(connection: Any, _: Any) -> None:
    # In WAL mode NORMAL loses nothing when a process dies. FULL also keeps committed transactions through a power cut, and scenes
    # and jobs are written rarely.
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON"):
        connection.execute(f"PRAGMA {pragma}")
    connection.isolation_level = None  # the driver begins no transactions itself: `_begin_sqlite` does


def _begin_sqlite(connection: Connection) -> None:
    # A transaction that reads and then writes must hold the lock from its beginning. Otherwise another writer may change what was
    # read (or SQLite fails with "database is locked").
    options = connection.get_execution_options()
    writes, patience_ms = options.get("writes"), options.get(LOCK_TIMEOUT_OPTION, round(LOCK_TIMEOUT_S * 1000))
    if connection.info.get(LOCK_TIMEOUT_OPTION) != patience_ms:  # a pooled connection may still have the timeout of its last use
        connection.exec_driver_sql(f"PRAGMA busy_timeout={patience_ms}")
        connection.info[LOCK_TIMEOUT_OPTION] = patience_ms
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
