"""Reads displacement from UsdPreviewSurface's and MaterialX's displacement inputs: heights along the normals.

Heights are lengths in the mesh's object space, before its scale. renderer/scene/displacement/ moves the surfaces.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.scene.description import Image
from renderer.scene.readers.linear_images import alpha, linear
from renderer.scene.readers.usd.preview_surface import Read
from renderer.scene.readers.usd.textures import CHANNELS, TextureInput
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["read_displacement"]

_MATERIALX = ("ND_displacement_float", "ND_displacement_displacementshader")  # node kinds in stages, in MaterialX documents
_PREVIEW = "UsdPreviewSurface"
_LEFT_OUT = Sentence("usd-displacement-dropped", "Displacement that is not by a texture is left out")


def read_displacement(material: Any, surface: Any, read: Read) -> None:
    """Sets the displacement of the Material that is being read, if it is by a texture.

    Adds a note if displacement is left out.
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
        return
    else:
        return
    given = network.input(shader, "displacement")
    if given.taken is None or scale == 0:
        if given.primvar is not None or given.number(0.0) != 0:
            network.notes.add(_LEFT_OUT, network.user)
        return
    channel = "r" if given.taken.channel == "rgb" else given.taken.channel
    gain, bias = given.taken.span(channel)
    if gain == 0:
        return
    read.material.displacement_texture = _single_channel_texture(read.shelf, given.taken, channel)
    read.material.displacement_scale, read.material.displacement_midlevel = scale * gain, -bias / gain


def _single_channel_texture(shelf: TextureShelf, texture_input: TextureInput, channel: str) -> int | None:
    """Returns a texture whose three colour channels hold the linear values of one channel of another texture."""

    def select_channel(image: Image) -> Image:
        values = linear(image)[..., CHANNELS[channel]] if channel != "a" else alpha(image)
        return Image(f"{image.name} {channel}", np.repeat(values[..., None], 3, axis=2).astype(np.float32), srgb=False)

    return shelf.derived_texture(texture_input.texture, f"heights in {channel}", select_channel)
