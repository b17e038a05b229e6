"""Renders the thumbnail of a compiled scene."""

from __future__ import annotations

from typing import Any

from renderer import denoise
from renderer.aovs import values
from renderer.confine.reader import Link
from renderer.film import mean
from renderer.image import encode
from renderer.image.darkness import darkness
from renderer.render import render_batch, render_frame
from renderer.settings import RenderSettings, Tile, View
from worker.reading.scene_folder import folder_of, mapped_scene

__all__ = ["render_thumbnail", "thumbnail_settings"]

WIDTH = 256  # pixels
SPP = 16
SECONDS = 0.3  # seconds; passes double in samples, so it may take twice this, and 0.2 s for denoising


def thumbnail_settings(view: dict[str, Any], defaults: dict[str, Any]) -> RenderSettings:
    """Returns the render settings of a thumbnail.

    view: the camera. defaults: settings in the scene's file, of which the aspect ratio is used.
    """
    width, height = defaults.get("width", 16), defaults.get("height", 9)
    small_height = min(max(WIDTH * height // width, 64), 2 * WIDTH)
    return RenderSettings(WIDTH, small_height, View.from_json(view), max_depth=6)


def render_thumbnail(
    base_folder: bytes, compiled: str, view: dict[str, Any], defaults: dict[str, Any], result: bytes, link: Link
) -> dict[str, Any]:
    """Renders a small, denoised and tone-mapped PNG to the file `result`, within a short time limit.

    compiled: hash of the compiled scene in `base_folder`. view, defaults: as for `thumbnail_settings`. link: connection to the
    slot.
    """
    scene = mapped_scene(base_folder, compiled)
    settings = thumbnail_settings(view, defaults)
    render_batch(scene, settings, Tile(0, 0, 0, 0), 0, 0)  # loads the kernel before timing starts
    sums = render_frame(scene, settings, SPP, threads=1, time_limit=SECONDS)
    albedo, normal = (values(sums, settings.film_exponent, name) for name in ("albedo", "normal"))
    picture = denoise.denoise_preview(mean(sums, settings.film_exponent), albedo, normal)
    dark = darkness(picture)  # is exposed by what it shows
    folder_of(result).write_bytes(encode.encode(picture, "png", exposure=dark.exposure if dark else 0.0))
    return {}
