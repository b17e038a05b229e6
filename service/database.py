"""The connection to the database: SQLite in WAL mode by default, PostgreSQL by its URL."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Engine, create_engine, event
from sqlalchemy.orm import Session, sessionmaker

from service.models import Base

__all__ = ["Sessions", "connect"]

Sessions = sessionmaker[Session]


def connect(url: str) -> tuple[Engine, Sessions]:
    """The engine with its tables made, and the maker of sessions."""
    is_sqlite = url.startswith("sqlite")
    engine = create_engine(url, pool_pre_ping=not is_sqlite, connect_args={"timeout": 30} if is_sqlite else {})
    if is_sqlite:
        event.listen(engine, "connect", _tune_sqlite)
    Base.metadata.create_all(engine)
    return engine, sessionmaker(engine, expire_on_commit=False)


def _tune_sqlite(connection: Any, _: Any) -> None:
    # In WAL mode NORMAL loses nothing when a process dies. When the machine itself loses power, FULL also keeps what was
    # acknowledged, and scenes and jobs are few.
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON"):
        connection.execute(f"PRAGMA {pragma}")
