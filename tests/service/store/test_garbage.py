"""Tests that no acknowledged upload is lost if the same files are uploaded and deleted at the same time."""

from __future__ import annotations

import hashlib
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
from sqlalchemy.orm import Session

from service.errors import NotOwner, Unavailable
from service.events import ArtifactStored, BlobsReleased
from service.store.blobs import BlobFolder
from service.store.database import connect
from service.store.garbage import AT_A_TIME, Garbage
from service.store.models import Scene
from tests.service.conftest import OBJ, TOKEN, Service, new_sqlite, until

ROUNDS = 25


def stored(service: Service, scene: dict) -> bool:
    data: Path = service.options["data"]
    return all((data / "blobs" / ref["sha256"][:2] / ref["sha256"]).is_file() for ref in scene["files"])


def at_once(*actions: Callable[[], None]) -> None:
    start = threading.Barrier(len(actions))

    def run(action: Callable[[], None]) -> None:
        start.wait()
        action()

    threads = [threading.Thread(target=run, args=(action,)) for action in actions]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


@pytest.mark.long
@pytest.mark.parametrize("shared", [pytest.param(False, marks=pytest.mark.long), True])
def test_upload_during_deletion_of_same_files(service: Service, shared: bool) -> None:
    """An upload succeeds while a scene with the same files is deleted.

    shared: whether a further scene has one of these files.
    """
    codes: list[tuple[str, int]] = []
    for turn in range(ROUNDS):
        texture = ("files", ("wood.png", b"wood %d" % turn))
        mine = [("files", ("scene.obj", OBJ + b"# %d" % turn)), texture]
        other = [("files", ("other.obj", OBJ + b"# other %d" % turn)), texture] if shared else mine
        scene = service.http.post("/api/scenes", files=mine).raise_for_status().json()
        answers: list[httpx.Response] = []

        def upload(files: list = other, answers: list[httpx.Response] = answers) -> None:
            answers.append(service.http.post("/api/scenes", files=files))

        def delete(id: str = scene["id"], codes: list[tuple[str, int]] = codes) -> None:
            codes.append(("delete", service.http.delete(f"/api/scenes/{id}").status_code))

        at_once(upload, upload, delete, delete)
        codes += [("post", answer.status_code) for answer in answers]
        for answer in answers:
            found = service.http.get(f"/api/scenes/{answer.json()['id']}")
            assert found.status_code in ({200} if shared else {200, 404}), "it may be deleted after it was acknowledged"
            assert found.status_code == 404 or stored(service, found.json()), f"turn {turn}: acknowledged, and its files are gone"
    assert set(codes) <= {("post", 201), ("delete", 204), ("delete", 404)}, codes


def test_blob_upload_during_deletion_does_not_block(service: Service) -> None:
    content = b"compiled"
    url = f"/api/farm/blobs/{hashlib.sha256(content).hexdigest()}"
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with ThreadPoolExecutor(1) as pool:
        with service.farm.garbage._lock:
            putting = pool.submit(service.http.put, url, content=content, headers=headers)
            with pytest.raises(TimeoutError):
                putting.result(1.0)
            assert httpx.get(f"{service.url}/healthz", timeout=3).status_code == 200
        assert putting.result().status_code == 204


@pytest.fixture
def garbage(tmp_path: Path) -> Iterator[tuple[Garbage, BlobFolder]]:
    engine, sessions = connect(new_sqlite(tmp_path))
    blobs = BlobFolder(tmp_path / "blobs", tmp_path / "tmp")
    yield Garbage(sessions, blobs, max_unreferenced_s=60.0), blobs
    engine.dispose()


def put(blobs: BlobFolder, content: bytes) -> str:
    writer = blobs.writer()
    writer.write(content)
    return writer.commit()


def scene_of(*hashes: str) -> Callable[[Session], set[str]]:
    def write(session: Session) -> set[str]:
        files = [{"path": sha256[:8], "sha256": sha256, "size": 1} for sha256 in hashes]
        session.add(
            Scene(id=hashes[0][:20], name="", status="ready", created=0.0, main="", files=files, bytes=1, notes=[], compiled={})
        )
        return set()

    return write


def test_pinned_blob_is_deleted_if_no_scene_is_created(garbage: tuple[Garbage, BlobFolder]) -> None:
    collector, blobs = garbage
    with pytest.raises(RuntimeError, match="refused"), collector.pinned([put(blobs, b"content")] * 2) as _:
        sha256 = put(blobs, b"content")
        collector.collect(lambda session: {sha256})
        assert blobs.exists(sha256)
        raise RuntimeError("refused")
    assert not blobs.exists(sha256)


@pytest.mark.parametrize("is_in_use", (True, False))
def test_unreferenced_blob_of_a_restart_is_deleted_unless_an_artifact_is_in_it(
    garbage: tuple[Garbage, BlobFolder], is_in_use: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such as a path guide that was trained before the restart, and once more after it."""
    collector, blobs = garbage
    sha256 = put(blobs, b"guide")
    collector.adopt_unreferenced({sha256})
    if is_in_use:
        collector.handle_artifact(ArtifactStored(sha256))
    now = time.monotonic()
    monkeypatch.setattr("service.store.garbage.time.monotonic", lambda: now + 61)
    collector.collect(lambda session: set())
    assert blobs.exists(sha256) == is_in_use
    collector.handle_release(BlobsReleased(Counter([sha256])))
    assert not blobs.exists(sha256)


def test_pinned_blob_of_created_scene_is_kept(garbage: tuple[Garbage, BlobFolder]) -> None:
    collector, blobs = garbage
    sha256 = put(blobs, b"content")
    with collector.pinned([sha256]):
        collector.collect(lambda session: {sha256})
        collector.collect(scene_of(sha256))
    collector.collect(lambda session: {sha256})
    assert blobs.exists(sha256)


def test_worker_blob_is_kept_until_reported(garbage: tuple[Garbage, BlobFolder]) -> None:
    """A blob that a worker has stored is kept until the worker reports it, or until the report counts as lost.

    Another scene that was compiled to the same bytes may be deleted meanwhile.
    """
    collector, blobs = garbage
    sha256 = put(blobs, b"compiled")
    collector.pin_until_recorded(sha256)
    collector.collect(lambda session: {sha256})
    assert blobs.exists(sha256)
    collector._promised[sha256] = [0.0]  # as if the report never arrived
    collector.collect(lambda session: set())
    assert not blobs.exists(sha256)


def test_existence_query_by_worker_keeps_blob(service: Service) -> None:
    """A blob is kept after a worker has asked whether it exists.

    The worker does not send an existing blob again, and refers to it in a later report.
    """
    content = b"what stands still"
    url = f"/api/farm/blobs/{hashlib.sha256(content).hexdigest()}"
    headers = {"Authorization": f"Bearer {TOKEN}"}
    assert service.http.post(f"{url}/keep", headers=headers).status_code == 404
    assert service.http.put(url, content=content, headers=headers).status_code == 204
    service.farm.garbage._promised.clear()
    assert service.http.post(f"{url}/keep", headers=headers).status_code == 204
    service.farm.garbage.collect(lambda session: {url[-64:]})
    assert service.http.get(url, headers=headers).content == content
    assert service.http.post(f"{url}/keep").status_code == 401


def test_parts_of_compiled_scene_are_kept(garbage: tuple[Garbage, BlobFolder]) -> None:
    collector, blobs = garbage
    manifest, part, other = (put(blobs, content) for content in (b"manifest", b"part", b"other"))

    def write(session: Session) -> set[str]:
        ref = {"path": "", "sha256": manifest, "size": 8, "parts": [[part, 4], 7]}
        rest = {"files": [], "bytes": 1, "notes": [], "compiled": {"kind": ref}}
        session.add(Scene(id="scene", name="", status="ready", created=0.0, main="", **rest))
        return set()

    collector.collect(write)
    collector.collect(lambda session: {manifest, part, other})
    assert (blobs.exists(manifest), blobs.exists(part), blobs.exists(other)) == (True, True, False)


def test_failed_deletion_is_retried(garbage: tuple[Garbage, BlobFolder], monkeypatch: pytest.MonkeyPatch) -> None:
    """A deletion that is recorded in the database is carried out later if the blob store does not respond now."""
    collector, blobs = garbage
    one, two = put(blobs, b"one"), put(blobs, b"two")

    def away(self: BlobFolder, hashes: object, guard: object) -> None:
        raise Unavailable("The object store does not answer.")

    with monkeypatch.context() as patch:
        patch.setattr(BlobFolder, "delete", away)
        collector.collect(lambda session: {one, two})
    assert blobs.exists(one)
    collector.collect(lambda session: set())
    assert (blobs.exists(one), blobs.exists(two)) == (False, False)


def test_owner_lost_during_deletion_deletes_no_blob(tmp_path: Path) -> None:
    """A service that loses the farm in the middle of a deletion deletes no blob.

    In the test it is suspended after deleting the rows; then the same file is uploaded to the service that has taken over.
    """
    engine, sessions = connect(new_sqlite(tmp_path))
    blobs = BlobFolder(tmp_path / "blobs", tmp_path / "tmp")

    def stood_still() -> None:
        Garbage(sessions, blobs, max_unreferenced_s=60.0).collect(scene_of(sha256))
        raise NotOwner

    sha256 = put(blobs, b"content")
    Garbage(sessions, blobs, max_unreferenced_s=60.0, guard=stood_still).collect(lambda session: {sha256})
    assert blobs.exists(sha256)
    engine.dispose()


@pytest.mark.long
def test_large_deletion_does_not_block_requests(garbage: tuple[Garbage, BlobFolder], monkeypatch: pytest.MonkeyPatch) -> None:
    """Deleting thousands of files, which may take seconds, delays no other request.

    One of the files is uploaded again meanwhile, and one is already being deleted.
    """
    collector, blobs = garbage
    contents = [b"file %d" % i for i in range(AT_A_TIME + 40)]
    hashes = {put(blobs, content): content for content in contents}
    first: set[str] = set()
    begun, goes_on = threading.Event(), threading.Event()
    delete = BlobFolder.delete

    def slow(self: BlobFolder, some: set[str], guard: Callable[[], None]) -> None:
        first.update(first or some)
        begun.set()
        assert goes_on.wait(20)
        delete(self, some, guard)

    monkeypatch.setattr(BlobFolder, "delete", slow)

    def upload(sha256: str) -> None:
        with collector.pinned([sha256]):
            assert put(blobs, hashes[sha256]) == sha256
            collector.collect(scene_of(sha256))

    with ThreadPoolExecutor(3) as pool:
        deleting = pool.submit(collector.collect, lambda session: set(hashes))
        assert begun.wait(20)
        later, now = next(iter(set(hashes) - first)), next(iter(first))
        waits = pool.submit(upload, now)
        with collector.pinned([put(blobs, b"of another scene")]), collector.pinned([later]):
            assert blobs.exists(later), "it is not deleted yet, and will not be"
            assert not waits.done(), "what is being deleted cannot be found any more"
            goes_on.set()
            deleting.result(20)
            waits.result(20)
            assert blobs.exists(later)
    assert {sha256 for sha256 in hashes if blobs.exists(sha256)} == {now}


def test_pending_deletions_survive_restart(service: Service) -> None:
    """A restarted service deletes the files of a scene that the killed service had deleted only in the database.

    Blobs that a worker stored in between stay pinned.
    """
    service.stop()
    blobs = BlobFolder(service.options["data"] / "blobs", service.options["data"] / "tmp")
    stray, on_its_way = put(blobs, b"stray"), put(blobs, b"on its way")
    service.options["prepare_deadline"] = 0.5
    service.start()
    service.farm.garbage.remove_pins(on_its_way)
    service.farm.garbage.collect(scene_of(on_its_way))
    until(lambda: not blobs.exists(stray), "nobody came for it")
    assert blobs.exists(on_its_way)


def test_database_error_deletes_nothing(garbage: tuple[Garbage, BlobFolder]) -> None:
    collector, blobs = garbage
    sha256 = put(blobs, b"content")

    def refuse(session: Session) -> set[str]:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        collector.collect(refuse)
    assert blobs.exists(sha256)


@pytest.mark.long
@pytest.mark.parametrize(("column", "value"), [("files", [{"path": "scene.obj"}, 7]), ("compiled", {"kind": "?"})])
def test_damaged_row_does_not_block_deletions(service: Service, column: str, value: object) -> None:
    damaged, other = service.upload(), service.upload(OBJ + b"# other")
    with service.farm.sessions.begin() as session:
        row = session.get(Scene, damaged)
        assert row is not None
        setattr(row, column, value)
    files = service.scene(other)
    assert service.http.delete(f"/api/scenes/{other}").status_code == 204
    assert not stored(service, files)
    service.restart()  # the restart examines the references of all scenes
    assert service.http.delete(f"/api/scenes/{damaged}").status_code == 204
