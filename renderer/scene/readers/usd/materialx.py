"""MaterialX surfaces in USD: standard_surface, open_pbr_surface, gltf_pbr and UsdPreviewSurface, as far as supported.

Sources: MaterialX 1.39's definitions; Autodesk's Standard Surface 1.0.1; OpenPBR 1.1; glTF 2.0.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from renderer.scene.description import Vec3
from renderer.scene.readers.coats import tint_beneath
from renderer.scene.readers.mtl_maps import as_alpha
from renderer.scene.readers.number_ranges import clamped, unit, unit_color
from renderer.scene.readers.usd import subsurface
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
from renderer.scene.readers.usd.surface_inputs import SurfaceInputs
from renderer.scene.readers.usd.textures import colored, grey

__all__ = ["SURFACES", "read_materialx"]

STANDARD, OPEN_PBR = "ND_standard_surface_surfaceshader", "ND_open_pbr_surface_surfaceshader"
GLTF = "ND_gltf_pbr_surfaceshader"
SURFACES = (STANDARD, OPEN_PBR, GLTF, "ND_UsdPreviewSurface_surfaceshader", ARNOLD)
_WHITE: Vec3 = (1.0, 1.0, 1.0)
_SOFT = {"coat_anisotropy": 0.0, "coat_affect_color": 0.0, "coat_affect_roughness": 0.0, "coat_IOR": 1.5}
_COATED = {"coat_roughness_anisotropy": 0.0, "coat_darkening": 0.0, "coat_ior": 1.6}


def read_materialx(shader: Any, kind: str, read: Read) -> None:
    """Fills the material from a MaterialX surface shader."""
    if kind in (STANDARD, ARNOLD):
        _standard(SurfaceInputs(shader, read), read)
    elif kind == OPEN_PBR:
        _open_pbr(SurfaceInputs(shader, read), read)
    elif kind == GLTF:
        _gltf(SurfaceInputs(shader, read), read)
    else:
        read_preview_surface(shader, read)


def _standard(said: SurfaceInputs, read: Read) -> None:
    material = read.material
    color = _body(said, read, subsurface.STANDARD, said.number("base", 1.0), (0.8, 0.8, 0.8))
    fill_roughness(read, said("specular_roughness"), 0.2, said("metalness"), 0.0)
    _specular(read, said("specular"), said("specular_color", True))
    material.ior = clamped(said.number("specular_IOR", 1.5), 1.0, 1000.0)
    _anisotropy(read, said.number("specular_anisotropy", 0.0), said.number("specular_rotation", 0.0))
    material.thin = bool(said.number("thin_walled", 0))
    if _transmission(read, said, "transmission"):
        abbe = said.number("transmission_dispersion", 0.0)
        material.dispersion = clamped(20 / abbe, 0.0, 20.0) if abbe > 0 else 0.0
        said.leave_out({"transmission_extra_roughness": 0.0})
    fill_normal(read, "normal", said("normal"))
    fill_emission(read, _colour(said("emission_color", True), 1.0), said.number("emission", 0.0))
    if _coat(read, said("coat"), said("coat_roughness"), 0.1, said("coat_normal")):
        tint_beneath(read.material, said.color("coat_color"))
        said.leave_out(_SOFT)
    _sheen(read, said.number("sheen", 0.0), said("sheen_color", True), said.number("sheen_roughness", 0.3))
    _film(read, 1.0, said.number("thin_film_thickness", 0.0), said.number("thin_film_IOR", 1.5))
    fill_opacity(read, said("opacity"), 0.0, color.taken)
    said.leave_out({"diffuse_roughness": 0.0})


def _open_pbr(said: SurfaceInputs, read: Read) -> None:
    material = read.material
    color = _body(said, read, subsurface.OPEN_PBR, said.number("base_weight", 1.0), (0.8, 0.8, 0.8))
    fill_roughness(read, said("specular_roughness"), 0.3, said("base_metalness"), 0.0)
    _specular(read, said("specular_weight"), said("specular_color", True))
    material.ior = clamped(said.number("specular_ior", 1.5), 1.0, 1000.0)
    _anisotropy(read, said.number("specular_roughness_anisotropy", 0.0), 0.0)
    material.thin = bool(said.number("geometry_thin_walled", 0))
    if _transmission(read, said, "transmission_weight"):
        abbe, scale = said.number("transmission_dispersion_abbe_number", 20.0), said.number("transmission_dispersion_scale", 0.0)
        material.dispersion = clamped(20 * scale / abbe, 0.0, 20.0) if abbe > 0 else 0.0
    fill_normal(read, "normal", said("geometry_normal"))
    fill_emission(read, _colour(said("emission_color", True), 1.0), said.number("emission_luminance", 0.0))
    if _coat(read, said("coat_weight"), said("coat_roughness"), 0.0, said("geometry_coat_normal")):
        tint_beneath(read.material, said.color("coat_color"))
        said.leave_out(_COATED)
    _sheen(read, said.number("fuzz_weight", 0.0), said("fuzz_color", True), said.number("fuzz_roughness", 0.5))
    film = said.number("thin_film_weight", 0.0)
    _film(read, film, 1000 * said.number("thin_film_thickness", 0.5), said.number("thin_film_ior", 1.4))
    fill_opacity(read, said("geometry_opacity"), 0.0, color.taken)
    said.leave_out({"base_diffuse_roughness": 0.0})


def _gltf(said: SurfaceInputs, read: Read) -> None:
    material = read.material
    color = said("base_color", True)
    fill_base(read, color, _WHITE)
    fill_roughness(read, said("roughness"), 1.0, said("metallic"), 1.0)
    _specular(read, said("specular"), said("specular_color", True))
    material.ior = clamped(said.number("ior", 1.5), 1.0, 1000.0)
    _anisotropy(read, said.number("anisotropy_strength", 0.0), said.number("anisotropy_rotation", 0.0) / (2 * math.pi))
    fill_data(read, "transmission", said("transmission"), 0.0)
    material.thin = said.number("thickness", 0.0) <= 0
    if not material.thin:
        material.attenuation_color = unit_color(said.color("attenuation_color"))
        depth = said.number("attenuation_distance", 0.0) * read.network.unit
        material.attenuation_distance = depth if depth > 0 else math.inf
    material.dispersion = clamped(said.number("dispersion", 0.0), 0.0, 20.0)
    _coat(read, said("clearcoat"), said("clearcoat_roughness"), 0.0, said("clearcoat_normal"))
    _sheen(read, 1.0, _colour(said("sheen_color", True), 0.0), said.number("sheen_roughness", 0.0))
    thickness = said.number("iridescence_thickness", 100.0)
    _film(read, said.number("iridescence", 0.0), thickness, said.number("iridescence_ior", 1.3))
    fill_normal(read, "normal", said("normal"))
    fill_emission(read, said("emissive", True), said.number("emissive_strength", 1.0))
    mode = int(said.number("alpha_mode", 0.0))
    if mode:
        fill_opacity(read, said("alpha"), said.number("alpha_cutoff", 0.5) if mode == 1 else 0.0, color.taken)


def _body(said: SurfaceInputs, read: Read, names: subsurface.Names, weight: float, default: Vec3) -> Input:
    """Fills the base colour and the subsurface parameters; returns the base colour input."""
    color, weight = subsurface.mixed_color(said, read, names, weight, default)
    fill_base(read, _scaled(color, weight, default), (0.0, 0.0, 0.0))
    subsurface.scatter_beneath(said, read, names)
    return color


def _scaled(given: Input, factor: float, default: Vec3) -> Input:
    if given.taken is None:
        return given if given.primvar else Input(tuple(factor * c for c in given.color(default)))
    (r, g, b, a), (x, y, z, w) = given.taken.scale, given.taken.bias
    f = factor
    taken = replace(given.taken, scale=(f * r, f * g, f * b, f * a), bias=(f * x, f * y, f * z, f * w))
    return replace(given, taken=taken)


def _colour(given: Input, default: float) -> Input:
    return given if given.taken is not None else Input(given.color((default,) * 3))


def _specular(read: Read, weight: Input, color: Input) -> None:
    material, shelf = read.material, read.shelf
    material.specular = 1.0 if weight.taken is not None else unit(weight.number(1.0))
    if weight.taken is not None:
        material.specular_texture = as_alpha(shelf, grey(shelf, weight.taken))
    if color.taken is not None:
        material.specular_color, material.specular_color_texture = colored(shelf, color.taken)
    else:
        material.specular_color = unit_color(color.color(_WHITE))


def _anisotropy(read: Read, strength: float, turns: float) -> None:
    read.material.anisotropy, read.material.anisotropy_rotation = unit(strength), 2 * math.pi * turns


def _transmission(read: Read, said: SurfaceInputs, weight: str) -> bool:
    """Fills the transmission parameters; returns True if the surface transmits light."""
    material = read.material
    fill_data(read, "transmission", said(weight), 0.0)
    if material.transmission == 0:
        return False
    tint, depth = said.color("transmission_color"), said.number("transmission_depth", 0.0)
    if depth > 0 and not material.thin:
        subsurface.fill_glass(said, read, tint, depth)
        tint = _WHITE
    # A material has one colour for reflection and transmission: the one with more weight is used.
    if material.transmission_texture is None:
        share = material.transmission
        r, g, b = (share * t + (1 - share) * c for t, c in zip(tint, material.base_color, strict=True))
        material.base_color = unit_color((r, g, b))
    return True


def _coat(read: Read, coat: Input, rough: Input, roughness: float, normal: Input) -> bool:
    """Fills the clear coat parameters; returns True if the surface has a coat."""
    fill_data(read, "clearcoat", coat, 0.0)
    if read.material.clearcoat <= 0:
        return False
    fill_data(read, "clearcoat_roughness", rough, roughness)
    fill_normal(read, "clearcoat_normal", normal)
    return True


def _sheen(read: Read, weight: float, color: Input, roughness: float) -> None:
    if weight <= 0:
        return
    material = read.material
    factor = color.color(_WHITE)
    if color.taken is not None:
        factor, material.sheen_color_texture = colored(read.shelf, color.taken)
    material.sheen_color = unit_color([weight * c for c in factor])
    material.sheen_roughness = unit(roughness)


def _film(read: Read, weight: float, nanometres: float, ior: float) -> None:
    if weight > 0 and nanometres > 0:
        thickness = clamped(nanometres, 0.0, 1e5)
        read.material.iridescence, read.material.iridescence_ior = unit(weight), clamped(ior, 1.0, 5.0)
        read.material.iridescence_thickness = (thickness, thickness)
