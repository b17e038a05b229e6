"""Tests of a full disk: uploads are refused with an error message, deletions work, and with space everything continues."""

from __future__ import annotations

import errno
import hashlib
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from sqlalchemy.orm import Session

from service.errors import OutOfSpace
from service.store.database import Sessions
from service.store.disk_space import disk_full_error
from service.store.reserve import SIZE, Reserve
from tests.helpers import running_redis
from tests.service.api.test_kernels import NAME, SHOWN, artefact
from tests.service.conftest import OBJ, Service, until

DISK = 48 << 20


@pytest.fixture(params=["a small disk", "a database without room"])
def small_disk(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path | None]:
    """Yields the folder of a small mounted disk, or None if `full_disk` makes the database report a full disk instead."""
    if request.param == "a database without room":
        yield None
        return
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", str(folder)]
    try:
        mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("this user may not mount a small disk; the other case tests the same without one")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def fill_disk(path: Path) -> None:
    """Writes a file at `path` until the disk is completely full."""
    with path.open("wb", buffering=0) as file:
        for size in (1 << 20, 4096, 1):
            try:
                while True:
                    file.write(b"\1" * size)
            except OSError as error:
                assert error.errno == errno.ENOSPC


@contextmanager
def full_disk(service: Service, disk: Path | None, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fills the disk or, without one, makes the database report a full disk until the reserve is deleted."""
    if disk is not None:
        fill_disk(disk / "filler")
        yield
        for filler in disk.glob("filler*"):
            filler.unlink()
        return
    begin, reserve = Sessions.begin, service.options["data"] / "reserve"

    @contextmanager
    def begin_where_there_is_room(self: Sessions) -> Iterator[Session]:
        if reserve.exists():
            raise disk_full_error()
        with begin(self) as session:
            yield session

    with monkeypatch.context() as patch:
        patch.setattr(Sessions, "begin", begin_where_there_is_room)
        patch.setattr(Reserve, "refill", lambda self: None)
        yield


def test_deletion_works_on_full_disk(
    small_disk: Path | None, tmp_path: Path, redis_server: running_redis, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = (small_disk or tmp_path) / "data"
    service = Service(data, redis_server, min_free_bytes=0)
    try:
        with service.worker():
            scenes = [service.upload(OBJ + b"# %d" % i * 40) for i in range(7)]
            for scene in scenes:
                until(lambda scene=scene: service.scene(scene)["status"] == "ready", "the scene is prepared")
            jobs = [service.submit(scene) for scene in scenes[:1]]
            for job in jobs:
                service.wait_for(job, "finished")
        with full_disk(service, small_disk, monkeypatch):
            refused = service.http.post("/api/scenes", files={"files": ("large.obj", OBJ * 100_000)})
            assert refused.status_code == 507, refused.text
            assert "Delete scenes or jobs" in refused.json()["detail"]
            if small_disk is not None:
                refused = service.http.post("/api/jobs", json={"scene": scenes[0], "width": 64, "height": 48, "spp": 8})
                assert refused.status_code == 507, refused.text
                service.restart()
                fill_disk(small_disk / "filler too")  # ended work has freed some space
                service.restart()
            for path in [*(f"/api/scenes/{id}" for id in scenes[:5]), *(f"/api/jobs/{id}" for id in jobs)]:
                answer = service.http.delete(path)
                assert answer.status_code == 204, f"{path}: {answer.text}"
                assert service.http.get(path).status_code == 404
        assert service.scene(service.upload(OBJ + b"# again"))["name"] == "scene", "with room it goes on by itself"
    finally:
        service.stop()


def test_reserve_is_released_and_refilled(tmp_path: Path) -> None:
    reserve = Reserve(tmp_path / "reserve")
    reserve.refill()
    assert (tmp_path / "reserve").stat().st_size == SIZE
    tries = []

    def delete() -> str:
        tries.append((tmp_path / "reserve").exists())
        if tries[-1]:
            raise disk_full_error()
        return "deleted"

    assert reserve.run_deletion(delete) == "deleted"
    assert tries == [True, False]
    assert (tmp_path / "reserve").stat().st_size == SIZE
    assert (tmp_path / "reserve").stat().st_mode & 0o777 == 0o600
    with pytest.raises(OutOfSpace):
        reserve.run_deletion(always_full)


def always_full() -> None:
    raise disk_full_error()


def test_partial_reserve_is_refilled(tmp_path: Path) -> None:
    (tmp_path / "reserve").write_bytes(os.urandom(100))
    Reserve(tmp_path / "reserve").refill()
    assert (tmp_path / "reserve").stat().st_size == SIZE


def no_byte_free(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("writer", ["service.store.staging.BlobWriter.write", "service.store.kernels.write_atomically"])
def test_worker_upload_on_full_disk_gets_error(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, writer: str
) -> None:
    monkeypatch.setattr(writer, no_byte_free)
    is_blob = writer.endswith("BlobWriter.write")
    content = b"hello" if is_blob else artefact(tmp_path)
    path = f"blobs/{hashlib.sha256(content).hexdigest()}" if is_blob else f"kernels/{NAME}"
    answer = service.http.put(f"/api/farm/{path}", content=content, headers=SHOWN)
    assert answer.status_code == 507, answer.text
    assert "disk is full" in answer.json()["detail"]
