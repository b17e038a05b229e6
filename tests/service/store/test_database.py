"""Tests of JSON columns with damaged values, of closed databases, and of data folders with special characters in their names."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import event, func, select, text

from service.errors import Unavailable
from service.settings import Settings
from service.store.database import close_database, connect
from service.store.models import Job
from tests.service.conftest import Databases


@pytest.mark.parametrize(
    ("written", "read"),
    [
        (
            '{"a": [1, -0.0, 1e-320, 12345678901234567890123], "b": "\\u00e9"}',
            {"a": [1, -0.0, 1e-320, 12345678901234567890123], "b": "é"},
        ),
        (json.dumps("half of a pair \ud800"), "half of a pair \ud800"),  # from a file name that is not UTF-8
        ("[Infinity, 1.7976931348623157e308]", [float("inf"), 1.7976931348623157e308]),
        ('{"cut": "of', None),
    ],
)
def test_damaged_json_column_is_read_as_none(written: str, read: Any, tmp_path: Path) -> None:
    engine, sessions = connect(f"sqlite:///{tmp_path / 'test.db'}")
    with sessions.begin() as session:
        session.execute(
            text(
                "INSERT INTO jobs (id, scene, name, state, priority, created, active_s, request)"
                " VALUES ('j', 's', 'n', 'queued', 0, 0, 0, :r)"
            ),
            {"r": written},
        )
    with sessions() as session:
        job = session.get(Job, "j")
        assert job is not None and job.request == read
    engine.dispose()


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_closed_database_rejects_later_threads(kind: str, databases: Databases, tmp_path: Path) -> None:
    with databases.new(kind) as url:
        engine, sessions = connect(url or f"sqlite:///{tmp_path / 'test.db'}")
        opened: list[Any] = []
        event.listen(engine, "connect", lambda connection, _: opened.append(connection))
        with sessions() as late, sessions() as other:
            late.scalar(select(func.count()).select_from(Job))
            other.scalar(select(func.count()).select_from(Job))
            close_database(engine)
        with (
            pytest.raises(Unavailable, match="The service is shutting down"),
            sessions.begin() as session,
        ):
            session.scalar(select(func.count()).select_from(Job))
        assert opened and all(_is_closed(connection) for connection in opened)


def _is_closed(connection: Any) -> bool:
    if not isinstance(connection, sqlite3.Connection):
        return bool(connection.closed)
    try:
        connection.total_changes  # noqa: B018
    except sqlite3.ProgrammingError:
        return True
    return False


def test_database_folder_may_have_any_name(tmp_path: Path) -> None:
    folder = tmp_path / "100%20 what? #1"
    folder.mkdir()
    connect(Settings(data=folder).database)[0].dispose()
    assert (folder / "rayfarm.sqlite").stat().st_size > 0
