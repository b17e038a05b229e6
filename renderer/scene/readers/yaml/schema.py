"""What a scene file may hold: schema.json, and in it the settings and the lens as renderer/settings.py declares them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from renderer.setting_declaration import Declared
from renderer.settings import OPTIONAL, SETTINGS, VIEW
from renderer.work import WORK

__all__ = ["SCENE_SETTINGS", "filled_in", "schema"]

# What a scene file may ask for, in the order in which its documentation has them.
SCENE_SETTINGS: Mapping[str, Declared] = {
    **{name: SETTINGS[name] for name in ("width", "height")},
    "spp": WORK["spp"],
    **{name: SETTINGS[name] for name in OPTIONAL},
}
# Those of a camera that a file writes as the renderer takes them.
_LENS = ("projection", "fov", "height", "aperture", "near", "shift_x", "shift_y")


def filled_in(document: dict[str, Any], settings: Mapping[str, Declared] = SCENE_SETTINGS) -> dict[str, Any]:
    """The schema with these settings in place of those that it has; all else in it stays."""
    document["properties"]["settings"]["properties"] = {name: each.json_schema() for name, each in settings.items()}
    document["$defs"]["camera"]["properties"] |= {name: VIEW[name].json_schema() for name in _LENS}
    return document


def schema() -> dict[str, Any]:
    """The schema that scene files are held to."""
    return filled_in(json.loads(files("renderer.scene").joinpath("schema.json").read_text()))
