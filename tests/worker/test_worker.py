"""Tests of a real worker process with real Redis, Celery and forks. The test plays the service, by HTTP and Redis."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from protocol.contract import (
    DENOISE,
    PATH_GUIDE,
    PREPARE,
    RENDER_BATCHES,
    RESULTS,
    DenoiseFrame,
    GuideScene,
    PrepareFrames,
    RenderBatch,
    Result,
    SceneInfo,
    TrainPathGuide,
    denoise_queue,
    pause_key,
    prepare_queue,
    recall_key,
    render_queue,
)
from protocol.sums import unpack_sums
from protocol.view_parts import (
    DENOISE_VIEW,
    RENDER_VIEW,
    VIEW_ANSWERS,
    Part,
    ViewAnswer,
    ViewDenoise,
    ViewParts,
    view_key,
    view_queue,
)
from renderer.denoise import denoise, denoise_fast, denoise_with_guides, is_available
from renderer.denoise_guides import denoise_still
from renderer.film import ALBEDO, COLOR, DEPTH, NORMAL, SAMPLES, mean
from renderer.guiding.stored_guide import read_guide
from renderer.image import rgbe9995
from renderer.render import render_batch, render_frame
from renderer.scene import compiled as compiled_file
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, Tile, View
from renderer.temporal_denoise import DenoisedFrame, stabilised_frame
from tests.helpers import ROOT, wait_until
from tests.rayfarm.test_stage import animated_test_scene
from tests.renderer.builders import emitter, scene, square
from tests.worker.bench import Bench, a_worker, processor_time, processor_times, rendering_slot, slots_of

SCENE = """
shapes:
  - {type: sphere, name: ball, center: [0, 0, 0], radius: 1, material: grey}
materials:
  grey: {kind: diffuse, color: 0.5}
environment: {color: 1}
"""
USD = """#usda 1.0
def Mesh "square" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
}
"""


@pytest.fixture(scope="module")
def bench(redis_url: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with a_worker(redis_url, tmp_path_factory.mktemp("worker"), slots=2) as made:
        yield made


@pytest.fixture(scope="module")
def info(bench: Bench) -> SceneInfo:
    bench.upload("ball", {"ball.yaml": SCENE.encode()}, "ball.yaml")
    result = bench.prepare("ball")
    assert result.event["type"] == "prepared", result.event
    return SceneInfo.from_json(result.event["info"])


def batch_of(info: SceneInfo, name: str, first: int, count: int, size: int = 64) -> RenderBatch:
    view = View((0, 0, 4), (0, 0, 0))
    return RenderBatch(
        name, "job", 0, info.compiled.sha256, Tile(0, 0, size, size), first, count, RenderSettings(size, size, view)
    )


def test_scene_is_prepared(bench: Bench, info: SceneInfo) -> None:
    assert info.counts["spheres"] == 1
    assert info.cameras
    assert info.compiled.sha256 in bench.service.blobs
    made = [result.event["thumbnail"] for result in bench.seen if result.event["type"] == "thumbnail-made"]
    assert bench.service.blobs[made[0]["sha256"]].startswith(b"\x89PNG")


@pytest.mark.long
def test_cold_worker_shows_a_scene_before_its_kernels_are_compiled(
    redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAYFARM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("RAYFARM_KERNELS", str(tmp_path / "none"))  # without those of an installation
    limit = ["--memory", "64"]  # so that it compiles the plain kernel only
    with a_worker(redis_url, tmp_path, slots=1, options=limit) as cold:
        cold.upload("scene", {"square.usda": USD.encode()}, "square.usda")
        kind = cold.report().kind  # type: ignore[union-attr]
        cold.celery.send_task(PREPARE, kwargs={"scene": "scene"}, queue=prepare_queue(kind))
        while "preview" not in (event := cold.next("prepare-progress").event):
            assert "compiling" not in event["step"]
        assert not [*tmp_path.rglob("*.done")]
        assert event["preview"]["preview"]["sha256"] in cold.service.blobs
        assert cold.next("prepared", "prepare-failed", seconds=400.0).event["type"] == "prepared"
        assert [*tmp_path.rglob("render_pool-plain*.done")]
        cold.next("thumbnail-made")


def test_sum_of_batches_equals_whole_picture(bench: Bench, info: SceneInfo) -> None:
    parts = []
    for name, first, count in (("a", 0, 3), ("b", 3, 5), ("whole", 0, 8)):
        bench.render(batch_of(info, name, first, count))
    for _ in range(3):
        result = bench.next("batch", "batch-failed")
        assert result.event["type"] == "batch", result.event
        assert result.sums is not None
        parts.append((result.event["batch"], unpack_sums(result.sums, Tile(0, 0, 64, 64))))
    sums = dict(parts)
    assert np.array_equal(sums["a"] + sums["b"], sums["whole"])
    assert sums["whole"].any()


def test_view_parts_are_exact_and_outdated_ones_dropped(bench: Bench, info: SceneInfo) -> None:
    kind = bench.report().kind  # type: ignore[union-attr]
    assert bench.report().views  # type: ignore[union-attr]
    bench.store.delete(VIEW_ANSWERS)
    settings = batch_of(info, "", 0, 1).settings
    parts = [Part(number, Tile(0, 32 * number, 64, 32), 0, 4) for number in range(2)]
    bench.store.set(view_key("me"), 2)
    for view in (1, 2):  # view 1 is outdated
        work = ViewParts(f"message {view}", "me", view, info.compiled.sha256, settings, parts, has_guides=True)
        bench.celery.send_task(RENDER_VIEW, kwargs={"parts": work.to_json()}, queue=view_queue(kind))
    answers: list[ViewAnswer] = []

    def over() -> bool:
        while (data := bench.store.lpop(VIEW_ANSWERS)) is not None:
            answers.append(ViewAnswer.from_bytes(data))  # type: ignore[arg-type]
        return bool(answers) and answers[-1].type == "over"

    wait_until(over, 60, "the view is rendered")
    assert {answer.view for answer in answers} == {2}
    assert [answer.type for answer in answers if answer.type != "compiling"] == ["begun", "part", "part", "over"]
    assert bench.store.ttl(VIEW_ANSWERS) in (-2, *range(1, 21)), "it goes where nobody reads it"
    bench.render(batch_of(info, "whole", 0, 4))
    whole = bench.next("batch").sums
    assert whole is not None
    expected = unpack_sums(whole, Tile(0, 0, 64, 64))
    for part, answer in zip(parts, [answer for answer in answers if answer.type == "part"], strict=True):
        got = unpack_sums(answer.sums, part.tile)
        rows = slice(part.tile.y, part.tile.y + 32)
        np.testing.assert_array_equal(got[COLOR], expected[COLOR][:, rows])
        np.testing.assert_array_equal(got[SAMPLES], expected[SAMPLES][rows])
        np.testing.assert_array_equal(got[NORMAL], expected[NORMAL][:, rows])
        assert not got[DEPTH].any(), "what a view does not show does not travel"


@pytest.mark.long
def test_animated_scene_is_stored_in_parts(bench: Bench, tmp_path: Path) -> None:
    data = animated_test_scene()
    (tmp_path / "moves.glb").write_bytes(data)
    here = compile_scene(read(tmp_path, "moves.glb"))
    settings = RenderSettings(24, 24, View((0, 0, 9), (0, 0, 0)))
    alone = render_batch(here, settings, Tile(0, 0, 24, 24), 0, 2)  # also compiles the kernel, before it is needed
    bench.upload("moves", {"moves.glb": data}, "moves.glb")
    event = bench.prepare("moves").event
    assert event["type"] == "prepared", event
    info = SceneInfo.from_json(event["info"])
    assert len(info.compiled.parts) >= 5
    assert {sha256 for sha256, _ in info.compiled.parts} <= bench.service.blobs.keys()
    bench.render(RenderBatch("m", "job", 0, info.compiled.sha256, Tile(0, 0, 24, 24), 0, 2, settings))
    result = bench.next("batch", "batch-failed")
    assert result.sums is not None, result.event
    np.testing.assert_array_equal(unpack_sums(result.sums, Tile(0, 0, 24, 24)), alone.sums)


@pytest.mark.long
def test_frame_uploads_only_its_own_parts(bench: Bench, tmp_path: Path) -> None:
    data = animated_test_scene()
    (tmp_path / "moves.glb").write_bytes(data)
    bench.upload("shot", {"moves.glb": data}, "moves.glb")
    info = SceneInfo.from_json(bench.prepare("shot").event["info"])
    bench.service.sent.clear()
    auto = info.cameras[-1]["view"]
    known = {info.compiled.sha256, *(sha256 for sha256, _ in info.compiled.parts)}
    for work, frames in (("one", [10, 20]), ("two", [30])):
        found = bench.prepare_frames(PrepareFrames(work, "job", "shot", frames, info.compiled.sha256, auto))
        sent = []
        for ref in (each.compiled for each in found):
            assert ref is not None
            own = {sha256: size for sha256, size in ((ref.sha256, ref.size), *ref.parts) if sha256 not in known}
            assert len(own) < 1 + len(ref.parts)
            assert sum(own.values()) < 0.7 * sum(size for _, size in ref.parts)
            sent += own.items()
            known |= own.keys()
        assert sorted(bench.service.sent) == sorted(sent), "its own parts and no more, each once"
        bench.service.sent.clear()
    here = compile_scene(read(tmp_path, "moves.glb", moment=Moment(15)))
    settings = RenderSettings(24, 24, View((0, 0, 9), (0, 0, 0)))
    alone = render_batch(here, settings, Tile(0, 0, 24, 24), 0, 2)
    bench.render(RenderBatch("f", "job", 30, ref.sha256, Tile(0, 0, 24, 24), 0, 2, settings))
    result = bench.next("batch", "batch-failed")
    assert result.sums is not None, result.event
    np.testing.assert_array_equal(unpack_sums(result.sums, Tile(0, 0, 24, 24)), alone.sums)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("noise.glb", b"glTF" + bytes(range(256)) * 8, "noise.glb"),
        ("cut.obj", b"v 0 0", "cut.obj"),
        ("wrong.yaml", b"shapes: {{{", "wrong.yaml"),
    ],
)
def test_invalid_scene_gives_error_and_worker_survives(bench: Bench, name: str, content: bytes, sentence: str) -> None:
    before = {slot.pid for slot in slots_of(bench.process.pid)}
    bench.upload(name, {name: content}, name)
    event = bench.prepare(name).event
    assert event["type"] == "prepare-failed"
    assert sentence in event["error"]
    assert "Traceback" not in event["error"]
    assert {slot.pid for slot in slots_of(bench.process.pid)} == before


MD5 = """MD5Version 10
commandline ""

numJoints 1
numMeshes 1

joints {{
 "origin" -1 ( 0 0 0 ) ( 0 0 0 )
}}

mesh {{
 shader "x"
 numverts 3
 vert 0 ( 0 0 ) 0 1
 vert 1 ( 1 0 ) 1 1
 vert 2 ( 0 1 ) 2 1
 numtris 1
 tri 0 0 1 2
 numweights 3
 weight 0 0 1 ( 0 0 0 )
 weight 1 0 1 ( 1 0 0 )
 weight {number} 0 1 ( 0 1 0 )
}}
"""


def test_crashing_importer_gives_error_and_worker_survives(bench: Bench) -> None:
    before = {slot.pid for slot in slots_of(bench.process.pid)}
    bench.upload("md5", {"wild.md5mesh": MD5.format(number=2**32 - 1).encode()}, "wild.md5mesh")
    event = bench.prepare("md5").event
    assert event["type"] == "prepare-failed"
    assert "wild.md5mesh cannot be read: its importer crashed (signal 11" in event["error"]
    assert {slot.pid for slot in slots_of(bench.process.pid)} == before
    bench.upload("md5", {"fine.md5mesh": MD5.format(number=2).encode()}, "fine.md5mesh")
    assert bench.prepare("md5").event["type"] == "prepared"


def test_reader_process_is_confined(bench: Bench, info: SceneInfo) -> None:
    auto = info.cameras[-1]["view"]
    bench.prepare_frames(
        PrepareFrames("one", "job", "ball", [0], info.compiled.sha256, auto)
    )  # its reader stays for further frames
    reader = next(
        child
        for launcher in psutil.Process(bench.process.pid).children()
        if not any(argument.startswith("--slots=") for argument in launcher.cmdline())
        for child in launcher.children()
    )
    environment = Path(f"/proc/{reader.pid}/environ").read_bytes() + Path(f"/proc/{reader.ppid()}/environ").read_bytes()
    assert not [name for name in (b"TOKEN", b"REDIS") if name in environment]
    opened = [str(path.readlink()) for path in Path(f"/proc/{reader.pid}/fd").iterdir()]
    assert all(each.startswith(("/dev/null", "pipe:")) or "/rayfarm-frames-" in each for each in opened), opened
    status = dict(line.split(":", 1) for line in Path(f"/proc/{reader.pid}/status").read_text().splitlines())
    assert (status["NoNewPrivs"].strip(), status["Seccomp"].strip()) == ("1", "2")


def test_batch_of_missing_scene_fails_with_command(bench: Bench, info: SceneInfo) -> None:
    lost = RenderBatch(**{**batch_of(info, "lost", 0, 1).__dict__, "compiled": "0" * 64})
    bench.render(lost)
    event = bench.next("batch", "batch-failed").event
    assert event["type"] == "batch-failed"
    assert "cannot fetch the scene" in event["error"]
    assert event["reproduce"].startswith("rayfarm render SCENE -o batch.exr --size=")


@pytest.mark.long
def test_unreachable_service_returns_scene(bench: Bench, info: SceneInfo, tmp_path: Path) -> None:
    made = scene([emitter(1.0)], (square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0),))
    compiled_file.save(made, tmp_path / "compiled")
    data = (tmp_path / "compiled").read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()
    bench.service.blobs[sha256] = data
    bench.service.away = True
    bench.render(RenderBatch(**{**batch_of(info, "patient", 0, 1).__dict__, "compiled": sha256}))
    wait_until(lambda: busy_with(bench, 1), 30, "a slot has the batch in hand")
    time.sleep(2.0)
    assert bench.store.xlen(RESULTS) == 0
    bench.service.away = False
    event = bench.next("batch", "batch-failed", "batch-returned").event
    assert (event["type"], event["batch"]) == ("batch", "patient"), event


def denoised(bench: Bench, work: DenoiseFrame) -> dict[str, Any]:
    kind = bench.report().kind  # type: ignore[union-attr]
    bench.celery.send_task(DENOISE, kwargs={"frame": work.to_json()}, queue=denoise_queue(kind))
    return bench.next("denoised", "denoise-failed").event


@pytest.mark.long
@pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")
def test_frame_is_denoised_from_film_means(bench: Bench) -> None:
    assert bench.report().denoises  # type: ignore[union-attr]
    random = np.random.default_rng(5)
    truth = np.full((40, 60, 3), 0.5, np.float32)
    noisy = (truth * random.gamma(2, 0.5, truth.shape)).astype(np.float32)
    normal = np.zeros_like(truth)
    normal[..., 2] = 1
    bench.service.films["/api/farm/films/job/0"] = np.stack([noisy, truth, normal]).tobytes()
    event = denoised(bench, DenoiseFrame("first", "job", 0, 60, 40))
    assert event["type"] == "denoised", event
    assert (event["work"], event["version"], event["samples"]) == ("first", "seven", 12)
    clean = np.frombuffer(bench.service.blobs[event["sha256"]], "<f4").reshape(40, 60, 3)
    np.testing.assert_allclose(clean, denoise(noisy, truth, normal), rtol=1e-3, atol=1e-3)
    assert np.abs(clean - truth).mean() < np.abs(noisy - truth).mean() / 4
    again = denoised(bench, DenoiseFrame("again", "job", 0, 60, 40))
    assert again["sha256"] == event["sha256"]
    preview = denoised(bench, DenoiseFrame("preview", "job", 0, 60, 40, is_preview=True))
    quick = np.frombuffer(bench.service.blobs[preview["sha256"]], "<f4").reshape(40, 60, 3)
    np.testing.assert_allclose(quick, denoise_fast(noisy, truth, normal), rtol=1e-3, atol=1e-3)
    assert 0 < preview["seconds"] < 60
    bench.service.films["/api/farm/films/job/0?lights=key%2Crest"] = np.stack([noisy, 2 * noisy, truth, normal]).tobytes()
    lights = denoised(bench, DenoiseFrame("lights", "job", 0, 60, 40, is_preview=True, lights=("key", "rest")))
    rows = np.frombuffer(bench.service.blobs[lights["sha256"]], "<f4").reshape(40, 2, 60, 3)
    np.testing.assert_allclose(rows[:, 0], quick, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(rows[:, 1], denoise_fast(2 * noisy, truth, normal), rtol=1e-3, atol=1e-3)


@pytest.mark.long
@pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")
def test_guide_of_a_worker_equals_that_of_a_local_render(bench: Bench, tmp_path: Path) -> None:
    """The worker fetches the scene, or compiles a frame again; without either the film's albedo is the guide."""
    text = SCENE.replace("kind: diffuse, color: 0.5", "kind: mirror, color: 0.8")
    floor = "  - {type: sphere, center: [0, -51, 0], radius: 50, material: red}\n"
    floor += "materials:\n  red: {kind: diffuse, color: [0.8, 0.1, 0.1]}"
    (tmp_path / "mirror.yaml").write_text(text.replace("materials:", floor))
    bench.upload("mirror", {"mirror.yaml": (tmp_path / "mirror.yaml").read_bytes()}, "mirror.yaml")
    event = bench.prepare("mirror").event
    assert event["type"] == "prepared", event
    made = SceneInfo.from_json(event["info"])
    here = compile_scene(read(tmp_path, "mirror.yaml"))
    settings = RenderSettings(60, 40, View((0, 0, 4), (0, 0, 0)))
    sums = render_frame(here, settings, 4)
    planes = [mean(sums, settings.film_exponent, plane) for plane in (COLOR, ALBEDO, NORMAL)]
    bench.service.films["/api/farm/films/job/0"] = np.stack(planes).tobytes()
    sha256, kind = made.compiled.sha256, bench.report().kind  # type: ignore[union-attr]
    moment = PrepareFrames("", "", "mirror", [0], sha256, made.cameras[-1]["view"])
    guides = [GuideScene(kind, sha256, settings), GuideScene(kind, sha256, settings, moment, "1" * 64)]
    found = []
    for guide in (*guides, GuideScene(kind, "0" * 64, settings), GuideScene("other", sha256, settings), None):
        event = denoised(bench, DenoiseFrame(f"guide {len(found)}", "job", 0, 60, 40, guide=guide))
        assert event["type"] == "denoised", event
        found.append(np.frombuffer(bench.service.blobs[event["sha256"]], "<f4").reshape(40, 60, 3))
    guided, by_film = denoise_still(sums, here, settings), denoise(*planes)
    assert not np.array_equal(guided, by_film)
    for clean, expected in zip(found, [guided, guided, by_film, by_film, by_film], strict=True):
        np.testing.assert_array_equal(clean, expected)


@pytest.mark.long
def test_path_guide_is_trained_once_and_read_by_slots(bench: Bench) -> None:
    """Batches have the bits of a local render, with the stored guide and without."""
    bench.upload("smallpt", {"smallpt.yaml": (ROOT / "scenes" / "smallpt.yaml").read_bytes()}, "smallpt.yaml")
    event = bench.prepare("smallpt").event
    assert event["type"] == "prepared", event
    made, tile = SceneInfo.from_json(event["info"]), Tile(0, 0, 32, 24)
    kind = bench.report().kind  # type: ignore[union-attr]
    view = View(**made.cameras[0]["view"])
    settings = RenderSettings(32, 24, view, max_depth=32, guiding="on")
    for work in ("first", "second"):
        asked = TrainPathGuide(work, "job", 0, kind, made.compiled.sha256, settings)
        bench.celery.send_task(PATH_GUIDE, kwargs={"guide": asked.to_json()}, queue=prepare_queue(kind))
    answers = [bench.next("path-guide-trained", "path-guide-failed", seconds=240).event for _ in range(2)]
    assert {each["type"] for each in answers} == {"path-guide-trained"}, answers
    (sha256,) = {each["sha256"] for each in answers}
    assert read_guide(bench.service.blobs[sha256]) is not None
    here = compile_scene(read(ROOT / "scenes", "smallpt.yaml"))
    expected = render_batch(here, settings, tile, 0, 2).sums
    assert not np.array_equal(expected, render_batch(here, replace(settings, guiding="off"), tile, 0, 2).sums)
    for guide in (sha256, "", "0" * 64):
        bench.render(RenderBatch(f"guided by {guide}", "job", 0, made.compiled.sha256, tile, 0, 2, settings, guide=guide))
        result = bench.next("batch", "batch-failed", seconds=240)
        assert result.sums is not None, result.event
        np.testing.assert_array_equal(unpack_sums(result.sums, tile), expected)


@pytest.mark.long
@pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")
def test_frame_of_a_shot_is_denoised_with_its_neighbours(bench: Bench) -> None:
    """Equal to `stabilised_frame` of the three frames, of which two show the same still."""
    random = np.random.default_rng(6)
    truth, normal = np.full((40, 60, 3), 0.5, np.float32), np.zeros((40, 60, 3), np.float32)
    normal[..., 2] = 1
    motion = np.zeros((40, 60, 4), np.float32)
    sha256 = hashlib.sha256(motion.tobytes()).hexdigest()
    bench.service.blobs[sha256] = motion.tobytes()
    frames, ids = {}, np.ones((2, 40, 60), np.float32)
    for key in (4, 6, 8):
        noisy = (truth * random.gamma(2, 0.5, truth.shape)).astype(np.float32)
        data = b"".join(each.tobytes() for each in (noisy, truth, normal, ids))
        bench.service.films[f"/api/farm/films/job/{key}?ids=true"] = data
        frames[key / 2] = DenoisedFrame(denoise_with_guides(noisy, truth, normal), ids[0], ids[1], motion)
    work = DenoiseFrame("shot", "job", 6, 60, 40, tuple((key, sha256) for key in (4, 6, 8)))
    event = denoised(bench, work)
    assert event["type"] == "denoised", event
    assert (event["version"], event["samples"]) == ("seven+seven+seven", 12)
    clean = np.frombuffer(bench.service.blobs[event["sha256"]], "<f4").reshape(40, 60, 3)
    np.testing.assert_allclose(clean, stabilised_frame(frames, 3.0), rtol=1e-3, atol=1e-3)
    assert np.abs(clean - truth).mean() < np.abs(frames[3.0].clean.color - truth).mean()


@pytest.mark.long
@pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")
def test_view_is_denoised_from_its_means(bench: Bench) -> None:
    kind = bench.report().kind  # type: ignore[union-attr]
    assert bench.report().denoises_views  # type: ignore[union-attr]
    random = np.random.default_rng(5)
    truth = np.full((40, 60, 3), 0.5, np.float32)
    noisy = (truth * random.gamma(2, 0.5, truth.shape)).astype(np.float32)
    bench.service.films["/api/farm/views/there"] = np.stack([noisy, truth, np.zeros_like(truth)]).tobytes()
    bench.store.set(view_key("me"), 3)
    for message, expected in (("there", ["begun", "denoised", "over"]), ("gone", ["begun", "failed"])):
        bench.store.delete(VIEW_ANSWERS)
        work = ViewDenoise(message, "me", 3, 60, 40)
        bench.celery.send_task(DENOISE_VIEW, kwargs={"picture": work.to_json()}, queue=view_queue(kind))
        wait_until(lambda: bench.store.llen(VIEW_ANSWERS) == len(expected), 30, "it is answered")  # noqa: B023
        answers = [ViewAnswer.from_bytes(data) for data in bench.store.lrange(VIEW_ANSWERS, 0, -1)]  # type: ignore[union-attr]
        assert [answer.type for answer in answers] == expected
        if message == "there":
            clean = rgbe9995.unpack(np.frombuffer(answers[1].sums, "<u4").reshape(40, 60))
            assert np.abs(clean - truth).mean() < np.abs(noisy - truth).mean() / 4
        else:
            assert "answers 404" in answers[1].more["error"]


@pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")
def test_failed_denoising_gives_reason(bench: Bench) -> None:
    event = denoised(bench, DenoiseFrame("gone", "nowhere", 0, 60, 40))
    assert event["type"] == "denoise-failed"
    assert "answers 404" in event["error"]
    bench.service.films["/api/farm/films/short/0"] = b"\0" * 400
    event = denoised(bench, DenoiseFrame("short", "short", 0, 60, 40))
    assert "The picture" in event["error"]


def test_paused_worker_takes_no_tasks(bench: Bench, info: SceneInfo) -> None:
    name = bench.report().name  # type: ignore[union-attr]
    bench.store.set(pause_key(name), "Paused by a test.")
    wait_until(lambda: bench.report().state == "paused", 10, "it pauses")  # type: ignore[union-attr]
    bench.render(batch_of(info, "later", 0, 1))
    queue = render_queue(bench.report().kind)  # type: ignore[union-attr]
    time.sleep(1.5)
    assert bench.store.llen(queue) == 1
    bench.store.delete(pause_key(name))
    assert bench.next("batch").event["batch"] == "later"
    assert bench.report().state == "ready"  # type: ignore[union-attr]


def busy_with(bench: Bench, count: int) -> bool:
    report = bench.report()
    return report is not None and any(doing.get("count") == count and "batch" in doing for doing in report.current)


def kill_slots_until_result(bench: Bench, name: str) -> None:
    """Kills each slot of the worker that becomes busy, until the worker has sent a result for the batch with the id `name`.

    Fails if fewer than three slots were killed. There may be more, since a slot that has just started also counts as busy.
    """
    deadline = time.monotonic() + 90
    before: dict[psutil.Process, float] = {}
    killed = 0
    while not any(Result.from_fields(fields).event.get("batch") == name for _, fields in bench.store.xrange(RESULTS)):
        assert time.monotonic() < deadline, f"of {name} nothing is said, though {killed} slots were killed"
        time.sleep(0.05)
        for slot in slots_of(bench.process.pid):
            if processor_time(slot) - before.setdefault(slot, processor_time(slot)) > 0.4:
                slot.kill()
                slot.wait(10)
                killed += 1
                before.clear()
                break
    assert killed >= 3


def test_batch_of_killed_slot_is_rendered_again(bench: Bench, info: SceneInfo) -> None:
    before = processor_times(bench.process.pid)
    bench.render(batch_of(info, "long", 0, 2000))
    wait_until(lambda: busy_with(bench, 2000), 30, "a slot renders the batch")
    victim = rendering_slot(before)
    victim.kill()
    victim.wait(10)
    wait_until(lambda: len(slots_of(bench.process.pid)) == 2, 20, "the slot is filled again")
    event = bench.next("batch", "batch-failed").event
    assert (event["type"], event["batch"]) == ("batch", "long"), event


@pytest.mark.long
def test_batch_that_kills_every_slot_fails(bench: Bench, info: SceneInfo) -> None:
    bench.render(batch_of(info, "deadly", 0, 1 << 20))
    kill_slots_until_result(bench, "deadly")
    event = bench.next("batch", "batch-failed").event
    assert (event["type"], event["batch"]) == ("batch-failed", "deadly"), event
    assert "died 3 times" in event["error"]


@pytest.mark.long
def test_only_killing_batch_of_message_fails(bench: Bench, info: SceneInfo) -> None:
    batches = [batch_of(info, name, 0, count) for name, count in (("before", 1), ("killer", 1 << 20), ("after", 2))]
    bench.celery.send_task(
        RENDER_BATCHES,
        kwargs={"batches": [batch.to_json() for batch in batches]},
        queue=render_queue(info.kind),
        task_id="several",
        ignore_result=True,
    )
    kill_slots_until_result(bench, "killer")
    answered: dict[str, dict[str, Any]] = {}
    while "after" not in answered:
        event = bench.next("batch", "batch-failed").event
        answered[event["batch"]] = event
    kinds = {name: event["type"] for name, event in answered.items()}
    assert kinds == {"before": "batch", "killer": "batch-failed", "after": "batch"}
    assert "died 3 times" in answered["killer"]["error"]


@pytest.mark.long
def test_recalled_message_returns_the_batches_that_are_not_begun(bench: Bench, info: SceneInfo) -> None:
    batches = [batch_of(info, name, 0, 6000) for name in ("one", "two", "three", "four")]
    bench.celery.send_task(
        RENDER_BATCHES,
        kwargs={"batches": [batch.to_json() for batch in batches]},
        queue=render_queue(info.kind),
        task_id="recalled",
        ignore_result=True,
    )
    wait_until(lambda: busy_with(bench, 6000), 30, "a slot renders the first one")
    bench.store.set(recall_key("recalled"), 1, ex=60)
    answered = [bench.next("batch", "batch-failed", "batch-returned").event for _ in batches]
    assert [event["batch"] for event in answered] == ["one", "two", "three", "four"]
    returned = [event for event in answered if event["type"] == "batch-returned"]
    assert {event["type"] for event in answered} == {"batch", "batch-returned"}
    assert answered[-len(returned) :] == returned
    assert all(event["recalled"] for event in returned)


@pytest.mark.long
def test_wrong_token_ends_worker_with_message(bench: Bench) -> None:
    command = [sys.executable, "-m", "worker", f"--service={bench.url}", "--slots=1"]
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, "RAYFARM_TOKEN": "wrong"}, capture_output=True, text=True, timeout=30
    )
    assert done.returncode == 3
    assert "does not know this token" in done.stderr


@pytest.mark.long
def test_slots_end_with_killed_worker(bench: Bench, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "worker", f"--service={bench.url}", "--slots=2", f"--cache={tmp_path}", "--name=victim"]
    process = subprocess.Popen(command, cwd=ROOT, env={**os.environ, "RAYFARM_TOKEN": "token"}, stderr=subprocess.DEVNULL)
    wait_until(lambda: len(slots_of(process.pid)) >= 2, 60, "its slots are there")
    slots = slots_of(process.pid)
    process.send_signal(signal.SIGKILL)
    process.wait()
    wait_until(lambda: not any(slot.is_running() for slot in slots), 20, "its slots have ended")
