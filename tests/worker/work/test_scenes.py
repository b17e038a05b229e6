"""Tests of uploading and downloading compiled scenes in parts."""

from __future__ import annotations

import hashlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import numpy as np
import pytest

from protocol.contract import BlobRef
from renderer.arrays.scene import flat
from renderer.errors import SceneError
from renderer.scene.compile import compile_scene
from renderer.scene.compiled_parts import Saver
from renderer.scene.frame_reuse import ShotCache
from tests.renderer.scene.test_shutter_merge import zoo
from worker.exchange.cache import BlobCache
from worker.exchange.errors import MachineError, RefusedError
from worker.exchange.link import FarmAnswer, Link
from worker.work.scenes import discard_damaged, open_scene, store_scene


class Service(Link):
    """A substitute for the link to the service. Its blobs are in a dict; it records the hashes of sent and fetched blobs."""

    def __init__(self) -> None:
        super().__init__("http://service.invalid", "token")
        self.blobs: dict[str, bytes] = {}
        self.sent: list[str] = []
        self.fetched: list[str] = []

    def has_blob(self, sha256: str) -> bool:
        return sha256 in self.blobs

    def store(self, path: Path) -> BlobRef:
        data = path.read_bytes()
        sha256 = hashlib.sha256(data).hexdigest()
        self.blobs[sha256] = data
        self.sent.append(sha256)
        return BlobRef("", sha256, len(data))

    def fetch(self, sha256: str, out: BinaryIO) -> None:
        self.fetched.append(sha256)
        if sha256 not in self.blobs:
            raise RefusedError("there is no such file")
        out.write(self.blobs[sha256])


def worker(service: Service, folder: Path) -> Any:
    return SimpleNamespace(link=service, cache=BlobCache(service, FarmAnswer("", "", ""), folder))


@pytest.fixture
def stored_frames(tmp_path: Path) -> tuple[Service, list[BlobRef]]:
    """Returns a service, and references to the compiled scenes of three frames that a worker has stored there."""
    service, kept = Service(), ShotCache()
    out = tmp_path / "out"
    out.mkdir()
    saver, one = Saver(out), worker(service, tmp_path / "one")
    refs = []
    for angle in (0.0, 20.0, 33.0):
        compiled = compile_scene(zoo(angle), shot_cache=kept)
        assert kept.cuts is not None
        refs.append(store_scene(one, saver.save(compiled, kept.cuts)))
    return service, refs


def test_each_part_is_transferred_once(stored_frames: tuple[Service, list[BlobRef]], tmp_path: Path) -> None:
    service, refs = stored_frames
    assert len(service.sent) == len(set(service.sent))
    assert set(service.sent) == {ref.sha256 for ref in refs} | {sha256 for ref in refs for sha256, _ in ref.parts}
    other = worker(service, tmp_path / "other")
    for angle, ref in zip((0.0, 20.0, 33.0), refs, strict=True):
        opened = open_scene(other.cache, ref.sha256)
        for name, array in flat(compile_scene(zoo(angle))).items():
            np.testing.assert_array_equal(flat(opened)[name], array, err_msg=name)
    assert sorted(service.fetched) == sorted(service.sent)
    of_all = sum(len(service.blobs[ref.sha256]) + sum(size for _, size in ref.parts) for ref in refs)
    assert sum(map(len, service.blobs.values())) < 0.6 * of_all


@pytest.mark.parametrize("is_here", [True, False], ids=["from beside the manifest", "from the cache"])
def test_deleted_part_is_uploaded_again(tmp_path: Path, is_here: bool) -> None:
    service, kept = Service(), ShotCache()
    out = tmp_path / "out"
    out.mkdir()
    saver, one = Saver(out), worker(service, tmp_path / "one")
    for angle in (0.0, 20.0):
        compiled = compile_scene(zoo(angle), shot_cache=kept)
        assert kept.cuts is not None
        ref = store_scene(one, saver.save(compiled, kept.cuts))
        sha256, _ = max(ref.parts, key=lambda part: part[1])
        if angle == 0.0:
            del service.blobs[sha256]  # with the only scene known to need it
            (one.cache.folder / sha256[:2] / sha256 if is_here else out / sha256).unlink()
    assert sha256 in service.blobs
    assert service.sent.count(sha256) == 2


def test_missing_part_returns_the_work(stored_frames: tuple[Service, list[BlobRef]], tmp_path: Path) -> None:
    service, refs = stored_frames
    manifest = tmp_path / "out" / refs[2].sha256
    sha256, _ = refs[2].parts[0]
    for path in (tmp_path / "out" / sha256, tmp_path / "one" / sha256[:2] / sha256):
        path.unlink()
    del service.blobs[sha256]
    with pytest.raises(MachineError, match="compiled again"):
        store_scene(worker(service, tmp_path / "one"), manifest)


def test_uploader_does_not_download_its_scene(stored_frames: tuple[Service, list[BlobRef]], tmp_path: Path) -> None:
    service, refs = stored_frames
    open_scene(worker(service, tmp_path / "one").cache, refs[1].sha256)
    assert service.fetched == []


def test_damaged_part_is_downloaded_again(stored_frames: tuple[Service, list[BlobRef]], tmp_path: Path) -> None:
    service, refs = stored_frames
    cache = worker(service, tmp_path / "one").cache
    sha256, size = max(refs[0].parts, key=lambda part: part[1])
    cache.path(sha256).write_bytes(b"cut")
    open_scene(cache, refs[0].sha256)  # detected by its size
    assert service.fetched == [sha256]
    data = bytearray(service.blobs[sha256])
    data[size // 2] ^= 1
    cache.path(sha256).write_bytes(data)
    assert discard_damaged(cache, refs[0].sha256)  # detected only by its digest
    assert not discard_damaged(cache, refs[0].sha256)
    assert cache.path(sha256).read_bytes() == service.blobs[sha256]


def test_invalid_manifest_raises_error(tmp_path: Path) -> None:
    service = Service()
    data = b'{"format": "what"}'
    service.blobs[hashlib.sha256(data).hexdigest()] = data
    with pytest.raises(SceneError, match="is damaged or not a compiled scene"):
        open_scene(worker(service, tmp_path).cache, hashlib.sha256(data).hexdigest())
