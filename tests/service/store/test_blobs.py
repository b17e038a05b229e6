"""Tests of the blob stores: a folder and an S3 server behave the same."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from service.errors import NotFound, StartupError, Unavailable
from service.farm import open_blobs
from service.settings import Settings
from service.store.blobs import CHUNK, BlobFolder, BlobStore
from service.store.s3 import S3Blobs
from service.store.staging import BlobWriter, Staging, commit_all
from tests.helpers import running_redis
from tests.object_store import s3, s3_server
from tests.service.conftest import OBJ, TOKEN, Service, until

__all__ = ["s3", "s3_server"]  # fixtures


@pytest.fixture(params=["folder", "s3"])
def blobs(request: pytest.FixtureRequest, tmp_path: Path) -> BlobStore:
    if request.param == "folder":
        return BlobFolder(tmp_path / "blobs", tmp_path / "tmp")
    return S3Blobs(request.getfixturevalue("s3"), tmp_path / "tmp")


def put(blobs: BlobStore, *pieces: bytes) -> str:
    writer = blobs.writer()
    for piece in pieces:
        writer.write(piece)
    return writer.commit()


@pytest.mark.long
def test_credentials_are_read_from_files(s3: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        (tmp_path / name).write_text("from a file\n")
        monkeypatch.delenv(name)
        monkeypatch.setenv(f"{name}_FILE", str(tmp_path / name))
    assert put(S3Blobs(s3, tmp_path / "tmp"), b"abc") == hashlib.sha256(b"abc").hexdigest()
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY_FILE", str(tmp_path / "none"))
    with pytest.raises(StartupError, match="AWS_SECRET_ACCESS_KEY_FILE"):
        open_blobs(Settings(data=tmp_path, blobs=s3))


def test_stored_blob_is_opened_and_served(blobs: BlobStore, tmp_path: Path) -> None:
    pieces = (b"a" * (2 * CHUNK), b"the rest", os.urandom(6 * CHUNK))  # more than one part of a multipart upload
    whole = b"".join(pieces)
    sha256 = put(blobs, *pieces)
    assert sha256 == hashlib.sha256(whole).hexdigest()
    assert list((tmp_path / "tmp").iterdir()) == []
    assert blobs.exists(sha256)
    with blobs.open(sha256) as file:
        assert file.read() == whole
    served = blobs.serve(sha256)
    assert served.size == len(whole)
    assert b"".join(served.chunks) == whole
    assert put(blobs, whole) == sha256, "again, it is the same"


def test_deleted_and_missing_blobs_are_not_found(blobs: BlobStore) -> None:
    sha256 = put(blobs, b"here")
    others = [put(blobs, b"other %d" % i) for i in range(12)]
    blobs.delete([sha256])
    blobs.delete([sha256, *others])
    blobs.delete([])
    assert not any(blobs.exists(each) for each in (sha256, *others))
    for read in (blobs.open, blobs.serve):
        with pytest.raises(NotFound):
            read(sha256)


def test_discarded_blob_leaves_no_file(blobs: BlobStore, tmp_path: Path) -> None:
    writer = blobs.writer()
    writer.write(b"half")
    writer.discard()
    assert not blobs.exists(writer.sha256)
    assert list((tmp_path / "tmp").iterdir()) == []


def test_invalid_hash_is_rejected(blobs: BlobStore) -> None:
    for use in (blobs.open, blobs.serve, blobs.exists, lambda name: blobs.delete([name])):
        for name in ("../../etc/passwd", "A" * 64, "0" * 63, ""):
            with pytest.raises(ValueError, match="not a SHA-256"):
                use(name)


def test_sweep_deletes_old_unreferenced_blobs(blobs: BlobStore, tmp_path: Path) -> None:
    kept, gone = put(blobs, b"kept"), put(blobs, b"gone")
    (tmp_path / "tmp" / "blob-half").write_bytes(b"half")
    assert blobs.sweep({kept}) == {gone}, "it is young"
    assert not (tmp_path / "tmp" / "blob-half").exists()
    assert blobs.sweep({kept}, older_than_s=-60) == set()
    assert (blobs.exists(kept), blobs.exists(gone)) == (True, False)


def test_truncated_blob_is_replaced(tmp_path: Path) -> None:
    blobs = BlobFolder(tmp_path / "blobs", tmp_path / "tmp")
    sha256 = put(blobs, b"content")
    (tmp_path / "blobs" / sha256[:2] / sha256).write_bytes(b"")
    put(blobs, b"content")
    with blobs.open(sha256) as file:
        assert file.read() == b"content"


def test_unreachable_store_and_missing_bucket_raise_unavailable(s3: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Unavailable, match="There is no bucket elsewhere"):
        put(S3Blobs("s3://elsewhere", tmp_path / "tmp"), b"x")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setattr("service.store.s3.RETRIES", 0)
    away = S3Blobs(s3, tmp_path / "tmp")
    uses: list[Callable[[], object]] = [lambda: put(away, b"x"), lambda: away.exists("0" * 64), lambda: away.sweep(set())]
    for use in uses:
        with pytest.raises(Unavailable, match="object store failed"):
            use()


def test_bucket_is_selected_by_url(tmp_path: Path) -> None:
    assert Settings(data=tmp_path, blobs="s3://bucket/a/prefix").blobs == "s3://bucket/a/prefix"
    for nonsense in ("bucket", "s3://", "http://bucket", "s3:///prefix"):
        with pytest.raises(ValueError, match="s3://bucket/prefix"):
            Settings(data=tmp_path, blobs=nonsense)


@pytest.mark.long
def test_farm_with_blobs_in_s3(s3: str, tmp_path: Path, redis_server: running_redis) -> None:
    service = Service(tmp_path / "data", redis_server, blobs=s3)
    try:
        with service.worker():
            scene = service.ready_scene()
            job = service.submit(scene)
            service.wait_for(job, "finished")
            assert service.http.get(f"/api/jobs/{job}/frames/0/image.png").status_code == 200
            thumbnail = service.http.get(f"/api/scenes/{scene}/thumbnail.png")
            assert thumbnail.status_code in (200, 404)  # may have been made by the worker already
        sha256 = service.scene(scene)["files"][0]["sha256"]
        headers = {"Authorization": f"Bearer {TOKEN}"}
        assert service.http.get(f"/api/farm/blobs/{sha256}", headers=headers).content == OBJ
        assert service.http.get("/api/farm/join", headers=headers).json()["data_dir"] == "", "its files are not to be mapped"
        assert [path for path in (tmp_path / "data").rglob("*") if path.name == sha256] == []
        assert service.http.delete(f"/api/scenes/{scene}").status_code == 204
        until(lambda: not service.farm.blobs.exists(sha256), "its object is gone")
    finally:
        service.stop()


def test_stored_files_are_private(tmp_path: Path, redis_server: running_redis) -> None:
    (tmp_path / "data").mkdir(mode=0o755)
    service = Service(tmp_path / "data", redis_server)
    try:
        with service.worker():
            service.wait_for(service.submit(service.ready_scene()), "finished")
        open_to_all = {
            str(path.relative_to(tmp_path)): oct(path.stat().st_mode)
            for path in (tmp_path / "data").rglob("*")
            if path.is_file() and path.stat().st_mode & 0o077
        }
        assert open_to_all == {}
        assert (tmp_path / "data").stat().st_mode & 0o777 == 0o700
    finally:
        service.stop()


def test_blobs_are_committed_in_parallel(tmp_path: Path) -> None:
    """Many files are committed in parallel, since each commit waits for the disk; in sequence, 4,000 files took 48 s."""
    staging, together = Staging(tmp_path), threading.Barrier(4)

    def put(writer: BlobWriter) -> None:
        together.wait(20)

    writers = [staging.writer(put) for _ in range(8)]
    for number, writer in enumerate(writers):
        writer.write(b"%d" % number)
    assert commit_all(writers) == [hashlib.sha256(b"%d" % number).hexdigest() for number in range(8)]
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no file that is always full")
def test_discard_on_full_disk_leaves_no_file(tmp_path: Path) -> None:
    """A file that fails to close on a full disk, where its last bytes are written, leaves nothing behind."""
    writer = BlobFolder(tmp_path / "blobs", tmp_path).writer()
    writer._file.close()
    writer._file = Path("/dev/full").open("wb")  # noqa: SIM115 - the writer closes it
    writer.write(b"small")
    writer.discard()
    assert not list(tmp_path.glob("blob-*"))
