"""Subsurface scattering of MaterialX surfaces, and media inside their glass.

Sources: Autodesk's Standard Surface 1.0.1; OpenPBR 1.1, "subsurface" and "translucent base".
"""

from __future__ import annotations

from typing import NamedTuple

from renderer.scene.description import Vec3
from renderer.scene.material import MOST_DENSE, MOST_FORWARD
from renderer.scene.readers.number_ranges import clamped, unit, unit_color
from renderer.scene.readers.scattering import attenuating_medium, interior_fields
from renderer.scene.readers.usd.inputs import Input
from renderer.scene.readers.usd.preview_surface import Read
from renderer.scene.readers.usd.surface_inputs import SurfaceInputs
from renderer.scene.readers.usd.textures import colored
from renderer.sentences import Sentence

__all__ = ["OPEN_PBR", "STANDARD", "Names", "fill_glass", "fill_subsurface", "mixed_color"]

_WHITE: Vec3 = (1.0, 1.0, 1.0)


class Names(NamedTuple):
    """The names of a surface shader's inputs for subsurface scattering, and how the shader treats them.

    path: default of the subsurface radius, per channel; turns_back: whether thin sheets also scatter light back.
    """

    weight: str
    radius: str
    scale: str
    anisotropy: str
    path: Vec3
    turns_back: bool


STANDARD = Names("subsurface", "subsurface_radius", "subsurface_scale", "subsurface_anisotropy", _WHITE, False)
OPEN_PBR = Names(
    *("subsurface_weight", "subsurface_radius_scale", "subsurface_radius", "subsurface_scatter_anisotropy"),
    path=(1.0, 0.5, 0.25),
    turns_back=True,
)


def mixed_color(inputs: SurfaceInputs, read: Read, names: Names, weight: float, default: Vec3) -> tuple[Input, float]:
    """Returns the colour, and its weight, that replaces base colour and subsurface colour; a material has one for both.

    The two are mixed if both are constant. If either is textured, the one with the larger weight is used, with a note.
    weight, default: of the base colour.
    """
    color, share = inputs("base_color", True), unit(inputs.number(names.weight, 0.0))
    if share <= 0 or _is_sheet(inputs):
        return color, weight
    under = inputs("subsurface_color", True)
    if not _varies(color) and not _varies(under):
        pairs = zip(color.color(default), under.color(default), strict=True)
        return Input(tuple(weight * (1 - share) * a + share * b for a, b in pairs)), 1.0
    if share < 1:
        note = Sentence(
            "usd-materialx-subsurface-mix",
            "Of a MaterialX surface's base colour and subsurface colour, the one with the larger weight is used",
        )
        read.network.notes.add(note, read.network.user)
    return (under, 1.0) if share > 0.5 or (share == 0.5 and _varies(under)) else (color, weight)


def fill_subsurface(inputs: SurfaceInputs, read: Read, names: Names) -> None:
    """Fills the material's subsurface parameters; for thin sheets, its diffuse transmission.

    The base colour must be filled first.
    """
    material, share = read.material, unit(inputs.number(names.weight, 0.0))
    if share <= 0:
        return
    g = inputs.number(names.anisotropy, 0.0)
    if not _is_sheet(inputs):
        scale = inputs.number(names.scale, 1.0) * read.network.unit
        material.subsurface = share
        material.subsurface_radius = unit_color((scale * c for c in inputs.color(names.radius, names.path)), MOST_DENSE)
        material.subsurface_anisotropy = clamped(g, -MOST_FORWARD, MOST_FORWARD)
        return
    under = inputs("subsurface_color", True)
    color = under.color((0.8, 0.8, 0.8))
    if under.taken is not None:
        color, material.diffuse_transmission_color_texture = colored(read.shelf, under.taken)
    onwards = share * ((1 + clamped(g, -1.0, 1.0)) / 2 if names.turns_back else 1.0)
    material.diffuse_transmission, material.diffuse_transmission_color = onwards, unit_color(color)
    if onwards < 1:
        pairs = zip(material.base_color, color, strict=True)
        material.base_color = unit_color(((1 - share) * b + (share - onwards) * c) / (1 - onwards) for b, c in pairs)


def fill_glass(inputs: SurfaceInputs, read: Read, tint: Vec3, depth: float) -> None:
    """Fills the interior of solid glass with the medium that transmits `tint` over the distance `depth`, in stage units."""
    material = read.material
    scatter = inputs.color("transmission_scatter", (0.0, 0.0, 0.0))
    if max(scatter) <= 0:
        material.attenuation_color, material.attenuation_distance = unit_color(tint), depth * read.network.unit
        return
    found = attenuating_medium(tint, depth * read.network.unit, scatter, inputs.number("transmission_scatter_anisotropy", 0.0))
    for name, value in interior_fields(found).items():
        setattr(material, name, value)


def _is_sheet(inputs: SurfaceInputs) -> bool:
    return any(inputs.number(name, 0) != 0 for name in ("thin_walled", "geometry_thin_walled"))


def _varies(given: Input) -> bool:
    return given.taken is not None or given.primvar is not None
