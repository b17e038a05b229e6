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


def _standard(inputs: SurfaceInputs, read: Read) -> None:
    material = read.material
    color = _fill_base_and_subsurface(inputs, read, subsurface.STANDARD, inputs.number("base", 1.0), (0.8, 0.8, 0.8))
    fill_roughness(read, inputs("specular_roughness"), 0.2, inputs("metalness"), 0.0)
    _specular(read, inputs("specular"), inputs("specular_color", True))
    material.ior = clamped(inputs.number("specular_IOR", 1.5), 1.0, 1000.0)
    _anisotropy(read, inputs.number("specular_anisotropy", 0.0), inputs.number("specular_rotation", 0.0))
    material.thin = bool(inputs.number("thin_walled", 0))
    if _transmission(read, inputs, "transmission"):
        abbe = inputs.number("transmission_dispersion", 0.0)
        material.dispersion = clamped(20 / abbe, 0.0, 20.0) if abbe > 0 else 0.0
        inputs.leave_out({"transmission_extra_roughness": 0.0})
    fill_normal(read, "normal", inputs("normal"))
    fill_emission(read, _colour(inputs("emission_color", True), 1.0), inputs.number("emission", 0.0))
    if _coat(read, inputs("coat"), inputs("coat_roughness"), 0.1, inputs("coat_normal")):
        tint_beneath(read.material, inputs.color("coat_color"))
        inputs.leave_out(_SOFT)
    _sheen(read, inputs.number("sheen", 0.0), inputs("sheen_color", True), inputs.number("sheen_roughness", 0.3))
    _film(read, 1.0, inputs.number("thin_film_thickness", 0.0), inputs.number("thin_film_IOR", 1.5))
    fill_opacity(read, inputs("opacity"), 0.0, color.taken)
    inputs.leave_out({"diffuse_roughness": 0.0})


def _open_pbr(inputs: SurfaceInputs, read: Read) -> None:
    material = read.material
    color = _fill_base_and_subsurface(inputs, read, subsurface.OPEN_PBR, inputs.number("base_weight", 1.0), (0.8, 0.8, 0.8))
    fill_roughness(read, inputs("specular_roughness"), 0.3, inputs("base_metalness"), 0.0)
    _specular(read, inputs("specular_weight"), inputs("specular_color", True))
    material.ior = clamped(inputs.number("specular_ior", 1.5), 1.0, 1000.0)
    _anisotropy(read, inputs.number("specular_roughness_anisotropy", 0.0), 0.0)
    material.thin = bool(inputs.number("geometry_thin_walled", 0))
    if _transmission(read, inputs, "transmission_weight"):
        abbe, scale = (
            inputs.number("transmission_dispersion_abbe_number", 20.0),
            inputs.number("transmission_dispersion_scale", 0.0),
        )
        material.dispersion = clamped(20 * scale / abbe, 0.0, 20.0) if abbe > 0 else 0.0
    fill_normal(read, "normal", inputs("geometry_normal"))
    fill_emission(read, _colour(inputs("emission_color", True), 1.0), inputs.number("emission_luminance", 0.0))
    if _coat(read, inputs("coat_weight"), inputs("coat_roughness"), 0.0, inputs("geometry_coat_normal")):
        tint_beneath(read.material, inputs.color("coat_color"))
        inputs.leave_out(_COATED)
    _sheen(read, inputs.number("fuzz_weight", 0.0), inputs("fuzz_color", True), inputs.number("fuzz_roughness", 0.5))
    film = inputs.number("thin_film_weight", 0.0)
    _film(read, film, 1000 * inputs.number("thin_film_thickness", 0.5), inputs.number("thin_film_ior", 1.4))
    fill_opacity(read, inputs("geometry_opacity"), 0.0, color.taken)
    inputs.leave_out({"base_diffuse_roughness": 0.0})


def _gltf(inputs: SurfaceInputs, read: Read) -> None:
    material = read.material
    color = inputs("base_color", True)
    fill_base(read, color, _WHITE)
    fill_roughness(read, inputs("roughness"), 1.0, inputs("metallic"), 1.0)
    _specular(read, inputs("specular"), inputs("specular_color", True))
    material.ior = clamped(inputs.number("ior", 1.5), 1.0, 1000.0)
    _anisotropy(read, inputs.number("anisotropy_strength", 0.0), inputs.number("anisotropy_rotation", 0.0) / (2 * math.pi))
    fill_data(read, "transmission", inputs("transmission"), 0.0)
    material.thin = inputs.number("thickness", 0.0) <= 0
    if not material.thin:
        material.attenuation_color = unit_color(inputs.color("attenuation_color"))
        depth = inputs.number("attenuation_distance", 0.0) * read.network.unit
        material.attenuation_distance = depth if depth > 0 else math.inf
    material.dispersion = clamped(inputs.number("dispersion", 0.0), 0.0, 20.0)
    _coat(read, inputs("clearcoat"), inputs("clearcoat_roughness"), 0.0, inputs("clearcoat_normal"))
    _sheen(read, 1.0, _colour(inputs("sheen_color", True), 0.0), inputs.number("sheen_roughness", 0.0))
    thickness = inputs.number("iridescence_thickness", 100.0)
    _film(read, inputs.number("iridescence", 0.0), thickness, inputs.number("iridescence_ior", 1.3))
    fill_normal(read, "normal", inputs("normal"))
    fill_emission(read, inputs("emissive", True), inputs.number("emissive_strength", 1.0))
    mode = int(inputs.number("alpha_mode", 0.0))
    if mode:
        fill_opacity(read, inputs("alpha"), inputs.number("alpha_cutoff", 0.5) if mode == 1 else 0.0, color.taken)


def _fill_base_and_subsurface(inputs: SurfaceInputs, read: Read, names: subsurface.Names, weight: float, default: Vec3) -> Input:
    """Fills the material's base colour and subsurface parameters.

    weight: factor of the base colour. Returns the colour input before it is multiplied by the resulting weight.
    """
    color, weight = subsurface.mixed_color(inputs, read, names, weight, default)
    fill_base(read, _scaled(color, weight, default), (0.0, 0.0, 0.0))
    subsurface.fill_subsurface(inputs, read, names)
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


def _transmission(read: Read, inputs: SurfaceInputs, weight: str) -> bool:
    """Fills the material's transmission parameters; returns True if the surface transmits light."""
    material = read.material
    fill_data(read, "transmission", inputs(weight), 0.0)
    if material.transmission == 0:
        return False
    tint, depth = inputs.color("transmission_color"), inputs.number("transmission_depth", 0.0)
    if depth > 0 and not material.thin:
        subsurface.fill_glass(inputs, read, tint, depth)
        tint = _WHITE
    # A material has one colour for reflection and transmission: the one with more weight is used.
    if material.transmission_texture is None:
        share = material.transmission
        r, g, b = (share * t + (1 - share) * c for t, c in zip(tint, material.base_color, strict=True))
        material.base_color = unit_color((r, g, b))
    return True


def _coat(read: Read, coat: Input, rough: Input, roughness: float, normal: Input) -> bool:
    """Fills the material's clear coat parameters; returns True if the surface has a coat.

    rough: the roughness input. roughness: its value if it is not given.
    """
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
