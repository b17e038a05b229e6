"""Checks whether the images connected to a socket have the encoding that glTF requires: sRGB for colours, linear for numbers."""

from __future__ import annotations

from typing import Any

__all__ = ["has_required_encoding"]

MIN_COLOR_DIFFERENCE = 2 / 255  # least channel difference of a texel that is not grey
CHANNELS = ("SEPARATE_COLOR", "SEPRGB")


def has_required_encoding(entry: Any, node: Any, output: Any) -> bool:
    """Returns True if all images on which an input depends have the encoding that glTF requires for it.

    entry: the input; node, output: the node and its output that are connected to it.
    """
    is_color = entry.type == "RGBA"
    for each, name, is_channel in _image_nodes(node, output):
        image = each.image
        if image is None or image.source == "TILED" or name == "Alpha":
            continue
        is_encoded = image.colorspace_settings.name == "sRGB" and not image.is_float
        if is_color != is_encoded or not (is_color or is_channel or _is_grey(image)):
            return False
    return True


def _image_nodes(node: Any, output: Any) -> list[tuple[Any, str, bool]]:
    """Returns (image node, name of its used output, whether one channel is used) for each image on which an output depends."""
    found, left = [], [(node, output.name, False)]
    while left:
        each, name, is_channel = left.pop()
        if each.type == "TEX_IMAGE":
            found.append((each, name, is_channel))
            continue
        is_channel = is_channel or each.type in CHANNELS
        left += [(link.from_node, link.from_socket.name, is_channel) for entry in each.inputs for link in entry.links]
    return found


def _is_grey(image: Any) -> bool:
    import numpy as np

    if image.channels < 3:
        return True
    texels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(texels)
    colors = texels.reshape(-1, image.channels)[:, :3]
    return not len(colors) or float(np.ptp(colors, axis=1).max()) < MIN_COLOR_DIFFERENCE
