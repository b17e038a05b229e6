"""Reads a pbrt-v4 scene."""

from __future__ import annotations

from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers.pbrt.graphics import Graphics
from renderer.scene.readers.pbrt.notes import Notes

__all__ = ["read"]


def read(files: SceneFiles, main: str, description: SceneDescription, moment: Moment = Moment()) -> None:
    """Adds the scene of a pbrt file at a moment to the description. Raises SceneError if the file is invalid."""
    notes = Notes()
    graphics = Graphics(files, description, moment, notes)
    graphics.run(main)
    graphics.end_scene(main)
    if description.moves:
        description.defaults.setdefault("shutter", 1.0)
    notes.add_warnings(description)
