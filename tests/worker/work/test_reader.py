"""Tests of confined readers as a slot uses them: answers are validated, and crashes are errors of the scene or the machine."""

from __future__ import annotations

import errno
import hashlib
import os
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from protocol.contract import BlobRef, Manifest
from renderer import jit
from tests.renderer.confine import jobs
from tests.worker.work.jobs import link_out, raise_disk_full, return_answer
from worker.exchange.cache import BlobCache
from worker.exchange.errors import UnfitError, WorkError
from worker.exchange.link import FarmAnswer, Link
from worker.work import reader
from worker.work.files import place_files
from worker.work.reader import ReaderFolder

SECONDS = 60.0


def test_reader_cannot_access_slot_resources(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAYFARM_TOKEN", "secret")
    with ReaderFolder("test") as room:
        found = room.run(jobs.probe, "truck.glb", SECONDS)
    assert "secret" not in str(found["environment"])
    assert all(each.startswith(("/dev/null", "pipe:")) for each in found["descriptors"])
    assert found["refused"] == dict.fromkeys(found["refused"], True)
    assert not room.folder.exists()


@pytest.mark.parametrize("needs_kernels", [True, False])
def test_only_jobs_that_need_kernels_wait_for_them(monkeypatch: pytest.MonkeyPatch, needs_kernels: bool) -> None:
    loaded: list[list[str]] = []
    compiled: list[bool] = []
    monkeypatch.setattr(jit, "is_cached", lambda name: bool(compiled))
    monkeypatch.setattr(reader, "warm_up", lambda: compiled.append(True))
    monkeypatch.setattr(reader.running, "Reader", lambda job, reads, writes, bounds, preload, calls: loaded.append(preload))
    with ReaderFolder("test") as room:
        room.begin_reader(jobs.probe, "truck.glb", SECONDS, needs_kernels=needs_kernels)
    (preload,) = loaded
    assert compiled == [True] * needs_kernels
    assert ("worker.reading.kernels:load" in preload) == needs_kernels
    assert "worker.reading.prepare" in preload


@pytest.mark.parametrize(
    ("job", "kind", "sentence"),
    [
        (jobs.crash, WorkError, r"truck.glb cannot be read: its importer crashed \(signal 11"),
        (jobs.wrong, WorkError, "the buffer ends early"),
        (jobs.hungry, UnfitError, "truck.glb needs more than the 0.5 GiB that this worker grants one scene"),
        (raise_disk_full, UnfitError, "this machine cannot use its files"),
    ],
)
def test_reader_exit_is_scene_or_machine_error(job: Any, kind: type[Exception], sentence: str) -> None:
    with ReaderFolder("test") as room, pytest.raises(kind, match=sentence):
        room.run(job, "truck.glb", SECONDS, memory=512 << 20)


@pytest.mark.parametrize(
    "name", ["../scene/a", "..", "", "/etc/passwd", "missing", "folder", "a/", ".part", None, 7, "link", "in/a"]
)
def test_names_returned_by_reader_are_checked(name: Any) -> None:
    with ReaderFolder("test") as room:
        (room.scene / "a").write_text("of the slot")
        (room.out / "folder").mkdir()
        (room.out / "link").symlink_to(room.scene / "a")
        (room.out / "in").symlink_to(room.scene)
        answered = room.run(partial(return_answer, {"compiled": name}), "truck.glb", SECONDS)
        with pytest.raises(WorkError, match=r"the scene's reader (gave|wrote)"):
            room.compiled(answered["compiled"])


def test_reader_cannot_link_outside_its_folder() -> None:
    with ReaderFolder("test") as room:
        (room.scene / "a").write_text("of the slot")
        assert room.run(partial(link_out, os.fsencode(room.scene), os.fsencode(room.out)), "truck.glb", SECONDS) == {"made": []}


def test_part_with_wrong_hash_is_not_cached(tmp_path: Path) -> None:
    """Checks that a part of a compiled scene whose bytes do not match its hash is refused.

    In the cache, the part would affect all scenes that share it.
    """
    cache = BlobCache(Link("http://service.invalid", "token"), FarmAnswer("", "", ""), tmp_path / "cache")
    sha256 = hashlib.sha256(b"another scene's part").hexdigest()
    (tmp_path / sha256).write_bytes(b"forged")
    with pytest.raises(WorkError, match="does not match its hash"):
        cache.add_copy(tmp_path / sha256, sha256)
    assert not [path for path in (tmp_path / "cache").rglob(f"*{sha256}*") if path.is_file()]


@pytest.mark.parametrize("name", ["\u00e9t\u00e9/\u5f71.obj", "plain.obj"])
def test_file_names_are_utf_8_in_any_locale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    (tmp_path / "blob").write_bytes(b"v 0 0 0")
    monkeypatch.setattr(os, "fsdecode", lambda data: data.decode("latin-1"))  # as Python does in an old locale
    worker: Any = type("Worker", (), {"cache": type("Cache", (), {"path": lambda *_: tmp_path / "blob"})()})
    (tmp_path / "scene").mkdir()
    place_files(worker, Manifest("scene", name, [BlobRef(name, "0" * 64, 7)]), tmp_path / "scene")
    (placed,) = (path for path in (tmp_path / "scene").rglob("*") if path.is_file())
    assert str(placed.relative_to(tmp_path / "scene")).encode("latin-1").decode() == name


def test_missing_temporary_folder_is_machine_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> str:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr("renderer.confine.job_folder.tempfile.mkdtemp", refuse)
    with pytest.raises(UnfitError, match="no writable folder for temporary files"):
        ReaderFolder("test")
