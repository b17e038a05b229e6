"""The connection to the database: SQLite in WAL mode by default, PostgreSQL by its URL."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.orm import Session, sessionmaker

from service.store.models import Base

__all__ = ["Sessions", "connect"]


class Sessions:
    """Makes sessions: `sessions()` to read, `sessions.begin()` for one transaction that writes.

    patience_s: how long a lock of SQLite's is waited for.
    """

    def __init__(self, engine: Engine, patience_s: float = 30.0) -> None:
        self._engine = engine
        options = {"patience_ms": round(patience_s * 1000)}
        self._readers = sessionmaker(engine.execution_options(**options), expire_on_commit=False)
        self._writers = sessionmaker(engine.execution_options(writes=True, **options), expire_on_commit=False)

    def with_patience(self, seconds: float) -> Sessions:
        """The same database, for whoever must not wait so long."""
        return Sessions(self._engine, seconds)

    def __call__(self) -> Session:
        """A session for reading."""
        return self._readers()

    def begin(self) -> AbstractContextManager[Session]:
        """A transaction: committed at its end, or rolled back where an exception leaves it."""
        return self._writers.begin()


def connect(url: str) -> tuple[Engine, Sessions]:
    """The engine with its tables made, and the maker of sessions."""
    is_sqlite = url.startswith("sqlite")
    engine = create_engine(url, pool_pre_ping=not is_sqlite, connect_args={"timeout": 30} if is_sqlite else {})
    if is_sqlite:
        event.listen(engine, "connect", _tune_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    Base.metadata.create_all(engine)
    return engine, Sessions(engine)


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
    writes, patience_ms = options.get("writes"), options.get("patience_ms", 30_000)
    connection.exec_driver_sql(f"PRAGMA busy_timeout={patience_ms}")  # of this use of the connection, which is pooled
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
