"""Prepare a scene: from untrusted files to a compiled scene, a thumbnail and a summary."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from renderer import denoise
from renderer.aovs import values
from renderer.blender.convert import convert
from renderer.blender.program import find
from renderer.errors import SceneError
from renderer.film import mean
from renderer.image import encode
from renderer.render import edition_for, load_preparing, render_frame, warm_up
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.compiled import CompiledScene
from renderer.scene.kept import Kept
from renderer.scene.load import Shot
from renderer.scene.parts import Saver
from renderer.scene.readers import collada, fbx, gltf, mitsuba, obj, pbrt, ply, stl, yaml  # noqa: F401 - imported before the fork, so that no scene waits for them
from renderer.settings import RenderSettings, View
from worker.exchange.errors import MachineError, WorkError, is_of_machine
from worker.process.context import WorkerContext
from worker.protocol.blends import is_blend
from worker.protocol.contract import BlobRef, Manifest, SceneInfo
from worker.work.bounded import Send, run_bounded
from worker.work.files import memory_budget, place_files
from worker.work.relight import relight
from worker.work.scenes import store, store_scene

__all__ = ["prepare_scene"]

SECONDS = 600.0  # below Celery's task_time_limit
MAX_NAMES = 10_000
LEFT_S = 120.0  # of them, for what Blender wrote
WRITTEN = "written"
THUMBNAIL_WIDTH = 256
THUMBNAIL_SPP = 16
THUMBNAIL_SECONDS = 0.3  # passes double, so that it takes at most about twice this; and 0.2 s to denoise it


def prepare_scene(worker: WorkerContext, manifest: Manifest, progress: Callable[[str, float], None]) -> SceneInfo:
    """Prepare an uploaded scene and store what came of it at the service.

    Raises WorkError with a sentence where the files are no scene; Trouble or RefusedError where the service or this machine
    cannot be used.
    """
    begun = time.monotonic()
    load_preparing()  # here, not in each child: a worker that began with nothing compiled has had them compiled meanwhile
    try:
        if (info := relight(worker, manifest)) is not None:
            return replace(info, seconds=time.monotonic() - begun)
        with tempfile.TemporaryDirectory(prefix="rayfarm-prepare-") as name:
            try:
                summary, compiled, thumbnail = _prepared(worker, manifest, Path(name) / "first", progress)
            except WorkError:
                # Files that have suffered in the cache are no fault of who uploaded them.
                if not [file for file in manifest.files if worker.cache.discard_damaged(file.sha256)]:
                    raise
                summary, compiled, thumbnail = _prepared(worker, manifest, Path(name) / "again", progress)
    except OSError as error:
        if not is_of_machine(error):
            raise
        raise MachineError(f"this machine cannot keep a scene's files ({error.strerror}: {error.filename})") from error
    return SceneInfo(
        kind=worker.kind,
        compiled=compiled,
        thumbnail=thumbnail,
        cameras=summary["cameras"],
        counts=summary["counts"],
        bounds=summary["bounds"],
        animations=summary["animations"],
        variants=summary["variants"],
        warnings=summary["warnings"],
        defaults=summary["defaults"],
        seconds=time.monotonic() - begun,
        fps=summary.get("fps", 24.0),
        clips=summary.get("clips", []),
        lights_power=summary.get("lights_power"),
        blend=summary.get("blend"),
        names={kind: summary.get(kind, [])[:MAX_NAMES] for kind in ("objects", "materials")},
    )


def _prepared(
    worker: WorkerContext, manifest: Manifest, room: Path, progress: Callable[[str, float], None]
) -> tuple[dict[str, Any], BlobRef, BlobRef | None]:
    """The summary, and what was stored: the compiled scene and its thumbnail. room: a folder to work in."""
    folder = room / "scene"
    out = room / "out"
    out.mkdir(parents=True)
    progress("fetching files", 0.0)
    place_files(worker, manifest, folder)
    summary = run_bounded(
        lambda send: _work(folder, manifest, out, send),
        lambda message: progress(message["step"], message["fraction"]),
        memory_bytes=memory_budget(),
        seconds=SECONDS,
        faults=(SceneError,),
        subject=manifest.main,
    )
    progress("storing", 0.95)
    compiled = store_scene(worker, out / summary["compiled"])
    if written := summary.get("written"):
        files = [replace(store(worker, out / WRITTEN / name), path=name) for name in written]
        summary["blend"] = {"main": written[0], "files": [asdict(file) for file in files]}
    thumbnail: BlobRef | None = None
    if (out / "thumbnail.png").is_file():
        thumbnail = store(worker, out / "thumbnail.png")
    return summary, compiled, thumbnail


def _work(folder: Path, manifest: Manifest, out: Path, send: Send) -> dict[str, Any]:
    """In the bounded child: read, compile, save, and take a small picture."""

    def progress(step: str, fraction: float) -> None:
        send({"step": step, "fraction": fraction})

    main, written = manifest.main, list[str]()
    if is_blend(main):
        progress("opening in Blender", 0.02)
        folder, written = _opened(folder, manifest, out / WRITTEN)
        main = written[0]
    progress("reading", 0.05)
    shot = Shot(folder, main, manifest.environment, manifest.variant)
    description = shot.at(Moment(shot.start))
    kept = Kept()
    compiled = compile_scene(description, lambda step, fraction: progress(step, 0.3 + 0.5 * fraction), kept=kept)
    summary = summarise(description, compiled)
    summary["lights_power"], summary["written"] = kept.lights_power, written
    assert kept.cuts is not None
    summary["compiled"] = Saver(out).save(compiled, kept.cuts).name  # other moments, and other lights, share most of it
    progress("rendering a thumbnail", 0.85)
    _thumbnail(compiled, summary, out / "thumbnail.png")
    return summary


def _opened(folder: Path, manifest: Manifest, written: Path) -> tuple[Path, list[str]]:
    """What Blender wrote of a scene: the folder that it lies in, with what lights it beside, and its files, the main one first.

    Raises SceneError.
    """
    blender = find()
    if blender is None:
        raise SceneError(f"{manifest.main}: this worker has no Blender any more; start it anew with --blender")
    written.mkdir()
    main = convert(blender, folder, manifest.main, written, memory_budget(), SECONDS - LEFT_S)
    files = [main, *sorted(path.name for path in written.iterdir() if path.name != main)]
    if manifest.environment is not None and (folder / manifest.environment).is_file():
        light = written / manifest.environment
        light.parent.mkdir(parents=True, exist_ok=True)
        os.link(folder / manifest.environment, light)
    return written, files


def _thumbnail(compiled: CompiledScene, summary: dict[str, Any], path: Path) -> None:
    """A small tone-mapped picture from the first camera: of the samples that a short time gives, without most of their noise."""
    defaults = summary["defaults"]
    width, height = defaults.get("width", 16), defaults.get("height", 9)
    small_height = min(max(THUMBNAIL_WIDTH * height // width, 64), 2 * THUMBNAIL_WIDTH)
    view = View.from_json(summary["cameras"][0]["view"])
    settings = RenderSettings(THUMBNAIL_WIDTH, small_height, view, max_depth=6)
    warm_up(settings, edition_for(settings, compiled), prepares=False)  # where slots want the same kernel now, one compiles it
    sums = render_frame(compiled, settings, THUMBNAIL_SPP, threads=1, time_limit=THUMBNAIL_SECONDS)
    albedo, normal = (values(sums, settings.film_exponent, name) for name in ("albedo", "normal"))
    encode.write(path, denoise.for_a_glance(mean(sums, settings.film_exponent), albedo, normal))
