"""Tests of preparing a scene: which failures are those of the scene, and which of the machine (readers: test_reader.py)."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import pytest

from protocol.contract import BlobRef, Manifest, Result, SceneInfo
from renderer import jit
from worker import tasks
from worker.exchange.cache import BlobCache
from worker.exchange.errors import LinkError, MachineError, RefusedError, TokenError, WorkError
from worker.exchange.link import FarmAnswer, Link
from worker.process import context
from worker.reading.thumbnail import thumbnail_settings
from worker.work import prepare
from worker.work.reader import ReaderFolder

SCENE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
SHA256 = hashlib.sha256(SCENE).hexdigest()
MANIFEST = Manifest("scene", "scene.obj", [BlobRef("scene.obj", SHA256, len(SCENE))])
SUMMARY: dict[str, Any] = {
    "cameras": [], "counts": {}, "bounds": [], "animations": [], "variants": [], "warnings": [], "defaults": {},
    "compiled": "compiled.safetensors", "lights_power": 0.0,
}  # fmt: skip


class Service(Link):
    """A substitute for the link to the service. It has one file, and its next `away` uploads of blobs fail."""

    def __init__(self) -> None:
        super().__init__("http://service.invalid", "token")
        self.fetched = 0
        self.away = 0

    def manifest(self, scene: str) -> Manifest:
        return MANIFEST

    def fetch(self, sha256: str, out: BinaryIO) -> None:
        self.fetched += 1
        out.write(SCENE)

    def store(self, path: Path) -> BlobRef:
        if self.away:
            self.away -= 1
            raise LinkError("no answer")
        return BlobRef("", hashlib.sha256(path.read_bytes()).hexdigest(), path.stat().st_size)


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Returns a worker whose scene reader is replaced by a function that accepts only the bytes that were uploaded."""
    service = Service()
    reads: list[bytes] = []

    def read(room: ReaderFolder, *_: Any, **__: Any) -> dict[str, Any]:
        reads.append((room.scene / "scene.obj").read_bytes())
        if reads[-1] != SCENE:
            raise WorkError("scene.obj is damaged; export it anew")
        (room.out / "compiled.safetensors").write_bytes(b"compiled")
        return dict(SUMMARY)

    monkeypatch.setattr(ReaderFolder, "run", read)
    monkeypatch.setattr(BlobCache, "add_copy", lambda *_: None)
    monkeypatch.setattr("worker.exchange.retry.time.sleep", lambda seconds: None)
    cache = BlobCache(service, FarmAnswer("", "", ""), tmp_path / "cache")
    sent: list[Result] = []
    board = SimpleNamespace(write=lambda *_: None)
    results = SimpleNamespace(send=lambda result, timeout_s=None: sent.append(result))
    made = SimpleNamespace(name="w", kind="k", link=service, cache=cache, reads=reads, board=board, results=results, sent=sent)
    monkeypatch.setattr(context, "_current", made)
    return made


def prepared(worker: Any) -> SceneInfo:
    return prepare.prepare_scene(worker, MANIFEST, lambda step, part: None)


def test_file_damaged_in_cache_is_downloaded_again(worker: Any) -> None:
    path = worker.cache.path(SHA256)
    path.write_bytes(SCENE.replace(b"1", b"7"))  # the same size, so only its digest differs
    assert prepared(worker).kind == "k"
    assert worker.reads[-1] == SCENE
    assert worker.link.fetched == 2


def test_file_damaged_at_upload_is_read_once(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def damaged(*_: Any, **__: Any) -> dict[str, Any]:
        worker.reads.append(b"")
        raise WorkError("scene.obj is damaged; export it anew")

    monkeypatch.setattr(ReaderFolder, "run", damaged)
    with pytest.raises(WorkError, match="export it anew"):
        prepared(worker)
    assert worker.reads == [b""]


def test_result_is_kept_while_service_restarts(worker: Any) -> None:
    worker.link.away = 3
    prepared(worker)
    assert len(worker.reads) == 1


def full_disk(*_: Any, **__: Any) -> Any:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "scene.obj")


def test_full_disk_is_machine_error(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "link", full_disk)
    monkeypatch.setattr(shutil, "copyfile", full_disk)
    with pytest.raises(MachineError, match="No space left"):
        prepared(worker)


@pytest.mark.parametrize(
    ("variant", "is_cached", "compiled"),
    [("full", False, ["full"]), ("full", True, []), ("no variant", False, []), ([], False, [])],
)
def test_slot_compiles_missing_kernel(
    worker: Any, monkeypatch: pytest.MonkeyPatch, variant: Any, is_cached: bool, compiled: list[str]
) -> None:
    done: list[str] = []
    steps: list[str] = []
    monkeypatch.setitem(SUMMARY, "variant", variant)
    monkeypatch.setattr(jit, "is_cached", lambda name: is_cached)
    monkeypatch.setattr(prepare, "warm_up", lambda variant, prepares: done.append(variant))
    prepare.prepare_scene(worker, MANIFEST, lambda step, part: steps.append(step))
    assert done == compiled
    assert (prepare.COMPILING in steps) == bool(compiled)


def test_preview_comes_before_kernels_are_compiled(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    data = b"solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n"
    ref = BlobRef("scene.stl", hashlib.sha256(data).hexdigest(), len(data))
    worker.cache.path(ref.sha256).write_bytes(data)
    done: list[str] = []

    def run(room: ReaderFolder, job: Any, subject: str, seconds: float, on_message: Any, **more: Any) -> dict[str, Any]:
        assert not more["needs_kernels"]
        link = SimpleNamespace(send=on_message, call_parent=lambda name: more["calls"][name]())
        answer: dict[str, Any] = job(link)
        return answer

    def build(*_: Any, **__: Any) -> Any:
        done.append("build")
        raise WorkError("this test ends here")

    monkeypatch.setattr(ReaderFolder, "run", run)
    monkeypatch.setattr(jit, "is_cached", lambda name: False)
    monkeypatch.setattr(prepare, "warm_up", lambda: done.append("compile"))
    monkeypatch.setattr("worker.reading.prepare.compile_scene", build)
    with pytest.raises(WorkError, match="ends here"):
        prepare.prepare_scene(
            worker,
            Manifest("scene", "scene.stl", [ref]),
            lambda step, part: done.append("step") if step == prepare.COMPILING else None,
            lambda shown: done.append(f"preview of {len(shown.cameras)} camera"),
        )
    assert done == ["preview of 1 camera", "step", "compile", "build"]


def test_thumbnail_has_scene_aspect_ratio() -> None:
    view = {"eye": [0, 0, 1], "target": [0, 0, 0]}
    asked = {(16, 9): 144, (100, 100): 256, (1000, 10): 64, (1, 9): 512}
    for (width, height), small in asked.items():
        settings = thumbnail_settings(view, {"width": width, "height": height})
        assert (settings.width, settings.height) == (256, small)


@pytest.mark.parametrize(
    ("base", "failure", "sent"),
    [
        (None, None, ["prepare-started", "prepared", "thumbnail-made"]),
        (None, WorkError("its reader crashed"), ["prepare-started", "prepared"]),
        (None, LinkError("no answer"), ["prepare-started", "prepared"]),
        (None, OSError(errno.ENOSPC, "no room"), ["prepare-started", "prepared"]),
        ({}, None, ["prepare-started", "prepared"]),  # the base scene has the thumbnail
    ],
)
def test_thumbnail_failure_does_not_fail_scene(
    worker: Any, monkeypatch: pytest.MonkeyPatch, base: Any, failure: Exception | None, sent: list[str]
) -> None:
    def make(_: Any, info: SceneInfo, subject: str) -> BlobRef:
        assert worker.sent[-1].event["type"] == "prepared", "jobs may begin before"
        if failure is not None:
            raise failure
        return BlobRef("", SHA256, 3)

    monkeypatch.setattr(tasks, "make_thumbnail", make)
    monkeypatch.setattr(worker.link, "manifest", lambda scene: replace(MANIFEST, base=base))
    monkeypatch.setattr(prepare, "relight", lambda *_: None)
    tasks._prepare(SimpleNamespace(request=SimpleNamespace(delivery_info={})), "scene")
    assert [result.event["type"] for result in worker.sent if result.event["type"] != "prepare-progress"] == sent
    if "thumbnail-made" in sent:
        assert worker.sent[-1].event["thumbnail"]["sha256"] == SHA256


@pytest.mark.parametrize("name", ["x" * 300, "a\0b", "../up", "/etc/passwd", "scene.obj/inside"])
def test_invalid_file_name_is_scene_error(worker: Any, name: str) -> None:
    files = [*MANIFEST.files, BlobRef(name, SHA256, len(SCENE))]
    with pytest.raises(WorkError, match="rename it"):
        prepare.prepare_scene(worker, Manifest("scene", "scene.obj", files), lambda step, part: None)


@pytest.mark.parametrize(
    ("error", "event"),
    [
        (LinkError("no answer"), "prepare-returned"),
        (TokenError("does not know this token"), "prepare-returned"),
        (MachineError("no room"), "prepare-returned"),
        (RefusedError("answers 404"), "prepare-failed"),
        (WorkError("scene.obj is damaged"), "prepare-failed"),
        (ZeroDivisionError("a fault"), "prepare-failed"),
    ],
)
def test_worker_faults_return_the_scene(worker: Any, monkeypatch: pytest.MonkeyPatch, error: Exception, event: str) -> None:
    def fail(*_: Any) -> SceneInfo:
        raise error

    monkeypatch.setattr(tasks, "prepare_scene", fail)
    monkeypatch.setattr(tasks, "LINK_TIMEOUT_S", 0.0)
    tasks._prepare(SimpleNamespace(request=SimpleNamespace(delivery_info={})), "scene")
    assert [result.event["type"] for result in worker.sent] == ["prepare-started", event]
    assert str(error) in worker.sent[-1].event["error"]
