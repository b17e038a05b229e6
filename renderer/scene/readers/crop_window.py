"""Renders a part of the film, as a view with a narrower field and a shifted lens."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

__all__ = ["Window", "cropped"]


class Window(NamedTuple):
    """The rectangle of film pixels to render. x, y: its upper left corner."""

    x: int
    y: int
    width: int
    height: int


def cropped(fields: dict[str, Any], film: tuple[int, int], window: Window) -> dict[str, Any]:
    """Returns the camera fields for rendering only a window of the film; the fields of a panorama are unchanged.

    film: (width, height) of the whole film, in pixels.
    """
    if fields.get("projection") == "panorama" or window == Window(0, 0, *film):
        return fields
    width, height = film
    made = dict(fields)
    share = window.height / height
    if "fov" in fields:
        half = math.tan(math.radians(fields["fov"]) / 2) * share
        made["fov"] = min(max(math.degrees(2 * math.atan(half)), 0.01), 179.0)
    if "height" in fields:
        made["height"] = fields["height"] * share
    # In pixels of the film; shifts are in heights of the whole image.
    right = window.x + window.width / 2 - width / 2
    down = window.y + window.height / 2 - height / 2
    made["shift_x"] = (fields.get("shift_x", 0.0) * height + right) / window.height
    made["shift_y"] = (fields.get("shift_y", 0.0) * height - down) / window.height
    return made
