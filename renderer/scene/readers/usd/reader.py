"""Reads a USD stage at a moment."""

from __future__ import annotations

from typing import Any

from pxr import Usd

from renderer.scene.animation import Clip, Moment
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers.name_lookup import number_of
from renderer.scene.readers.usd.layers import Stage, as_scene_errors, muted, open_stage
from renderer.scene.readers.usd.metadata import rate_of
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.placing import DescriptionBuilder
from renderer.scene.readers.usd.prims import PlacedPrim, placed_prims
from renderer.scene.readers.usd.render_settings import time_range
from renderer.scene.readers.usd.sources import Sources
from renderer.scene.readers.usd.textures import Images
from renderer.scene.textures import TextureShelf

__all__ = ["read_stage"]

_CLIP = "animation"


def read_stage(files: SceneFiles, main: str, description: SceneDescription, variant: str | None, moment: Moment) -> None:
    """Adds the stage of a USD file to the description. Raises SceneError if it cannot be read or lacks the variant or clip."""
    shelf = TextureShelf(description, files)
    with as_scene_errors(main), muted():
        sources = files.get_or_make(("usd files", main), lambda: Sources(files))
        stage, variants = files.get_or_make(("usd stage", main, variant), lambda: open_stage(sources, main, variant))
        description.variants = variants
        if stage.color_config is not None:
            shelf.colors.choose(*stage.color_config)
        notes = Notes()
        time = _time(stage, main, description, moment, notes)
        placing = DescriptionBuilder(
            files, (main, variant), stage, description, shelf, Images(stage, sources, shelf, notes), notes, time
        )
        settings = _render_settings(stage.stage)
        placing.add_prims(with_render_camera_first(placed_prims(stage.stage, time, notes), settings))
        for told in (stage.notes, notes):
            told.pass_on(shelf.warn)
        _resolution(settings, description)


def _time(stage: Stage, main: str, description: SceneDescription, moment: Moment, notes: Notes) -> Any:
    """Returns the time code to show, and sets the description's clip and frame rate.

    Frame 0 is the stage's start. Raises SceneError if the moment's clip does not exist.
    """
    root = stage.stage
    rate = rate_of(root, "timeCodesPerSecond", notes)
    span = time_range(stage)
    if span is None:
        if moment.clip is not None:
            number_of("clip", [], moment.clip, main)
        return Usd.TimeCode.EarliestTime()
    start, end = span
    if moment.clip is not None and moment.clip != "all":
        number_of("clip", [_CLIP], moment.clip, main)
    description.clips = [Clip(_CLIP, 0.0, (end - start) / rate)]
    description.moves = True
    fps = rate_of(root, "framesPerSecond", notes)
    if 1e-3 <= fps <= 1e4:
        description.fps = fps
    return Usd.TimeCode(start + moment.seconds(description.fps) * rate)


def _render_settings(root: Any) -> Any:
    """Returns the prim of the stage's render settings, or None if the stage names none."""
    path = root.GetMetadata("renderSettingsPrimPath")
    return (root.GetPrimAtPath(path) or None) if path else None


def with_render_camera_first(found: list[PlacedPrim], settings: Any) -> list[PlacedPrim]:
    """Returns the prims with the render settings' camera first, so that it becomes the default camera."""
    camera = settings.GetRelationship("camera") if settings else None
    chosen = set(camera.GetForwardedTargets()) if camera else set()
    return sorted(found, key=lambda each: each.prim.GetPath() not in chosen) if chosen else found


def _resolution(settings: Any, description: SceneDescription) -> None:
    """Sets the default image size from the stage's render settings, if they have a valid resolution."""
    size = settings.GetAttribute("resolution").Get() if settings else None
    if size is not None and len(size) == 2 and all(16 <= n <= 16384 for n in size):
        description.defaults |= {"width": int(size[0]), "height": int(size[1])}
