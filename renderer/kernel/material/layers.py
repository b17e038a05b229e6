"""Looks up the textured parameters of materials of the kinds with many properties."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import ALPHA_X, ALPHA_Y, COAT_NORMAL, CONDUCTOR, FILM_MEAN, FILM_WAVELENGTHS, HUANG, IS_PANE
from renderer.arrays.scene_features import SceneFeatures
from renderer.jit import device, never_inline, subroutine
from renderer.kernel.bsdf.layer_balance import fresnels
from renderer.kernel.bsdf.microfacet import MIN_ALPHA
from renderer.kernel.material.texture import lookup
from renderer.kernel.spectrum.indices import conductor_at
from renderer.kernel.spectrum.upsampling import reflectance
from renderer.kernel.spectrum.wavelengths import nanometres

__all__ = ["Textures", "resolve"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_NODES = 8
_STEP = np.float32(1.0 / _NODES)
_HALF = np.float32(0.5)


class Textures(NamedTuple):
    """The inputs of a surface's texture lookups: scene, material number, coordinates in both UV sets, and shutter time."""

    has: SceneFeatures  # the scene's, as are the arrays
    slots: Any  # material_texture
    texture: Any
    transform: Any
    texel: Any
    material: int
    uv: tuple[float, float]
    uv1: tuple[float, float]
    keys: Any  # key_texture
    time: Any
    spectrum: Any  # the scene's
    wavelengths: Any  # of the path (kernel/spectrum); None without spectra


@device
def _texel(textures, slot):
    number = textures.slots[textures.material, slot]
    if number < 0:
        return _ONE, _ONE, _ONE, _ONE
    place = number, textures.uv, textures.uv1
    return lookup(textures.texture, textures.transform, textures.texel, *place, textures.keys, textures.time)


@device
def _multiply(m, column, color):
    m[column] *= color[0]
    m[column + 1] *= color[1]
    m[column + 2] *= color[2]


@device
def _store(m, column, values):
    m[column], m[column + 1], m[column + 2] = values


@subroutine
def resolve(kind, material, textures, base, metallic, roughness, pane, m):
    """Fills m (LAYER_SLOTS,) with the material's parameters, textures looked up.

    base, metallic, roughness: already looked up. pane: whether its glass is thin, so that it does not refract. COAT_NORMAL is
    set to the shading normal. For a conductor only the slots from ANISOTROPY on, and its roughness alphas, are filled.
    """
    never_inline()
    for column in range(rows.ANISOTROPY if kind == CONDUCTOR else 0, rows.COLUMNS):
        m[column] = material[textures.material, column]
    if textures.has.textures is not None:
        _apply_anisotropy_texture(textures, m)
    if textures.spectrum is not None and kind == CONDUCTOR:
        eta, k, mean = conductor_at(textures.spectrum, textures.material, textures.wavelengths)
        _store(m, rows.ETA, eta)
        _store(m, rows.K, k)
        _store(m, rows.MEAN_FRESNEL, mean)
    if textures.has.layers is not None and kind != CONDUCTOR:
        _resolve_layers(textures, base, metallic, pane, m)
    _set_alphas(m, roughness)
    if textures.has.huang is not None and kind == HUANG:
        _set_normal(m, textures.uv1)
    if textures.has.layers is not None and m[rows.IRIDESCENCE] > _ZERO:
        m[FILM_WAVELENGTHS] = _ZERO
        if textures.spectrum is not None:
            first, second, third = textures.wavelengths
            _store(m, FILM_WAVELENGTHS, (nanometres(first), nanometres(second), nanometres(third)))
        _film_means(m)


@device
def _resolve_layers(textures, base, metallic, pane, m):
    m[rows.BASE], m[rows.BASE + 1], m[rows.BASE + 2] = base
    m[rows.METALLIC] = metallic
    m[IS_PANE] = _ONE if pane else _ZERO
    m[COAT_NORMAL] = m[COAT_NORMAL + 1] = _ZERO
    m[COAT_NORMAL + 2] = _ONE
    if textures.has.textures is not None:
        _look_up(textures, m)
    if textures.spectrum is not None:
        _store_reflectances(textures, m)
    if textures.has.media is not None and m[rows.SUBSURFACE] > _ZERO:
        _move_subsurface_to_transmission(m)


@device
def _store_reflectances(textures, m):
    """Replaces the colours in the parameter row m, but for the base colour, by reflectances at the path's wavelengths."""
    for column in (rows.SPECULAR_COLOR, rows.SHEEN_COLOR, rows.DIFFUSE_TRANSMISSION_COLOR, rows.F0):
        color = m[column], m[column + 1], m[column + 2]
        _store(m, column, reflectance(textures.spectrum, color, textures.wavelengths))


@device
def _move_subsurface_to_transmission(m):
    """Moves the subsurface fraction from the reflected diffuse light to the transmitted light.

    Scales the transmitted light's colour to conserve energy. kernel/medium/subsurface.py splits the two again: SUBSURFACE becomes
    the fraction of all diffuse light that enters the interior.
    """
    below = m[rows.DIFFUSE_TRANSMISSION]
    inside = (_ONE - below) * m[rows.SUBSURFACE]
    there = below / (below + inside)
    m[rows.SUBSURFACE] = inside
    m[rows.DIFFUSE_TRANSMISSION] = below + inside
    _multiply(m, rows.DIFFUSE_TRANSMISSION_COLOR, (there, there, there))


@subroutine
def _look_up(textures, m):
    m[rows.SPECULAR] *= _texel(textures, rows.SPECULAR_TEXTURE)[3]
    _multiply(m, rows.F0, _texel(textures, rows.SPECULAR_COLOR_TEXTURE))
    m[rows.CLEARCOAT] *= _texel(textures, rows.CLEARCOAT_TEXTURE)[0]
    m[rows.CLEARCOAT_ROUGHNESS] *= _texel(textures, rows.CLEARCOAT_ROUGHNESS_TEXTURE)[1]
    _multiply(m, rows.SHEEN_COLOR, _texel(textures, rows.SHEEN_COLOR_TEXTURE))
    m[rows.SHEEN_ROUGHNESS] *= _texel(textures, rows.SHEEN_ROUGHNESS_TEXTURE)[3]
    m[rows.TRANSMISSION] *= _texel(textures, rows.TRANSMISSION_TEXTURE)[0]
    m[rows.IRIDESCENCE] *= _texel(textures, rows.IRIDESCENCE_TEXTURE)[0]
    thin, thick = m[rows.THICKNESS], m[rows.THICKNESS + 1]
    m[rows.THICKNESS] = thin + (thick - thin) * _texel(textures, rows.THICKNESS_TEXTURE)[1]
    m[rows.DIFFUSE_TRANSMISSION] *= _texel(textures, rows.DIFFUSE_TRANSMISSION_TEXTURE)[3]
    color = _texel(textures, rows.DIFFUSE_TRANSMISSION_COLOR_TEXTURE)
    _multiply(m, rows.DIFFUSE_TRANSMISSION_COLOR, color)


@subroutine
def _apply_anisotropy_texture(textures, m):
    """Applies the anisotropy texture to the parameter row m: rotates the anisotropy's direction and scales its strength."""
    if textures.slots[textures.material, rows.ANISOTROPY_TEXTURE] >= 0:
        r, g, b, _ = _texel(textures, rows.ANISOTROPY_TEXTURE)
        x = _TWO * r - _ONE
        y = _TWO * g - _ONE
        length = math.sqrt(x * x + y * y)
        if length > _ZERO:
            c, s = m[rows.ROTATION], m[rows.ROTATION + 1]
            m[rows.ROTATION] = (c * x - s * y) / length
            m[rows.ROTATION + 1] = (s * x + c * y) / length
        m[rows.ANISOTROPY] *= b


@device
def _set_alphas(m, roughness):
    """Sets in the parameter row m both alphas, by KHR_materials_anisotropy, and replaces the roughness.

    The new roughness is that of an isotropic surface with similar energy loss.
    """
    alpha = max(roughness * roughness, MIN_ALPHA)
    strength = m[rows.ANISOTROPY]
    along = alpha + (_ONE - alpha) * strength * strength
    m[ALPHA_X] = along
    m[ALPHA_Y] = alpha
    m[rows.ROUGHNESS] = math.sqrt(_HALF * (along + alpha)) if strength != _ZERO else roughness


@device
def _set_normal(m, normal):
    """Sets HUANG_NORMAL in the parameter row m. normal: of an elliptic fibre, along its major and its minor axis, not unit."""
    square = normal[0] * normal[0] + normal[1] * normal[1]
    there = m[rows.HUANG_ASPECT] < _ONE and square > _ZERO
    scale = _ONE / math.sqrt(square) if there else _ZERO
    m[rows.HUANG_NORMAL] = normal[0] * scale
    m[rows.HUANG_NORMAL + 1] = normal[1] * scale if there else _ONE


@subroutine
def _film_means(m):
    """Sets FILM_MEAN, the cosine-weighted mean Fresnel reflectance of thin films, by the midpoint rule in the squared cosine."""
    for k in range(6):
        m[FILM_MEAN + k] = _ZERO
    for i in range(_NODES):
        metal, dielectric = fresnels(m, math.sqrt((np.float32(i) + _HALF) * _STEP))
        for k in range(3):
            m[FILM_MEAN + k] += metal[k] * _STEP
            m[FILM_MEAN + 3 + k] += dielectric[k] * _STEP
