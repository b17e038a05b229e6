"""Reads pbrt's hair material."""

from __future__ import annotations

import math
from dataclasses import replace

from renderer.scene.description import Material
from renderer.scene.readers.fibres import BROWN, fibre
from renderer.scene.readers.number_ranges import unit_color
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.scene.readers.pbrt.textures import Textures

__all__ = ["hair"]


def hair(source: Parameters, textures: Textures) -> Material:
    """Returns a `hair` material: of its sigma_a, else of its colour, else of its pigments, as pbrt does."""
    along, around = (textures.one_number(source, name, 0.3) for name in ("beta_m", "beta_n"))
    tilt, ior = math.radians(textures.one_number(source, "alpha", 2.0)), textures.one_number(source, "eta", 1.55)
    source.used.update(("sigma_a", "color", "reflectance", "eumelanin", "pheomelanin"))
    absorbed = textures.index(source, "sigma_a")
    if absorbed is not None:
        return fibre(along, around, tilt, ior, textures.colors.numbers(absorbed))
    for name in ("color", "reflectance"):
        if source.get(name) is not None:
            color = textures.color(source, name, (0.5,) * 3)
            made = fibre(along, around, tilt, ior)
            return replace(made, base_color=unit_color(color.value), base_color_texture=color.texture)
    brown, red = (textures.one_number(source, name, 0.0) for name in ("eumelanin", "pheomelanin"))
    if source.get("eumelanin") is None and source.get("pheomelanin") is None:
        brown = BROWN
    return fibre(along, around, tilt, ior, eumelanin=brown, pheomelanin=red)
