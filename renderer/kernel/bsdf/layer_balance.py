"""Albedo and transmission of the layers of the glTF surface.

m is the parameter row of a layered material (renderer/arrays/rows.py) after its textures were looked up.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import ALPHA_X, ALPHA_Y, FILM_MEAN, FILM_WAVELENGTHS, HAS_BECKMANN
from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.brushed_energy import brushed_albedo, brushed_mean_albedo
from renderer.kernel.bsdf.clearcoat import clearcoat_albedo, clearcoat_mean_albedo
from renderer.kernel.bsdf.energy import multiple_scattering, schlick_mean
from renderer.kernel.bsdf.fresnel import schlick
from renderer.kernel.bsdf.iridescence import film_reflectance, film_reflectance_at
from renderer.kernel.bsdf.sheen import sheen_albedo, sheen_mean_albedo
from renderer.kernel.polynomial import power

__all__ = [
    "base_view",
    "coat_passing",
    "dielectric_f0",
    "fresnels",
    "mean_cosine",
    "mean_passing",
    "rgb",
    "sheen_passing",
    "to_anisotropy_frame",
]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_FIFTH = np.float32(0.2)
_LEAST = np.float32(1e-6)
_LEAST_LOSS = np.float32(1e-3)
# Two layers that both reflect more at grazing angles transmit more together than the product of their means. For two with
# Schlick's Fresnel, the covariance is this times the products of (mean - f0): 21**2 (1 / 66 - 1 / 441).
_COVARIANCE = np.float32(21.0**2 * (1.0 / 66.0 - 1.0 / 441.0))


@device
def rgb(m, column):
    """Returns three values of the material's parameter row m, from `column` on."""
    return m[column], m[column + 1], m[column + 2]


@device
def _mix(a, b, t):
    return vec.add(vec.scale(a, _ONE - t), vec.scale(b, t))


@device
def dielectric_f0(m):
    """Returns the dielectric's reflectance at normal incidence, rgb, including the specular factor."""
    return vec.scale(rgb(m, rows.F0), m[rows.SPECULAR])


@device
def _schlick_mean_rgb(f0, f90):
    return schlick_mean(f0[0], f90), schlick_mean(f0[1], f90), schlick_mean(f0[2], f90)


@device
def _scattered_again(mean_fresnel, mean_albedo):
    return (
        multiple_scattering(mean_fresnel[0], mean_albedo),
        multiple_scattering(mean_fresnel[1], mean_albedo),
        multiple_scattering(mean_fresnel[2], mean_albedo),
    )


@device
def _film(m, f0, cosine):
    """Returns the reflectance, rgb or at the path's wavelengths, of a base of reflectance f0 under the material's thin film."""
    film = f0, m[rows.IRIDESCENCE_IOR], m[rows.THICKNESS], cosine
    if m[FILM_WAVELENGTHS] > _ZERO:
        return film_reflectance_at(*film, rgb(m, FILM_WAVELENGTHS))
    return film_reflectance(*film)


@subroutine
def fresnels(m, cosine):
    """Returns the Fresnel reflectances (metal, dielectric), rgb each, at a microfacet, including iridescence."""
    base = rgb(m, rows.BASE)
    f0 = dielectric_f0(m)
    metal = schlick(base, _ONE, cosine)
    dielectric = schlick(f0, m[rows.SPECULAR], cosine)
    film = m[rows.IRIDESCENCE]
    if film > _ZERO:
        metal = _mix(metal, _film(m, base, cosine), film)
        dielectric = _mix(dielectric, _film(m, f0, cosine), film)
    return metal, dielectric


@device
def mean_cosine(a, b):
    """Returns the effective cosine at which Schlick's weight equals its mean over the visible microfacets, b / (a + b)."""
    return _ONE - power(b / max(a + b, _LEAST), _FIFTH)


@subroutine
def _dielectric_albedo(m, cosine, a, b, again, loss):
    """Returns the albedo of the dielectric's microfacets for one direction (its largest channel), including multiple scattering.

    a, b, loss: of `base_view`. again: the fraction of the lost light that leaves after further bounces.
    """
    film = m[rows.IRIDESCENCE]
    bare = vec.maximum(dielectric_f0(m)) * a + m[rows.SPECULAR] * b
    if film > _ZERO:
        _, reflected = fresnels(m, mean_cosine(a, b))  # includes the film
        bare = vec.maximum(reflected) * (a + b)
    return min(bare + again * loss, _ONE)


@subroutine
def coat_passing(m, cosine):
    """Returns the fraction of light that the clearcoat transmits to the layers below, for one direction.

    m: the material's parameter row. cosine: of the angle between the direction and the coat's normal.
    """
    return _ONE - m[rows.CLEARCOAT] * clearcoat_albedo(m[rows.CLEARCOAT_ROUGHNESS], cosine)


@subroutine
def sheen_passing(m, cosine):
    """Returns the fraction of light that the sheen transmits to the layers below, for one direction.

    m: the material's parameter row. cosine: of the angle between the direction and the normal.
    """
    color = vec.maximum(rgb(m, rows.SHEEN_COLOR))
    return _ONE - color * sheen_albedo(cosine, m[rows.SHEEN_ROUGHNESS]) if color > _ZERO else _ONE


@device
def to_anisotropy_frame(m, w):
    """Returns the local direction w in the frame of the anisotropy.

    The x axis of that frame is the direction in which highlights are stretched.
    """
    c, s = m[rows.ROTATION], m[rows.ROTATION + 1]
    return c * w[0] + s * w[1], c * w[1] - s * w[0], w[2]


@device
def base_view(m, w):
    """Returns the base layer's terms for one direction w above the horizon.

    The terms: (a, b, loss, mean loss, factor of multiple scattering for the metal, rgb, and for the dielectric, transmission into
    the dielectric, transmission of the coat, transmission of the sheen). a and b are the albedo terms of the microfacets for F0
    and F90; loss is the fraction of light that single scattering loses.
    """
    cosine = w[2]
    a, b = brushed_albedo(m[HAS_BECKMANN], to_anisotropy_frame(m, w), m[rows.ROUGHNESS], m[ALPHA_X], m[ALPHA_Y])
    mean_a, mean_b = brushed_mean_albedo(m[HAS_BECKMANN], m[rows.ROUGHNESS], m[ALPHA_X], m[ALPHA_Y])
    mean = mean_a + mean_b
    loss = max(_ONE - a - b, _ZERO)
    base = rgb(m, rows.BASE)
    f0 = dielectric_f0(m)
    if m[rows.IRIDESCENCE] > _ZERO:
        metal_mean, dielectric_mean = rgb(m, FILM_MEAN), rgb(m, FILM_MEAN + 3)
    else:
        metal_mean, dielectric_mean = _schlick_mean_rgb(base, _ONE), _schlick_mean_rgb(f0, m[rows.SPECULAR])
    again_metal = _scattered_again(metal_mean, mean)
    again = multiple_scattering(vec.maximum(dielectric_mean), mean)
    passing = _ONE - _dielectric_albedo(m, cosine, a, b, again, loss)
    return (
        a,
        b,
        loss,
        max(_ONE - mean, _LEAST_LOSS),
        again_metal,
        again,
        passing,
        coat_passing(m, cosine),
        sheen_passing(m, cosine),
    )


@subroutine
def mean_passing(m):
    """Returns the mean transmission, over the hemisphere, of all layers above the diffuse base.

    Computed as the product of the layers' means, corrected by their covariances. m: the material's parameter row.
    """
    mean_a, mean_b = brushed_mean_albedo(m[HAS_BECKMANN], m[rows.ROUGHNESS], m[ALPHA_X], m[ALPHA_Y])
    mean = mean_a + mean_b
    a, b = brushed_albedo(m[HAS_BECKMANN], (_ZERO, _ZERO, _ONE), m[rows.ROUGHNESS], m[ALPHA_X], m[ALPHA_Y])
    if m[rows.IRIDESCENCE] > _ZERO:
        again = multiple_scattering(vec.maximum(rgb(m, FILM_MEAN + 3)), mean)
        taken = vec.maximum(rgb(m, FILM_MEAN + 3)) * mean + again * (_ONE - mean)
        _, reflected = fresnels(m, mean_cosine(a, b))
        facing = vec.maximum(reflected) * (a + b) + again * (_ONE - a - b)
    else:
        f0 = vec.maximum(dielectric_f0(m))
        again = multiple_scattering(schlick_mean(f0, m[rows.SPECULAR]), mean)
        taken = f0 * mean_a + m[rows.SPECULAR] * mean_b + again * (_ONE - mean)
        facing = f0 * a + m[rows.SPECULAR] * b + again * (_ONE - a - b)
    coat = _ONE - m[rows.CLEARCOAT] * clearcoat_mean_albedo(m[rows.CLEARCOAT_ROUGHNESS])
    color = vec.maximum(rgb(m, rows.SHEEN_COLOR))
    sheen = _ONE - color * sheen_mean_albedo(m[rows.SHEEN_ROUGHNESS])
    rise = max(taken - facing, _ZERO)
    coat_rise = max(coat_passing(m, _ONE) - coat, _ZERO)
    sheen_rise = max(sheen_passing(m, _ONE) - sheen, _ZERO)
    base = _ONE - taken
    together = rise * coat_rise * sheen + rise * sheen_rise * coat + coat_rise * sheen_rise * base
    return max(base * coat * sheen + _COVARIANCE * together, _LEAST)
