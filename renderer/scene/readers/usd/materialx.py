"""MaterialX in USD: standard_surface, open_pbr_surface and UsdPreviewSurface, as far as ours goes.

Sources: MaterialX 1.39's definitions; Autodesk's Standard Surface 1.0.1; OpenPBR 1.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from renderer.scene.readers.numbers import clamped, unit, unit_color
from renderer.scene.readers.usd.arnold import STANDARD as ARNOLD
from renderer.scene.readers.usd.inputs import Input
from renderer.scene.readers.usd.preview_surface import (
    Read,
    fill_base,
    fill_data,
    fill_emission,
    fill_normal,
    fill_opacity,
    fill_roughness,
    read_preview_surface,
)

__all__ = ["SURFACES", "read_materialx"]

STANDARD, OPEN_PBR = "ND_standard_surface_surfaceshader", "ND_open_pbr_surface_surfaceshader"
SURFACES = (STANDARD, OPEN_PBR, "ND_UsdPreviewSurface_surfaceshader", ARNOLD)


def read_materialx(shader: Any, kind: str, read: Read) -> None:
    """Fills the material from a MaterialX surface."""
    if kind in (STANDARD, ARNOLD):
        _standard(shader, read)
    elif kind == OPEN_PBR:
        _open_pbr(shader, read)
    else:
        read_preview_surface(shader, read)


def _standard(shader: Any, read: Read) -> None:
    material, said = read.material, _said(shader, read)
    base, color = said("base").number(1.0), said("base_color", True)
    fill_base(read, _scaled(color, base, (0.8, 0.8, 0.8)), (0.8 * base,) * 3)
    fill_roughness(read, said("specular_roughness"), 0.2, said("metalness"), 0.0)
    material.specular = unit(said("specular").number(1.0))
    material.specular_color = unit_color(said("specular_color").color((1.0, 1.0, 1.0)))
    material.ior = clamped(said("specular_IOR").number(1.5), 1.0, 1000.0)
    _anisotropy(read, said("specular_anisotropy").number(0.0), said("specular_rotation").number(0.0))
    _transmission(
        read, said("transmission"), said("transmission_color").color((1.0, 1.0, 1.0)), said("transmission_depth").number(0)
    )
    material.thin = bool(said("thin_walled").number(0))
    _coat(read, said("coat"), said("coat_roughness"), 0.1, said("coat_normal"))
    _sheen(read, said("sheen").number(0.0), said("sheen_color").color((1.0, 1.0, 1.0)), said("sheen_roughness").number(0.3))
    _film(read, said("thin_film_thickness").number(0.0), said("thin_film_IOR").number(1.5))
    fill_normal(read, "normal", said("normal"))
    fill_emission(read, _colour(said("emission_color", True), 1.0), said("emission").number(0.0))
    fill_opacity(read, said("opacity"), 0.0, color.taken)
    _left_out(read, said, ("subsurface", "diffuse_roughness", "transmission_scatter", "transmission_extra_roughness"))


def _open_pbr(shader: Any, read: Read) -> None:
    material, said = read.material, _said(shader, read)
    weight, color = said("base_weight").number(1.0), said("base_color", True)
    fill_base(read, _scaled(color, weight, (0.8, 0.8, 0.8)), (0.8 * weight,) * 3)
    fill_roughness(read, said("specular_roughness"), 0.3, said("base_metalness"), 0.0)
    material.specular = unit(said("specular_weight").number(1.0))
    material.specular_color = unit_color(said("specular_color").color((1.0, 1.0, 1.0)))
    material.ior = clamped(said("specular_ior").number(1.5), 1.0, 1000.0)
    _anisotropy(read, said("specular_roughness_anisotropy").number(0.0), 0.0)
    tint, depth = said("transmission_color").color((1.0, 1.0, 1.0)), said("transmission_depth").number(0.0)
    _transmission(read, said("transmission_weight"), tint, depth)
    material.thin = bool(said("geometry_thin_walled").number(0))
    _coat(read, said("coat_weight"), said("coat_roughness"), 0.0, said("geometry_coat_normal"))
    fuzz = said("fuzz_color").color((1.0, 1.0, 1.0))
    _sheen(read, said("fuzz_weight").number(0.0), fuzz, said("fuzz_roughness").number(0.5))
    if said("thin_film_weight").number(0.0) > 0:
        _film(read, 1000 * said("thin_film_thickness").number(0.5), said("thin_film_ior").number(1.4))
    fill_normal(read, "normal", said("geometry_normal"))
    fill_emission(read, _colour(said("emission_color", True), 1.0), said("emission_luminance").number(0.0))
    fill_opacity(read, said("geometry_opacity"), 0.0, color.taken)
    _left_out(read, said, ("subsurface_weight", "base_diffuse_roughness", "coat_darkening"))


Said = Callable[..., Input]


def _said(shader: Any, read: Read) -> Said:
    return lambda name, srgb=False: read.network.input(shader, name, srgb)


def _scaled(given: Input, factor: float, default: tuple[float, float, float]) -> Input:
    if given.taken is None:
        return given if given.primvar else Input(tuple(factor * c for c in given.color(default)))
    r, g, b, a = given.taken.scale
    return Input(None, replace(given.taken, scale=(factor * r, factor * g, factor * b, a)))


def _colour(given: Input, default: float) -> Input:
    return given if given.taken is not None else Input(given.color((default,) * 3))


def _anisotropy(read: Read, strength: float, turns: float) -> None:
    read.material.anisotropy, read.material.anisotropy_rotation = unit(strength), 2 * math.pi * turns


def _transmission(read: Read, given: Input, tint: tuple[float, float, float], depth: float) -> None:
    material = read.material
    fill_data(read, "transmission", given, 0.0)
    if material.transmission == 0:
        return
    if depth > 0:
        material.attenuation_color, material.attenuation_distance = unit_color(tint), depth
        tint = (1.0, 1.0, 1.0)
    # One colour for what is reflected and what goes through: that of which there is more.
    if given.taken is None:
        share = material.transmission
        r, g, b = (share * t + (1 - share) * c for t, c in zip(tint, material.base_color, strict=True))
        material.base_color = unit_color((r, g, b))


def _coat(read: Read, coat: Input, rough: Input, roughness: float, normal: Input) -> None:
    fill_data(read, "clearcoat", coat, 0.0)
    if read.material.clearcoat > 0:
        fill_data(read, "clearcoat_roughness", rough, roughness)
        fill_normal(read, "clearcoat_normal", normal)


def _sheen(read: Read, weight: float, color: tuple[float, float, float], roughness: float) -> None:
    if weight > 0:
        read.material.sheen_color = unit_color([weight * c for c in color])
        read.material.sheen_roughness = unit(roughness)


def _film(read: Read, nanometres: float, ior: float) -> None:
    if nanometres > 0:
        thickness = clamped(nanometres, 0.0, 1e5)
        read.material.iridescence, read.material.iridescence_ior = 1.0, clamped(ior, 1.0, 5.0)
        read.material.iridescence_thickness = (thickness, thickness)


def _left_out(read: Read, said: Said, names: tuple[str, ...]) -> None:
    for name in names:
        given = said(name)
        if given.taken is not None or max(given.color((0.0, 0.0, 0.0))) > 0:
            read.network.notes.add(f"The {name.replace('_', ' ')} of MaterialX surfaces is left out", read.network.user)
