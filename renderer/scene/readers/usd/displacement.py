"""Displacement as bump maps, from UsdPreviewSurface's and MaterialX's displacement inputs: heights along the normals.

The geometry is not displaced. Heights are lengths in the mesh's object space, before its scale.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.scene.description import Image
from renderer.scene.readers.linear_images import alpha, linear
from renderer.scene.readers.usd.preview_surface import Read
from renderer.scene.readers.usd.textures import CHANNELS, TextureInput
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["Heights", "heights_of"]

_MATERIALX = ("ND_displacement_float", "ND_displacement_displacementshader")  # node kinds in stages, in MaterialX documents
_PREVIEW = "UsdPreviewSurface"
_AS_BUMPS = Sentence("usd-displacement-as-bumps", "Displacement is shown as bumps, which do not move the surface")
_LEFT_OUT = Sentence("usd-displacement-dropped", "Displacement is not supported and left out")


class Heights(NamedTuple):
    """A displacement's height map: a texture with heights in its red channel, and the height that the value 1 represents."""

    texture: int
    rise: float


def heights_of(material: Any, surface: Any, read: Read) -> Heights | None:
    """Returns the height texture of a material's surface; None if the displacement is zero, constant or unsupported.

    Adds a note if displacement is dropped or rendered as a bump map.
    """
    network, scale = read.network, 1.0
    shader = next((found for context in ("mtlx", "") if (found := material.ComputeDisplacementSource(context)[0])), None)
    kind = str(shader.GetIdAttr().Get() or "") if shader else ""
    if kind in _MATERIALX:
        scale = network.input(shader, "scale").number(1.0)
    elif str(surface.GetIdAttr().Get() or "") in (_PREVIEW, f"ND_{_PREVIEW}_surfaceshader"):
        shader = surface
    elif shader:
        network.notes.add(_LEFT_OUT, network.user)
        return None
    else:
        return None
    given = network.input(shader, "displacement")
    if given.taken is None or scale == 0:
        if given.primvar is not None or given.number(0.0) != 0:
            network.notes.add(_LEFT_OUT, network.user)
        return None
    if read.material.normal_texture is not None:
        network.notes.add(
            Sentence("usd-displacement-with-normal-map", "Displacement is left out of materials with a normal map"),
            network.user,
        )
        return None
    channel = "r" if given.taken.channel == "rgb" else given.taken.channel
    texture = _single_channel_texture(read.shelf, given.taken, channel)
    if texture is None:
        return None
    network.notes.add(_AS_BUMPS, network.user)
    return Heights(texture, scale * given.taken.span(channel)[0])


def _single_channel_texture(shelf: TextureShelf, texture_input: TextureInput, channel: str) -> int | None:
    """Returns a texture whose three colour channels hold the linear values of one channel of another texture."""

    def select_channel(image: Image) -> Image:
        values = linear(image)[..., CHANNELS[channel]] if channel != "a" else alpha(image)
        return Image(f"{image.name} {channel}", np.repeat(values[..., None], 3, axis=2).astype(np.float32), srgb=False)

    return shelf.derived_texture(texture_input.texture, f"heights in {channel}", select_channel)
