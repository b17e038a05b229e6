"""Light groups of Blender's objects, world and view layers, by names that Rayfarm accepts."""

from __future__ import annotations

import re
from typing import Any

__all__ = ["layer_groups", "light_group_of"]

UNUSABLE = re.compile(r"[^\w -]")  # such as the dot of "Lightgroup.001"
MOST_NAME = 40  # characters; renderer/setting_declaration.py
MOST = 16  # renderer/settings.py


def light_group_of(thing: Any) -> str:
    """Returns the light group of an object or a world; empty for none."""
    return _usable(getattr(thing, "lightgroup", ""))


def layer_groups(layer: Any) -> str:
    """Returns the light groups of a view layer, for the setting `light_groups`; at most as many as that takes."""
    names = dict.fromkeys(_usable(group.name) for group in getattr(layer, "lightgroups", ()))
    return ",".join([name for name in names if name not in ("", "rest")][:MOST])


def _usable(name: Any) -> str:
    return UNUSABLE.sub("_", str(name or "")).strip()[:MOST_NAME].strip()
