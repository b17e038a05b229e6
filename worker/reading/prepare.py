"""Reads and compiles a scene, saves it in parts, and renders a thumbnail."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from protocol.contract import Manifest
from protocol.mesh import Mesh, encode_mesh
from renderer import denoise
from renderer.aovs import values
from renderer.confine.reader import Link
from renderer.film import mean
from renderer.image import encode
from renderer.image.darkness import darkness
from renderer.render import edition_for, render_batch, render_frame
from renderer.scene.animation import Moment
from renderer.scene.compile import camera_dicts, compile_scene, summarise
from renderer.scene.compiled import CompiledScene
from renderer.scene.compiled_parts import Saver
from renderer.scene.description import SceneDescription
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.load import Shot
from renderer.scene.preview import preview
from renderer.sentences import Sentence
from renderer.settings import RenderSettings, Tile, View
from worker.reading.scene_folder import folder_of

__all__ = ["PREVIEW", "THUMBNAIL", "THUMBNAIL_WIDTH", "prepare"]

PREVIEW = "preview.mesh"
THUMBNAIL = "thumbnail.png"
THUMBNAIL_WIDTH = 256
THUMBNAIL_SPP = 16
THUMBNAIL_SECONDS = 0.3  # seconds; passes double in samples, so it may take twice this, and 0.2 s for denoising


def prepare(folder: bytes, manifest: Manifest, out: bytes, link: Link) -> dict[str, Any]:
    """The scene's summary, with the name of its compiled manifest in `out` as `compiled`. Raises RayfarmError."""

    def progress(step: str, fraction: float) -> None:
        link.send({"step": step, "fraction": fraction})

    progress("reading", 0.05)
    shot = Shot(folder_of(folder), manifest.main, manifest.environment, manifest.variant)
    description = shot.at(Moment(shot.start))
    if (shown := draw_preview(description, folder_of(out) / PREVIEW)) is not None:
        link.send({"step": "reading", "fraction": 0.3, "preview": shown})
    kept = ShotCache()
    compiled = compile_scene(description, lambda step, fraction: progress(step, 0.3 + 0.5 * fraction), kept=kept)
    summary = summarise(description, compiled)
    summary["lights_power"] = kept.lights_power
    assert kept.cuts is not None
    summary["compiled"] = Saver(folder_of(out)).save(compiled, kept.cuts).name  # shares parts with other frames
    progress(Sentence("progress-thumbnail", "rendering a thumbnail"), 0.85)
    render_thumbnail(compiled, summary, link, folder_of(out) / THUMBNAIL)
    return summary


def draw_preview(description: SceneDescription, path: Path) -> dict[str, Any] | None:
    """Writes the preview mesh; returns the scene's cameras, bounds and defaults, None if nothing is to be seen."""
    mesh = preview(description)
    if mesh is None:
        return None
    path.write_bytes(encode_mesh(Mesh(*mesh)))
    bounds = np.stack([mesh.positions.min(axis=0), mesh.positions.max(axis=0)])
    cameras = camera_dicts(description, bounds, mesh.positions)
    return {"cameras": cameras, "bounds": bounds.tolist(), "defaults": dict(description.defaults)}


def render_thumbnail(compiled: CompiledScene, summary: dict[str, Any], link: Link, path: Path) -> None:
    """Renders a small tone-mapped picture from the first camera with as many samples as fit a short time, denoised.

    The slot makes the kernel ready first, since a reader cannot store a kernel that it compiles.
    """
    defaults = summary["defaults"]
    width, height = defaults.get("width", 16), defaults.get("height", 9)
    small_height = min(max(THUMBNAIL_WIDTH * height // width, 64), 2 * THUMBNAIL_WIDTH)
    view = View.from_json(summary["cameras"][0]["view"])
    settings = RenderSettings(THUMBNAIL_WIDTH, small_height, view, max_depth=6)
    link.call("warm_up", edition=edition_for(settings, compiled))
    render_batch(compiled, settings, Tile(0, 0, 0, 0), 0, 0)  # loads the kernel before timing starts
    sums = render_frame(compiled, settings, THUMBNAIL_SPP, threads=1, time_limit=THUMBNAIL_SECONDS)
    albedo, normal = (values(sums, settings.film_exponent, name) for name in ("albedo", "normal"))
    picture = denoise.denoise_preview(mean(sums, settings.film_exponent), albedo, normal)
    dark = darkness(picture)  # is exposed by what it shows
    path.write_bytes(encode.encode(picture, "png", exposure=dark.exposure if dark else 0.0))
