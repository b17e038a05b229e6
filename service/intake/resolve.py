"""Resolves a request and its scene to the settings that determine every sample of a job."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

from renderer.cameras import camera_number
from renderer.errors import SettingsError
from renderer.sentences import Sentence, joined_sentences
from renderer.settings import ENVIRONMENT, RenderSettings, View, check_light_groups, chosen
from renderer.work import DEFAULT_SIZE, most_samples
from service.intake.picture import picture_hash
from service.shot import Shot
from service.store.models import Job, Scene

__all__ = ["check_pixel_count", "default_tile_size", "frame_settings", "refusal", "refuse_warnings", "resolve"]

LIGHT_WARNINGS = {"scene-without-light", "scene-lights-weak"}  # codes of warnings that an environment makes void
MAX_TILES = 1 << 17  # each takes hundreds of bytes of the engine's memory while the job is rendered


def default_tile_size(width: int, height: int, of_shot: bool = False) -> int:
    """Returns the tile size in pixels for an image: small enough that tiles occupy all slots, large enough for few batches.

    An image has about 16 to 200 tiles. The size depends only on the image's size, since noise is judged per tile.
    of_shot: larger tiles, since other frames of the shot occupy the slots too.
    """
    pixels = width * height
    if of_shot:
        return 512 if pixels <= 1280 * 720 else 256
    return 32 if pixels <= 128 * 128 else 64 if pixels <= 256 * 256 else 128 if pixels <= 2200 * 1300 else 256


def check_pixel_count(width: int, height: int, max_pixels: int) -> None:
    """Raises SettingsError if a frame has more than `max_pixels` pixels."""
    if width * height > max_pixels:
        raise SettingsError(
            Sentence(
                "frame-pixels-too-many",
                "width x height is {pixels} pixels; at most {most} are allowed",
                pixels=width * height,
                most=max_pixels,
            ),
            field="width",
        )


def resolve(job: Job, scene: Scene, max_pixels: int) -> None:
    """Sets a job's settings, sample count, tile size and picture key from its request and scene.

    A still image with an open shutter becomes a shot of one frame; views vary as the scene file says unless the request says how.
    max_pixels: limit of width * height.
    Raises SettingsError if the request does not fit the scene.
    """
    request = job.request
    info = scene.info or {}
    defaults: dict[str, Any] = info.get("defaults") or {}
    if request.get("strict"):
        refuse_warnings([*scene.notes, *info.get("warnings", [])], request)
    width, height = _size(request, defaults)
    check_pixel_count(width, height, max_pixels)
    settings = _settings(request, width, height, _resolved_view(request, info.get("cameras") or []), defaults)
    groups = (info.get("names") or {}).get("light_groups")
    if groups is not None:  # None: the scene was prepared by an older release
        check_light_groups(settings.light_groups, groups)
    job.spp = most_samples(job.spp, job.noise, job.seconds, defaults)
    tile_size = job.tile_size or default_tile_size(width, height, job.shot is not None and job.noise is None)
    job.tile_size = tile_size
    tiles = -(-width // tile_size) * -(-height // tile_size)
    if tiles > MAX_TILES:
        raise SettingsError(
            Sentence(
                "tiles-too-many",
                "tile_size is {tile_size}, which makes {tiles} tiles per frame; at most {most} are allowed: give "
                "a larger tile_size",
                tile_size=job.tile_size,
                tiles=tiles,
                most=MAX_TILES,
            ),
            field="tile_size",
        )
    if job.shot is not None and request.get("views") and request.get("vary") is None and info.get("vary"):
        job.shot = {**job.shot, "vary": info["vary"]}
    if settings.shutter and job.shot is None:
        job.shot = Shot().to_json()  # of one frame: moving objects are compiled with their keyframes
    job.settings = settings.to_json()
    job.picture = picture_hash(job)


def refuse_warnings(warnings: Sequence[str], request: dict[str, Any]) -> None:
    """Raises SettingsError that lists all warnings of a scene, if there are any. For strict jobs.

    The warning about missing lights is ignored if the request sets an environment.
    """
    relevant = [each for each in warnings if not (request.get("environment") and Sentence.from_text(each).code in LIGHT_WARNINGS)]
    if relevant:
        raise SettingsError(refusal(relevant), field="strict")


def refusal(warnings: Sequence[str]) -> str:
    """Returns the message that a strict scene or job fails because of these warnings, without the final full stop."""
    listed = reduce(joined_sentences, warnings).rstrip(".")
    if len(warnings) == 1:
        return Sentence("strict-scene-warning", "strict turns the scene's warning into an error: {warning}", warning=listed)
    return Sentence(
        "strict-scene-warnings",
        "strict turns the scene's {count} warnings into errors: {warnings}",
        count=len(warnings),
        warnings=listed,
    )


def frame_settings(
    request: dict[str, Any],
    of_job: RenderSettings,
    view: dict[str, Any],
    defaults: dict[str, Any],
    views: Sequence[dict[str, Any]] = (),
) -> RenderSettings:
    """Returns the settings that determine every sample of one frame. Raises SettingsError.

    view: the frame's camera. defaults, views: the scene's settings and cameras at the frame's time.
    """
    seen = tuple(map(View.from_json, views))
    return _settings(request, of_job.width, of_job.height, View.from_json(view), defaults, seen)


def _settings(
    request: dict[str, Any], width: int, height: int, view: View, defaults: dict[str, Any], views: tuple[View, ...] = ()
) -> RenderSettings:
    environment: dict[str, Any] = request.get("environment") or {}
    return RenderSettings(
        width=width,
        height=height,
        view=view,
        views=views,
        **{each.name: environment[name] for name, each in ENVIRONMENT.items() if environment.get(name) is not None},
        **chosen(request, defaults),
    )


def _size(request: dict[str, Any], defaults: dict[str, Any]) -> tuple[int, int]:
    """Returns width and height in pixels. If the request sets only one, the other follows from the scene's aspect ratio."""
    own = (int(defaults.get("width") or DEFAULT_SIZE[0]), int(defaults.get("height") or DEFAULT_SIZE[1]))
    width, height = request.get("width"), request.get("height")
    if width and height:
        return width, height
    if width:
        return width, max(1, round(width * own[1] / own[0]))
    if height:
        return max(1, round(height * own[0] / own[1])), height
    return own


def _resolved_view(request: dict[str, Any], cameras: list[dict[str, Any]]) -> View:
    wanted = request["views"][0] if request.get("views") else request.get("view")
    if wanted is None:
        number = camera_number([camera["name"] for camera in cameras], request.get("camera"))
        wanted = cameras[number]["view"]
    return View.from_json({name: value for name, value in wanted.items() if value is not None})
