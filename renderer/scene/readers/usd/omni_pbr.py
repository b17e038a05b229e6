"""Reads Omniverse's OmniPBR, an MDL surface, from files without a UsdPreviewSurface.

Source: NVIDIA's documentation of OmniPBR, also for the default values.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from renderer.scene.description import UvTransform
from renderer.scene.readers.usd.inputs import Input
from renderer.scene.readers.usd.network import Network
from renderer.scene.readers.usd.preview_surface import (
    Read,
    fill_base,
    fill_data,
    fill_emission,
    fill_normal,
    fill_opacity,
    fill_roughness,
)
from renderer.scene.readers.usd.textures import TextureInput, transform_2d
from renderer.sentences import Sentence

__all__ = ["NAMES", "read_omni_pbr"]

NAMES = ("OmniPBR", "OmniPBR_Opacity", "OmniPBR_ClearCoat")
_REPEAT = ("repeat", "repeat")


def read_omni_pbr(shader: Any, read: Read) -> None:
    """Fills the material from an OmniPBR shader."""
    network, material = read.network, read.material
    said = _ShaderInputs(shader, network)
    base = said.texture("diffuse_texture", srgb=True)
    tint = said.value("diffuse_tint").color((1.0, 1.0, 1.0))
    color = Input(said.value("diffuse_color_constant").color((0.2, 0.2, 0.2)))
    if base is not None:
        color = Input(None, replace(base, scale=(*tint, 1.0)))
    fill_base(read, color, (0.2, 0.2, 0.2))
    packed = said.texture("ORM_texture") if said.number("enable_ORM_texture", 0.0) else None
    rough = Input(said.number("reflection_roughness_constant", 0.5))
    metal = Input(said.number("metallic_constant", 0.0))
    if packed is not None:
        rough, metal = (Input(None, replace(packed, channel=channel)) for channel in "gb")
    elif said.number("reflection_roughness_texture_influence", 0.0) > 0:
        rough = said.texture_or_constant("reflectionroughness_texture", rough)
    if packed is None and said.number("metallic_texture_influence", 0.0) > 0:
        metal = said.texture_or_constant("metallic_texture", metal)
    fill_roughness(read, rough, 0.5, metal, 0.0)
    material.specular = min(max(2 * said.number("specular_level", 0.5), 0.0), 1.0)
    if said.number("enable_clearcoat", 0.0):
        fill_data(read, "clearcoat", Input(said.number("clearcoat_weight", 1.0)), 1.0)
        fill_data(read, "clearcoat_roughness", Input(said.number("clearcoat_reflection_roughness", 0.0)), 0.0)
    bumps = said.texture("normalmap_texture")
    if bumps is not None:
        fill_normal(read, "normal", Input(None, bumps))
        material.normal_scale *= said.number("bump_factor", 1.0)
    if said.number("enable_emission", 0.0):
        glow = Input(said.value("emissive_color").color((1.0, 0.1, 0.1)))
        fill_emission(read, glow, said.number("emissive_intensity", 40.0))
    if said.number("enable_opacity", 0.0):
        opacity = said.texture_or_constant("opacity_texture", Input(said.number("opacity_constant", 1.0)))
        fill_opacity(read, opacity, said.number("opacity_threshold", 0.0), color.taken)


class _ShaderInputs:
    """The inputs of an OmniPBR shader by name; all its textures share one UV transform."""

    def __init__(self, shader: Any, network: Network) -> None:
        self._shader, self._network = shader, network
        scale, move = (
            self.value(name).value or default for name, default in (("texture_scale", (1, 1)), ("texture_translate", (0, 0)))
        )
        turn = math.fmod(self.number("texture_rotate", 0.0), 360.0)
        self._transform: UvTransform = transform_2d((float(scale[0]), float(scale[1])), turn, (float(move[0]), float(move[1])))

    def value(self, name: str) -> Input:
        """Returns an input of the shader."""
        return self._network.input(self._shader, name)

    def number(self, name: str, default: float) -> float:
        """Returns an input as a number, where true counts as 1; the default if the input is not set."""
        return self.value(name).number(default)

    def texture(self, name: str, srgb: bool = False) -> TextureInput | None:
        """Returns the texture that an input names; None if the input is empty or the file is missing."""
        network, given = self._network, self._shader.GetInput(name)
        found: list[Any] = given.GetValueProducingAttributes() if given else []
        image = (
            network.images.find(found[0], Sentence("label-material", "Material {name}", name=network.user), srgb, network.time)
            if found
            else None
        )
        if image is None:
            return None
        texture = network.images.texture(image[0], _REPEAT, network.uv_set("st"), self._transform, network.user)
        return None if texture is None else TextureInput(texture)

    def texture_or_constant(self, name: str, constant: Input) -> Input:
        """Returns the red channel of an input's texture; the constant if the input has no texture."""
        found = self.texture(name)
        return constant if found is None else Input(None, replace(found, channel="r"))
