"""What a column of JSON says, read fast."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from service.settings import Settings
from service.store.database import connect
from service.store.models import Job


@pytest.mark.parametrize(
    ("written", "read"),
    [
        (
            '{"a": [1, -0.0, 1e-320, 12345678901234567890123], "b": "\\u00e9"}',
            {"a": [1, -0.0, 1e-320, 12345678901234567890123], "b": "é"},
        ),
        (json.dumps("half of a pair \ud800"), "half of a pair \ud800"),  # of a file's name that is no UTF-8
        ("[Infinity, 1.7976931348623157e308]", [float("inf"), 1.7976931348623157e308]),
        ('{"cut": "of', None),
    ],
)
def test_json_is_read_as_it_was_written_and_what_is_damaged_is_nothing(written: str, read: Any, tmp_path: Path) -> None:
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


def test_a_database_lies_in_a_folder_of_any_name(tmp_path: Path) -> None:
    folder = tmp_path / "100%20 what? #1"
    folder.mkdir()
    connect(Settings(data=folder).database)[0].dispose()
    assert (folder / "rayfarm.sqlite").stat().st_size > 0
