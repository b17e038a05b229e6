"""Packs materials into table rows: the columns of renderer/arrays/rows.py, filled from the description."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.arrays import rows
from renderer.bvh.layout import RAY_KINDS
from renderer.errors import SceneError
from renderer.kernel.bsdf.rough_glass import SMOOTH_GLASS
from renderer.luminance import luminance
from renderer.scene.curve_meshes import flat_materials
from renderer.scene.description import F32, I32, Material, SceneDescription
from renderer.scene.material import PARAMETERS, check, derived_columns
from renderer.scene.media import absorption, list_media
from renderer.scene.parameters import SCATTERED_RAYS
from renderer.scene.texels import MAX_EMISSION, Texels
from renderer.sentences import Sentence

__all__ = ["Packed", "pack"]

_KINDS = {kind.name: kind.number for kind in rows.KINDS}
_FACETED = tuple(kind.number for kind in rows.KINDS if kind.faceted)
_TEXTURED = tuple(parameter for parameter in PARAMETERS if parameter.slot is not None)
_SINGLE = tuple(parameter for parameter in PARAMETERS if parameter.form == "texture" and not parameter.layered)
_SMOOTH = ("glass", "conductor")  # kinds that are smooth if no roughness is given
_HAIR_ROUGHNESS = 0.55
_MOSTLY = 0.5  # transmission from which on a smooth material is clear
_LEAST_BRUSHED = 0.031  # more than `SMOOTH_GLASS`; its square is less than `MIN_ALPHA`


class Packed(NamedTuple):
    """The material tables of CompiledScene, and the mean luminance that each material emits.

    That luminance includes the emission texture, and is the sum of both sides if both emit.
    """

    material_kind: I32
    material_flags: I32
    material: F32
    material_texture: I32
    medium: F32
    material_medium: I32
    texture: I32
    texture_transform: F32
    texel: np.ndarray
    key_texture: F32
    emitted: np.ndarray  # (M,) float64


def pack(description: SceneDescription) -> Packed:
    """Packs the materials and the textures that they use.

    Raises SceneError if there are too many texels, a parameter is out of range, or a texture with layers is used by a slot that
    does not support them.
    """
    texels = Texels(description)
    count = len(description.materials)
    kinds = np.zeros(count, np.int32)
    flags = np.zeros(count, np.int32)
    for m in description.materials:
        check(m)
        _check_layers(m, description)
    absorbing, flat = absorption(description.materials), flat_materials(description)
    emissions = np.zeros((count, 3))
    textures = np.full((count, rows.SLOTS), -1, np.int32)
    emitted = np.zeros(count)
    for i, m in enumerate(description.materials):
        for parameter in _TEXTURED:
            index = getattr(m, parameter.name)
            if index is None:
                continue
            textures[i, parameter.slot] = texels.add(index)[0]
        emission = np.array(m.emission if m.kind != "interface" else (0.0, 0.0, 0.0), np.float64)
        emitted[i] = luminance(emission)
        if m.emission_texture is not None and emitted[i] > 0:
            row, scale = texels.add(m.emission_texture, light=True)
            textures[i, rows.EMISSION_TEXTURE] = row
            emission = np.minimum(emission * scale, MAX_EMISSION)
            emitted[i] *= scale * texels.mean_luminance(row)
        if m.double_sided:
            emitted[i] *= 2
        kinds[i] = _kind(m)
        emissions[i] = emission
        flags[i] = rows.FLAT_CURVES if i in flat else 0
        flags[i] |= _flags(m, [row for row in textures[i].tolist() if row >= 0], texels, bool(absorbing[i].any()))
    columns = _columns(description.materials, emissions, absorbing)
    medium, material_medium = list_media(description)
    return Packed(kinds, flags, columns, textures, medium, material_medium, *texels.arrays(), texels.keys(), emitted)


def _check_layers(m: Material, description: SceneDescription) -> None:
    """Raises SceneError if a texture has layers that its slot does not support."""
    for parameter in _SINGLE:
        index = getattr(m, parameter.name)
        if index is not None and description.textures[index].layers:
            raise SceneError(
                Sentence(
                    "material-layers-not-taken",
                    "Material {name}: its {slot} has layers, which are not supported there; give it one texture",
                    name=m.name,
                    slot=parameter.name,
                )
            )


def _roughness(m: Material) -> float:
    if m.roughness is None:
        return _HAIR_ROUGHNESS if m.model == "huang" else 0.0 if m.kind in _SMOOTH else 1.0
    return m.roughness


def _own_roughness(m: Material) -> float:
    """Returns a material's roughness for kernels.

    Brushed metal is rough along its scratches and so never treated as a mirror, however smooth it is across them. The lobe is
    unchanged: both values are below the smoothest possible (`MIN_ALPHA`).
    """
    brushed = m.kind == "conductor" and m.anisotropy != 0
    return max(_roughness(m), _LEAST_BRUSHED) if brushed else _roughness(m)


def _kind(m: Material) -> int:
    if m.kind == "glass":
        return rows.GLASS if _roughness(m) <= SMOOTH_GLASS and not m.thin else rows.LAYERED
    if m.kind == "metallic_roughness":
        layers = m.clearcoat, m.diffuse_transmission, m.iridescence, m.anisotropy, m.subsurface, *m.sheen_color
        textured = m.specular_texture is not None or m.specular_color_texture is not None
        if not any(layers) and m.transmission == 1 and m.metallic == 0 and _roughness(m) <= SMOOTH_GLASS and not m.thin:
            return rows.GLASS if m.transmission_texture is None else rows.LAYERED
        other = any(layers) or m.transmission or textured or m.distribution == "beckmann"
        return rows.LAYERED if other else rows.METALLIC_ROUGHNESS
    if m.kind == "hair" and m.model == "huang":
        return rows.HUANG
    return _KINDS[m.kind]


def _flags(m: Material, used: list[int], texels: Texels, absorbs: bool) -> int:
    mapped = m.normal_texture is not None or m.clearcoat_normal_texture is not None
    principled = m.kind == "metallic_roughness"
    transmits = m.kind == "glass" or (principled and m.transmission > 0)
    flags = {
        rows.TEXTURED: bool(used),
        rows.SECOND_UV: any(texels.uses_second_uv_set(row) for row in used),
        rows.NORMAL_MAPPED: m.normal_texture is not None,
        rows.NEEDS_TANGENT: mapped or m.anisotropy != 0 or m.kind == "hair",
        rows.MASKED: m.alpha_mode == "mask",
        rows.BLENDED: m.alpha_mode == "blend" or m.kind == "interface",
        rows.THIN: m.thin,
        rows.DISPERSIVE: transmits and m.dispersion > 0 and not m.thin,
        rows.TRANSMITS: m.kind == "hair"
        or (_kind(m) == rows.LAYERED and (transmits or (principled and m.diffuse_transmission > 0))),
        rows.LAMP: m.lamp,
        rows.UNSEEN: m.unseen,
        rows.SHADELESS: m.shadeless,
        rows.HOLDOUT: m.holdout,
        rows.CATCHER: m.shadow_catcher or (m.reflection_catcher and m.kind == "unlit"),
        rows.REFLECTIONS: m.reflection_catcher and m.kind != "unlit",  # which reflects nothing
        **{flag: kind in m.hidden_from for kind, flag in zip(RAY_KINDS, rows.UNSEEN_BY, strict=True) if kind in SCATTERED_RAYS},
        rows.FACING: m.facing and m.emission_texture is None,
        rows.ABSORBING: transmits and not m.thin and absorbs,
        rows.NONLINEAR: m.kind == "plastic" and m.nonlinear,
        rows.SCATTERS_WITHIN: m.kind in ("diffuse", "metallic_roughness") and m.subsurface > 0,
        rows.CLEAR: _is_clear(m),
        rows.BECKMANN: m.distribution == "beckmann" and _kind(m) in _FACETED,
    }
    return sum(bit for bit, is_set in flags.items() if is_set)


def _is_clear(m: Material) -> bool:
    """Returns True for smooth glass, and for a principled material that is mostly that."""
    transmission = 1.0 if m.kind == "glass" else m.transmission * (1 - m.metallic) if m.kind == "metallic_roughness" else 0.0
    return bool(transmission >= _MOSTLY and _roughness(m) <= SMOOTH_GLASS)


def _columns(materials: list[Material], emission: np.ndarray, absorbing: np.ndarray) -> F32:
    """Returns the material table (M, COLUMNS). Filled column by column for speed: files have a hundred thousand materials."""
    found = np.zeros((len(materials), rows.COLUMNS), np.float32)

    def set_column(column: int, values: list[Any] | np.ndarray) -> None:
        given = np.array(values, np.float64).reshape(len(materials), -1)
        found[:, column : column + given.shape[1]] = given

    if not materials:
        return found
    for parameter in PARAMETERS:
        if parameter.column is not None:
            set_column(parameter.column, [getattr(m, parameter.name) for m in materials])
    set_column(rows.EMISSION, emission)
    set_column(rows.ROUGHNESS, [_own_roughness(m) for m in materials])
    set_column(rows.ABSORPTION, absorbing)
    turned = [m.anisotropy_rotation for m in materials]
    set_column(rows.ROTATION, [(np.cos(angle), np.sin(angle)) if angle else (1.0, 0.0) for angle in turned])
    set_column(rows.F0, [_at_normal_incidence(m) for m in materials])
    for row, m in zip(found, materials, strict=True):
        for column, values in derived_columns(m):
            row[column : column + len(values)] = values
    return found


def _at_normal_incidence(m: Material) -> list[float]:
    reflected = ((m.ior - 1) / (m.ior + 1)) ** 2
    return [min(reflected * c, 1.0) for c in m.specular_color]
