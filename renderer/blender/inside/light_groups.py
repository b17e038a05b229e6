"""Light groups of Blender's objects, world and view layers, by names that Rayfarm accepts."""

from __future__ import annotations

import re
from typing import Any

__all__ = ["layer_groups", "light_group_of", "valid_name"]

UNUSABLE = re.compile(r"[^\w -]")  # such as the dot of "Lightgroup.001"
MOST_NAME = 40  # characters; renderer/setting_declaration.py
MAX_GROUPS = 16  # renderer/settings.py


def light_group_of(thing: Any) -> str:
    """Returns the light group of an object or a world; empty for none."""
    return valid_name(getattr(thing, "lightgroup", ""))


def layer_groups(layer: Any) -> str:
    """Returns the light groups of a view layer, for the setting `light_groups`; at most as many as that takes."""
    names = dict.fromkeys(valid_name(group.name) for group in getattr(layer, "lightgroups", ()))
    return ",".join([name for name in names if name not in ("", "rest")][:MAX_GROUPS])


def valid_name(name: Any) -> str:
    """Returns a name as Rayfarm accepts it: other characters are replaced by _, and it is cut to MOST_NAME characters."""
    return UNUSABLE.sub("_", str(name or "")).strip()[:MOST_NAME].strip()
