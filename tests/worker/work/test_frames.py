"""Tests that a worker prepares frames with the same result as `rayfarm render --frame`, for any selection and order."""

from __future__ import annotations

import hashlib
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import numpy as np
import pytest

from protocol.contract import BlobRef, Manifest, PrepareFrames
from rayfarm.frame import PictureOrder
from rayfarm.picture import Picture
from rayfarm.stage import OpenScene
from renderer.scene import compiled as compiled_file
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.compiled import CompiledScene
from renderer.scene.compiled_parts import MANIFEST_STARTS
from renderer.scene.load import Shot
from renderer.settings import View
from tests.grids import grid
from tests.renderer.scene.builders import TRIANGLE, Gltf
from tests.worker.work.jobs import crash_at_frame_1
from worker.exchange.cache import BlobCache
from worker.exchange.link import FarmAnswer, Link
from worker.reading import frames as reading
from worker.work import frames

FRAMES = [0, 12, 24, 6.5, 48, 60]


def animated_scene(camera: bool, thing: bool) -> Gltf:
    """Builds a glTF scene with a camera and a triangle.

    camera, thing: whether the camera, and the triangle, moves to the right within a second. A second clip moves them further.
    """
    g = Gltf()
    g.mesh(np.float32([(-5, -1, -5), (5, -1, -5), (0, -1, 5)]))
    g.mesh(TRIANGLE)
    g.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]
    g.node(camera=0, translation=[0, 0, 5])
    targets = [node for node, moves in ((2, camera), (1, thing)) if moves]
    if targets:
        g.root["animations"] = []
    seconds = g.array(np.float32([0, 1]))
    for name, start, end in (("go", 0, 2), ("far", 3, 7)) if targets else ():
        ways = [g.array(np.float32([(start, 0, z), (end, 0, z)])) for z in (5, 0)]
        samplers = [{"input": seconds, "output": way} for way in ways]
        channels = [{"sampler": int(node == 1), "target": {"node": node, "path": "translation"}} for node in targets]
        g.root["animations"].append({"name": name, "samplers": samplers, "channels": channels})
    return g


class Bench:
    """A scene, and its compiled scene at the shot's start.

    Prepares frames as a worker does and as `rayfarm render` does, so that tests can compare the results.
    """

    def __init__(self, folder: Path, scene: Gltf, **asked: Any) -> None:
        self.scene = folder / "scene"
        self.scene.mkdir()
        (self.scene / "shot.glb").write_bytes(scene.glb())
        self.out = folder / "out"
        self.out.mkdir()
        description = self.shot().scene_at()
        self.base = compile_scene(description)
        summary = summarise(description, self.base)
        self.asked = PrepareFrames("work", "job", "scene", [], "base", summary["cameras"][-1]["view"], **asked)

    def shot(self) -> Shot:
        return Shot(self.scene, "shot.glb")

    def prepared(self, order: list[float]) -> dict[float, tuple[str | None, list[dict[str, Any]]]]:
        """Prepares frames in the given order as a worker does. Returns by frame (digest, views).

        digest: of the frame's own compiled scene; None if it equals the one at the shot's start. views: the view to render, and
        those at times within the shutter.
        """
        out = Path(tempfile.mkdtemp(dir=self.out))
        stage = reading.OpenScene(self.shot(), self.asked, self.base, out)
        found = {}
        for frame in order:
            said = stage.frame_message(Moment(frame, self.asked.fps, self.asked.clip))
            own = said["file"] and self.hash_of(compiled_file.load(out / said["file"], lambda sha256, _: next(out.rglob(sha256))))
            found[frame] = own, [said["view"], *said["views"]]
        return found

    def hash_of(self, scene: CompiledScene) -> str:
        compiled_file.save(scene, self.out / "whole")
        return hashlib.sha256((self.out / "whole").read_bytes()).hexdigest()

    def computed_by_render(self, frame: float) -> tuple[str | None, list[dict[str, Any]]]:
        """Returns (digest, views) of a frame as `rayfarm render --frame` computes them. Both are as in `prepared`."""
        moment = Moment(frame, self.asked.fps, self.asked.clip)
        camera = None if self.asked.camera is None else str(self.asked.camera)
        compiled, summary = OpenScene(self.shot(), camera, shutter=self.asked.shutter).scene_at(moment)
        picture = Picture(({} if camera is None else {"camera": camera}) | self.asked.shutter)
        order = PictureOrder(picture, [], False, 0.0, "neutral", None, 0, self.asked.turntable, None)
        sha256 = self.hash_of(compiled)
        settings = order.settings(summary, moment).to_json()
        return None if sha256 == self.hash_of(self.base) else sha256, [settings["view"], *settings["views"]]


@grid(
    ("camera", "thing", "asked"),
    [
        (True, False, {}),
        (False, True, {}),
        (False, True, {"camera": "auto"}),
        (True, True, {"fps": 48.0, "clip": "far", "camera": 1}),
        (False, False, {"turntable": 2.0}),
        (True, False, {"turntable": 2.0, "clip": "far"}),
        (True, True, {"shutter": {"shutter": 0.5}}),
        (False, True, {"shutter": {"shutter": 2.0, "shutter_at": "trailing", "shutter_keys": 3}, "turntable": 2.0}),
        (True, False, {"shutter": {"shutter": 1.0}, "turntable": 2.0}),
    ],
)
def test_prepared_frame_equals_rendered_still(tmp_path: Path, camera: bool, thing: bool, asked: dict[str, Any]) -> None:
    bench = Bench(tmp_path, animated_scene(camera, thing), **asked)
    said = bench.prepared(FRAMES)
    assert bench.prepared(FRAMES[::-1]) == said, "whichever were prepared before"
    for frame in FRAMES:
        sha256, view = bench.computed_by_render(frame)
        assert said[frame][0] == sha256
        assert list(map(View.from_json, said[frame][1])) == list(map(View.from_json, view))
    if "shutter" in asked:
        assert len(said[12][1]) >= 3, "the camera moves"
    if not thing and "clip" not in asked:
        assert {sha256 for sha256, _ in said.values()} == {None}, "only the camera moves: nothing is compiled"


def test_static_scene_is_compiled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(tmp_path, animated_scene(False, True))
    compiled: list[int] = []
    monkeypatch.setattr(reading, "compile_scene", lambda *given, **named: compiled.append(1) or compile_scene(*given, **named))
    bench.prepared([24, 25, 30, 48])
    assert len(compiled) == 1


def test_requested_view_is_unchanged(tmp_path: Path) -> None:
    view = {"eye": [1.0, 2.0, 3.0], "target": [0.0, 0.0, 0.0], "fov": 30.0, "focus": None}
    bench = Bench(tmp_path, animated_scene(True, False), view=view)
    assert {tuple(view["eye"]) for _, (view,) in bench.prepared([0, 12]).values()} == {(1.0, 2.0, 3.0)}


def test_frame_with_missing_file_fails_alone(tmp_path: Path) -> None:
    for number in (0, 1, 3):
        (tmp_path / f"smoke.{number}.obj").write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 %d 0\nf 1 2 3\n" % (number + 1))
    (tmp_path / "scene.yaml").write_text("shapes: [{type: mesh, file: smoke.#.obj}]\n")
    base = compile_scene(Shot(tmp_path, "scene.yaml").scene_at())
    auto = summarise(Shot(tmp_path, "scene.yaml").scene_at(), base)["cameras"][-1]["view"]
    work = PrepareFrames("work", "job", "scene", [0, 2, 4, 6], "base", auto)
    said: list[dict[str, Any]] = []
    reading.frame_answerer(tmp_path, Manifest("scene", "scene.yaml", []), work, base, tmp_path)(work.frames, said.append)
    assert [message["frame"] for message in said] == [0, 2, 4, 6]
    assert ["failed" in message for message in said] == [False, False, True, False]
    assert "smoke" in said[2]["failed"]
    assert said[0]["file"] is None
    assert said[3]["file"] is not None


class Service(Link):
    """A substitute for the link to the service, which has the files in a folder and stores blobs."""

    def __init__(self, folder: Path) -> None:
        super().__init__("http://service.invalid", "token")
        self.folder = folder
        self.stored: list[bytes] = []

    def has_blob(self, sha256: str) -> bool:
        return any(hashlib.sha256(data).hexdigest() == sha256 for data in self.stored)

    def fetch(self, sha256: str, out: BinaryIO) -> None:
        out.write(next(p.read_bytes() for p in self.folder.iterdir() if hashlib.sha256(p.read_bytes()).hexdigest() == sha256))

    def store(self, path: Path) -> BlobRef:
        self.stored.append(path.read_bytes())
        return BlobRef("", hashlib.sha256(self.stored[-1]).hexdigest(), len(self.stored[-1]))


@pytest.mark.long
def test_every_frame_is_answered_if_reader_crashes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    upload = tmp_path / "upload"
    upload.mkdir()
    for number in (0, 1, 3):
        (upload / f"smoke.{number}.obj").write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 %d 0\nf 1 2 3\n" % (number + 1))
    (upload / "scene.yaml").write_text("shapes: [{type: mesh, file: smoke.#.obj}]\n")
    description = Shot(upload, "scene.yaml").scene_at()
    base = compile_scene(description)
    auto = summarise(description, base)["cameras"][-1]["view"]
    files = [BlobRef(p.name, hashlib.sha256(p.read_bytes()).hexdigest(), p.stat().st_size) for p in sorted(upload.iterdir())]
    service = Service(upload)
    worker: Any = SimpleNamespace(link=service, cache=BlobCache(service, FarmAnswer("", "", ""), tmp_path / "cache"))
    compiled_file.save(base, upload / "compiled")
    sha256 = hashlib.sha256((upload / "compiled").read_bytes()).hexdigest()
    said: list[tuple[str, Any]] = []
    manifest, work = Manifest("scene", "scene.yaml", files), PrepareFrames("work", "job", "scene", [0, 2, 4, 6], sha256, auto)
    frames.prepare_frames(worker, manifest, work, lambda kind, **more: said.append((kind, more.get("frame"))))
    assert said == [("frame-prepared", 0), ("frame-prepared", 2), ("frame-failed", 4), ("frame-prepared", 6)]
    manifests = [data for data in service.stored if data.startswith(MANIFEST_STARTS)]
    assert len(manifests) == 2, "frame 0 is the scene as it was prepared"
    assert len(set(service.stored)) == len(service.stored), "what frames share is sent once"

    (opened,) = frames._open.values()
    said.clear()
    other = replace(work, work="another", job="another", frames=[6, 0])
    frames.prepare_frames(worker, manifest, other, lambda kind, **more: said.append((kind, more.get("frame"))))
    assert said == [("frame-prepared", 6), ("frame-prepared", 0)]
    assert list(frames._open.values()) == [opened], "another job of the same scene finds it open"

    said.clear()
    has = service.has_blob
    monkeypatch.setattr(
        service, "has_blob", lambda sha256: time.sleep(0.1) or has(sha256)
    )  # slow uploads, so that the child gets far ahead
    for again in (other, replace(other, frames=[2, 6, 0])):
        frames.prepare_frames(worker, manifest, again, lambda kind, **more: said.append((kind, more.get("frame"))))
    assert said == [("frame-prepared", frame) for frame in (6, 0, 2, 6, 0)], "what comes again is not let go of"
    monkeypatch.undo()
    frames.forget_frames()

    monkeypatch.setattr(frames, "serve_requests", crash_at_frame_1)
    said.clear()
    frames.prepare_frames(worker, manifest, work, lambda kind, **more: said.append((kind, more.get("frame"))))
    assert said == [("frame-prepared", 0), ("frame-failed", 2), ("frames-returned", None)]
    assert not frames._open
