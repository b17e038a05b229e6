"""Tests that the engine's database writes never undo a concurrent change by a user."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from sqlalchemy import event

from service.errors import OutOfSpace, Unavailable
from service.scheduling.records import Records
from service.store.database import connect
from service.store.models import Frame, FrameChange, Job, Scene, Wait
from tests.service.conftest import new_sqlite


@pytest.fixture
def records(tmp_path: Path) -> Iterator[Records]:
    engine, sessions = connect(new_sqlite(tmp_path))
    with sessions.begin() as session:
        job = Job(id="job", scene="scene", name="", state="running", priority=0, created=0.0, active_s=0.0, request={}, spp=8)
        session.add(job)
    with sessions.begin() as session:
        session.add(Frame(job="job", number=0))
    yield Records(sessions, 1 << 20)
    engine.dispose()


def active(spp: int) -> Any:
    return SimpleNamespace(id="job", spp=spp, noise=None, seconds=None, shot=None, active_s=1.5)


def test_job_with_added_samples_is_not_finished(records: Records) -> None:
    assert not records.mark_finished(active(spp=4))
    assert records.mark_finished(active(spp=8))
    row = records.job("job")
    assert row is not None
    assert (row.state, row.active_s) == ("finished", 1.5)
    assert not records.mark_finished(active(spp=8)), "it was finished before"


def test_ended_job_is_not_started_or_failed(records: Records) -> None:
    with records._sessions.begin() as session:
        job = session.get(Job, "job")
        assert job is not None
        job.state = "cancelled"
    assert not records.mark_started("job", "kind")
    assert not records.mark_failed("job", "an error")
    assert not records.mark_finished(active(spp=8))


def test_pending_jobs_are_read_by_three_queries(tmp_path: Path) -> None:
    engine, sessions = connect(new_sqlite(tmp_path))
    plain = {"name": "", "priority": 0, "created": 0.0, "active_s": 0.0, "request": {}, "spp": 8, "state": "queued"}
    ids = [f"job{i}" for i in range(40)]
    with sessions.begin() as session:
        named = {"name": "a", "status": "ready", "created": 0.0, "main": "a.obj", "files": [], "bytes": 1}
        session.add(Scene(id="scene", **named))
        session.add(Scene(id="night", of="scene", **named))
        session.add_all(Job(id=id, scene="scene", **plain) for id in ids)
        session.add(Job(id="lit", scene="scene", lit="night", **plain))
        session.add(Job(id="shot", scene="gone", shot={"fps": 24.0}, history={"points": []}, **plain))
    with sessions.begin() as session:
        session.add_all(Frame(job=id, number=0, samples=7) for id in [*ids, "shot"])
        session.add_all([Wait(job="job3", other="shot"), FrameChange(job="job4", steps=[], done=0, samples=0)])
    statements: list[str] = []
    event.listen(engine, "before_cursor_execute", lambda *given: statements.append(given[2]))
    found = Records(sessions, 1 << 20).pending([*ids, "lit", "shot", "nothing"])
    assert sum(statement.startswith("SELECT") for statement in statements) == 3, statements
    assert set(found) == {*ids, "lit", "shot"}
    assert [id for id in ids if found[id].waits] == ["job3"]
    assert [id for id in ids if found[id].frames_change] == ["job4"]
    scenes = {id: each.scene.id if each.scene is not None else None for id, each in found.items()}
    assert scenes == {**dict.fromkeys(ids, "scene"), "lit": "night", "shot": None}
    assert [frame.samples for frame in found["job0"].frames or ()] == [7]
    assert found["lit"].frames == [], "deleted a moment ago"
    assert (found["shot"].frames, found["shot"].history) == (None, {"points": []})
    engine.dispose()


def test_concurrent_writers_lose_no_update(records: Records) -> None:
    """Checks that no update is lost when four threads read, change and write the same row, and that no thread fails."""

    def add() -> None:
        for _ in range(25):
            with records._sessions.begin() as session:
                job = session.get(Job, "job")
                assert job is not None
                job.priority += 1

    threads = [threading.Thread(target=add) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    row = records.job("job")
    assert row is not None
    assert row.priority == 100


@pytest.mark.long
def test_locked_database_raises_unavailable(records: Records, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.store.database.LOCK_TIMEOUT_S", 0.1)
    engine, sessions = connect(new_sqlite(tmp_path))
    other = sqlite3.connect(tmp_path / "rayfarm.sqlite", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(Unavailable, match="database is locked"), sessions.begin() as session:
        session.get(Job, "job")
    with sessions() as session:
        assert session.get(Job, "job") is not None, "reading goes on"
    other.execute("ROLLBACK")
    other.close()
    with sessions.begin() as session:
        assert session.get(Job, "job") is not None
    engine.dispose()


def test_full_disk_raises_out_of_space(records: Records) -> None:
    with records._sessions() as session:
        session.connection().exec_driver_sql("PRAGMA max_page_count=1")
    with pytest.raises(OutOfSpace, match="disk is full"), records._sessions.begin() as session:
        for i in range(2000):
            session.add(Job(id=f"job{i}", scene="scene", name="x" * 200, state="queued", created=0.0, request={}))
    with records._sessions() as session:
        session.connection().exec_driver_sql("PRAGMA max_page_count=1000000")
    assert records.all_jobs() == {"job"}
