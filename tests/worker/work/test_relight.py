"""Tests of compiling a prepared scene with another environment.

No file of the scene is read again, shared parts are stored once, and the original scene is unchanged.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import numpy as np
import pytest

from protocol.contract import BlobRef, Manifest, SceneInfo
from renderer.scene.studio import STUDIO_NOTES
from tests.grids import grid
from tests.worker.work.test_environments import image
from worker.exchange.cache import BlobCache
from worker.exchange.link import FarmAnswer, Link
from worker.work import prepare

SCENE = b"shapes: [{type: sphere, center: [0, 0, 0], radius: 1}, {type: cube}]\n"


class Service(Link):
    """A substitute for the link to the service, which has the given blobs."""

    def __init__(self) -> None:
        super().__init__("http://service.invalid", "token")
        self.blobs: dict[str, bytes] = {}
        self.stored: list[int] = []  # sizes of stored blobs

    def put(self, path: str, data: bytes) -> BlobRef:
        sha256 = hashlib.sha256(data).hexdigest()
        self.blobs[sha256] = data
        return BlobRef(path, sha256, len(data))

    def has_blob(self, sha256: str) -> bool:
        return sha256 in self.blobs

    def fetch(self, sha256: str, out: BinaryIO) -> None:
        out.write(self.blobs[sha256])

    def store(self, path: Path) -> BlobRef:
        data = path.read_bytes()
        self.stored.append(len(data))
        return self.put("", data)


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    service = Service()
    return SimpleNamespace(name="w", kind="k", link=service, cache=BlobCache(service, FarmAnswer("", "", ""), tmp_path / "cache"))


def prepared(worker: Any, manifest: Manifest) -> SceneInfo:
    return prepare.prepare_scene(worker, manifest, lambda step, part: None)


@pytest.mark.long
@grid("light", ["sky:20,40", "window.exr"], ordinary=("sky:20,40",))
def test_only_environment_is_compiled_and_stored(
    worker: Any, tmp_path: Path, light: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = worker.link.put("scene.yaml", SCENE)
    pixels = np.random.default_rng(1).random((16, 32, 3))
    window = worker.link.put("window.exr", image(tmp_path / "window.exr", pixels).read_bytes())
    base = prepared(worker, Manifest("a", "scene.yaml", [scene]))
    assert set(base.warnings) & set(STUDIO_NOTES)
    lit = Manifest("b", "scene.yaml", [scene, window], light)
    whole = prepared(worker, lit)
    shared = {sha256 for sha256, _ in base.compiled.parts} & {sha256 for sha256, _ in whole.compiled.parts}
    for sha256 in {whole.compiled.sha256, *(part for part, _ in whole.compiled.parts)} - shared:
        del worker.link.blobs[sha256]
    worker.link.stored.clear()
    with monkeypatch.context() as patched:
        patched.setattr(prepare, "_prepare_in_reader", lambda *_: pytest.fail("its files are read"))
        quick = prepared(worker, replace(lit, base=asdict(base)))
    assert quick.compiled == whole.compiled
    assert not set(quick.warnings) & set(STUDIO_NOTES)
    assert (quick.cameras, quick.counts, quick.thumbnail) == (base.cameras, base.counts, None)
    assert len(worker.link.stored) == 3, "the manifest, and the two parts that differ"

    strange = asdict(replace(base, kind="another"))
    assert prepared(worker, replace(lit, base=strange)).compiled == whole.compiled, "else it is compiled of its files"
