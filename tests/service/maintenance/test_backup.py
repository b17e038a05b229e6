"""Tests that a backup of a running farm can be started as a farm, whose jobs continue and end with bit-identical films."""

from __future__ import annotations

import sqlite3
import tarfile
import threading
from contextlib import closing
from pathlib import Path

import pytest

from protocol.contract import RenderBatch
from service.errors import Conflict, Invalid, NotFound
from service.maintenance.backup import MANIFEST, Report, back_up
from service.maintenance.restore import restore
from service.maintenance.target import target_at
from service.store.models import Key
from tests.helpers import running_redis
from tests.service.conftest import OBJ, Databases, Service, until
from tests.service.peer_worker import expected_digest


def back_up_to(service: Service, target: Path) -> Report:
    return back_up(service.options["data"], target_at(target, MANIFEST))


def files_of(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def log_and_snapshots(data: Path, job: str) -> dict[str, bytes]:
    """Returns a job's log and snapshots, as stored on disk."""
    return {
        path.relative_to(data).as_posix(): path.read_bytes()
        for folder in ("logs-of-jobs", "snapshots")
        for path in (data / folder).rglob("[!.]*")
        if path.is_file() and job in path.relative_to(data).as_posix()
    }


@pytest.fixture(autouse=True)
def sqlite_alone(databases: Databases) -> None:
    if databases.given:
        pytest.skip("a PostgreSQL is backed up by its own tools, and RAYFARM_TEST_DATABASE_URL names one")


@pytest.mark.parametrize("name", [pytest.param("copy", marks=pytest.mark.long), "copy.tar.gz"])
def test_unfinished_job_continues_from_backup(service: Service, redis_server: running_redis, tmp_path: Path, name: str) -> None:
    some = threading.Event()

    def slow(batch: RenderBatch) -> bool | None:
        some.wait(0.05)
        return None

    with service.worker() as worker:
        done = service.submit(service.ready_scene())
        service.wait_for(done, "finished")
        until(lambda: log_and_snapshots(service.options["data"], done) != {}, "its log is written")
        before = log_and_snapshots(service.options["data"], done)
        worker.on_batch = slow
        half = service.submit(service.ready_scene(), spp=40, seed=3)
        until(lambda: service.job(half)["progress"] > 0.1, "it is under way")
        report = back_up_to(service, tmp_path / name)  # taken while batches arrive
        assert service.job(half)["state"] == "running", "it was taken half way"
        some.set()
        service.wait_for(half, "finished")
    assert (report.films, report.lacking) == (2, [])
    service.stop()

    seen: list[tuple[int, int]] = []
    restore(tmp_path / name, tmp_path / "again", lambda at, total, what: seen.append((at, total)))
    assert seen[-1][0] == seen[-1][1] or name.endswith(".gz")
    again = Service(tmp_path / "again", redis_server)
    try:
        assert 0 < again.job(half)["samples"] < 40 * 64 * 48
        with again.worker() as worker:
            again.wait_for(half, "finished")
            assert {batch.job for batch in worker.batches} == {half}, "what was finished stays so"
        assert again.digest(half) == expected_digest(spp=40, seed=3)
        assert again.digest(done) == expected_digest()
        after = log_and_snapshots(tmp_path / "again", done)
        assert all(after[name].startswith(content) for name, content in before.items()), "logs and snapshots came along"
        assert {path.stat().st_mode & 0o077 for path in (tmp_path / "again").rglob("*")} == {0}
    finally:
        again.stop()
        service.start()  # the fixture stops it


@pytest.mark.long
def test_later_backup_copies_only_new_files(service: Service, tmp_path: Path) -> None:
    target = tmp_path / "copy"
    (service.options["data"] / "webhook-secret").write_text("whsec_")
    with service.worker():
        first = service.submit(service.ready_scene())
        service.wait_for(first, "finished")
        back_up_to(service, target)
        before = files_of(target)
        gone = service.submit(service.upload(OBJ + b"# other"))
        service.wait_for(gone, "finished")
    second = back_up_to(service, target)
    assert second.unchanged >= sum(name.startswith("blobs/") for name in before)
    assert f"films/{gone}.sqlite" in files_of(target)
    assert service.http.delete(f"/api/jobs/{gone}").status_code == 204
    until(lambda: not (service.options["data"] / "films" / f"{gone}.sqlite").exists(), "its film is removed")
    back_up_to(service, target)
    assert f"films/{gone}.sqlite" not in files_of(target)
    restore(target, tmp_path / "again")
    assert (tmp_path / "again" / "films" / f"{first}.sqlite").exists()
    assert (tmp_path / "again" / "webhook-secret").read_text() == "whsec_"


def test_restore_ends_sessions_and_keeps_tokens(service: Service, tmp_path: Path) -> None:
    with service.farm.sessions.begin() as session:
        for kind in ("session", "link", "token"):
            session.add(Key(id=kind, hash=kind, kind=kind, user="ada", name="", role="view", created=0.0))
    back_up_to(service, tmp_path / "copy")
    restore(tmp_path / "copy", tmp_path / "again")
    with closing(sqlite3.connect(tmp_path / "again" / "rayfarm.sqlite")) as database:
        assert database.execute("SELECT kind FROM keys").fetchall() == [("token",)]


@pytest.mark.long
def test_missing_data_is_reported_and_rest_is_backed_up(service: Service, tmp_path: Path) -> None:
    with service.worker():
        jobs = [service.submit(service.ready_scene(), seed=seed) for seed in range(2)]
        for job in jobs:
            service.wait_for(job, "finished")
    service.options["film_check_days"] = 0
    service.restart()
    (service.options["data"] / "films" / f"{jobs[0]}.sqlite").unlink()
    report = back_up_to(service, tmp_path / "copy.tar")
    assert report.films == 1
    assert [jobs[0] in sentence for sentence in report.lacking] == [True]
    restore(tmp_path / "copy.tar", tmp_path / "again")
    assert (tmp_path / "again" / "films" / f"{jobs[1]}.sqlite").exists()


def test_invalid_backups_and_targets_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match="contains no farm"):
        back_up(tmp_path, target_at(tmp_path / "copy", MANIFEST))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "holiday.jpg").touch()
    for path, why in (("mine", "other files"), ("copy.zip", "neither"), ("mine/holiday.jpg", "neither")):
        with pytest.raises(Invalid, match=why):
            target_at(tmp_path / path, MANIFEST)
    with pytest.raises(Conflict, match="not empty"):
        restore(tmp_path / "copy", tmp_path / "mine")
    with pytest.raises(NotFound):
        restore(tmp_path / "nothing.tar", tmp_path / "again")
    assert not (tmp_path / "again").exists()


def database_backup(folder: Path) -> Path:
    """Creates a data folder with only a database, and backs it up; returns the backup's folder."""
    (folder / "data").mkdir()
    with closing(sqlite3.connect(folder / "data" / "rayfarm.sqlite")) as database, database:
        database.execute("PRAGMA user_version")
    database.close()
    back_up(folder / "data", target_at(folder / "copy", MANIFEST))
    return folder / "copy"


def test_damaged_or_truncated_backup_is_not_restored(tmp_path: Path) -> None:
    copy = database_backup(tmp_path)
    restore(copy, tmp_path / "good")
    database = (copy / "rayfarm.sqlite").read_bytes()
    (copy / "rayfarm.sqlite").write_bytes(database[:-1] + b"\1")
    with pytest.raises(Invalid, match=r"rayfarm.sqlite differs from what was backed up. Use another backup"):
        restore(copy, tmp_path / "again")
    (copy / "rayfarm.sqlite").unlink()
    with pytest.raises(Invalid, match=r"rayfarm\.sqlite is missing"):
        restore(copy, tmp_path / "again")
    (copy / MANIFEST).unlink()
    with pytest.raises(Invalid, match="is incomplete: it has no"):
        restore(copy, tmp_path / "again")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["copy", "data", "good"]


@pytest.mark.parametrize("name", ["../evil", "/tmp/evil", "films/../../evil.sqlite", "bin/sh", "films/a.sqlite/b"])
def test_tar_file_cannot_write_outside_folder(tmp_path: Path, name: str) -> None:
    with tarfile.open(tmp_path / "bad.tar", "w") as tar:
        tar.addfile(tarfile.TarInfo(name))
    with pytest.raises(Invalid, match="does not belong in a backup"):
        restore(tmp_path / "bad.tar", tmp_path / "again")
    with tarfile.open(tmp_path / "link.tar", "w") as tar:
        link = tarfile.TarInfo("token")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        tar.addfile(link)
    with pytest.raises(Invalid, match="not a file"):
        restore(tmp_path / "link.tar", tmp_path / "again")


def test_interrupted_backup_is_marked_incomplete(tmp_path: Path) -> None:
    database_backup(tmp_path)
    back_up(tmp_path / "data", target_at(tmp_path / "copy.tar.gz", MANIFEST))
    whole = (tmp_path / "copy.tar.gz").read_bytes()
    (tmp_path / "cut.tar.gz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(Invalid, match="is damaged or cut off"):
        restore(tmp_path / "cut.tar.gz", tmp_path / "again")
