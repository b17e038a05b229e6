"""Converts pbrt's hair material to a glossy surface of the hair's colour."""

from __future__ import annotations

from dataclasses import replace

from renderer.scene.description import Material
from renderer.scene.readers.fibres import BROWN, color_of, fibre, pigments
from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.scene.readers.pbrt.textures import Textures, Varying
from renderer.sentences import Sentence

__all__ = ["hair"]


def hair(source: Parameters, textures: Textures, notes: Notes) -> Material:
    """Returns the material that replaces a `hair` material; adds a note."""
    notes.add(
        source.place,
        Sentence(
            "pbrt-hair-replaced",
            "hair is rendered as a glossy surface in its colour: its fibres transmit no light",
        ),
    )
    along, around = (textures.one_number(source, name, 0.3) for name in ("beta_m", "beta_n"))
    source.used.update(("alpha", "sigma_a", "color", "reflectance", "eumelanin", "pheomelanin"))
    color = _color(source, textures, around)
    made = fibre(color.value, along, textures.one_number(source, "eta", 1.55))
    return replace(made, base_color_texture=color.texture)


def _color(source: Parameters, textures: Textures, beta: float) -> Varying:
    absorbed = textures.index(source, "sigma_a")
    if absorbed is not None:
        return Varying(color_of(textures.colors.numbers(absorbed), beta))
    for name in ("color", "reflectance"):
        if source.get(name) is not None:
            return textures.color(source, name, (0.5,) * 3)
    brown, red = (textures.one_number(source, name, 0.0) for name in ("eumelanin", "pheomelanin"))
    if source.get("eumelanin") is None and source.get("pheomelanin") is None:
        brown = BROWN
    return Varying(color_of(pigments(brown, red), beta))
