"""Converts the scattering parameters of files to medium coefficients and subsurface parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Medium, Vec3
from renderer.scene.material import MOST_DENSE, MOST_FORWARD
from renderer.scene.readers.number_ranges import clamped, unit_color

__all__ = [
    "attenuating_medium",
    "dense_medium_surface",
    "diffuse_reflectance",
    "interior_fields",
    "medium",
    "radius_beneath_a_boundary",
    "single_albedo",
]

F64 = npt.NDArray[np.float64]
_LEAST_COLOR = 1e-6
_MOST_ALBEDO = 1 - 1e-6
# Van de Hulst: the albedo of a half space with similarity s is (1 - s) (1 - _A s) / (1 + _B s).
_A, _B = 0.139, 1.17


def medium(sigma_a: Iterable[float], sigma_s: Iterable[float], g: float = 0.0, scale: float = 1.0) -> Medium:
    """Returns a medium with its coefficients multiplied by `scale`, and clamped to the renderer's limits.

    g: mean cosine of the scattering angle.
    """
    absorbed, scattered = (unit_color((max(scale * c, 0.0) for c in each), MOST_DENSE) for each in (sigma_a, sigma_s))
    return Medium(absorbed, scattered, clamped(g, -MOST_FORWARD, MOST_FORWARD))


def interior_fields(found: Medium) -> dict[str, Any]:
    """Returns the fields that fill a material's interior with a medium."""
    return {"sigma_a": found.sigma_a, "sigma_s": found.sigma_s, "g": found.g, "volume": found.volume}


def attenuating_medium(color: Vec3, depth: float, scatter: Vec3, g: float) -> Medium:
    """Returns the medium that transmits `color` over the distance `depth` and has the scattering coefficients scatter / depth.

    If scattering exceeds extinction, absorption is raised equally in all channels until none is negative.
    Source: Autodesk's Standard Surface 1.0.1, "transmission", and OpenPBR 1.1, "translucent base".
    """
    extinct = [-math.log(clamped(c, _LEAST_COLOR, 1.0)) / depth for c in color]
    scattered = [max(c, 0.0) / depth for c in scatter]
    absorbed = [t - s for t, s in zip(extinct, scattered, strict=True)]
    lacking = min(*absorbed, 0.0)
    return medium((a - lacking for a in absorbed), scattered, g)


def single_albedo(multiple: float, g: float = 0.0) -> float:
    """Returns the single-scattering albedo of a dense medium from its multiple-scattering albedo, 0..1.

    Source: Kulla and Conty, "Revisiting physically based shading at Imageworks", 2017; with g as in KHR_materials_scatter.
    """
    m = clamped(multiple, 0.0, 1.0)
    root = 4.09712 + 4.20863 * m - math.sqrt(9.59217 + 41.6808 * m + 17.7126 * m * m)
    return clamped((1 - root * root) / (1 - g * root * root), 0.0, 1.0)


def diffuse_reflectance(albedo: Any, ior: float) -> F64:
    """Returns the diffuse reflectance of a half-space beneath an internally reflecting boundary, relative to the entering light.

    albedo: reduced single-scattering albedo of the half space. Source: Jensen et al., "A practical model for subsurface light
    transport", 2001, eq. 15, with the internal reflection of Egan and Hilgeman.
    """
    a = np.clip(np.asarray(albedo, np.float64), 0.0, 1.0)
    inner = -1.440 / ior**2 + 0.710 / ior + 0.668 + 0.0636 * ior if ior > 1 else 0.0
    root = np.sqrt(3 * (1 - a))
    return np.asarray(a / 2 * (1 + np.exp(-4 / 3 * (1 + inner) / (1 - inner) * root)) * np.exp(-root))


def dense_medium_surface(sigma_a: Vec3, sigma_s: Vec3, ior: float) -> tuple[Vec3, Vec3]:
    """Returns the colour and the subsurface radius of a dense medium beneath a boundary.

    sigma_s: reduced scattering coefficients.
    """
    absorbed, scattered = np.array(sigma_a), np.array(sigma_s)
    total = np.maximum(absorbed + scattered, 1e-12)
    albedo = scattered / total
    return _vec(diffuse_reflectance(albedo, ior)), _radius(albedo, 1 / total, ior)


def radius_beneath_a_boundary(color: Vec3, path: Vec3, ior: float) -> Vec3:
    """Returns the RGB subsurface radius of a medium that, seen through a dielectric surface, has the diffuse reflectance `color`.

    path: RGB mean free paths in the medium; ior: relative index of refraction of the surface.
    """
    low, high = np.zeros(3), np.full(3, _MOST_ALBEDO)
    for _ in range(50):
        middle = (low + high) / 2
        is_dark = diffuse_reflectance(middle, ior) < np.array(color)
        low, high = np.where(is_dark, middle, low), np.where(is_dark, high, middle)
    return _radius((low + high) / 2, np.array(path), ior)


def _radius(albedo: F64, path: F64, ior: float) -> Vec3:
    """Returns the mean free path with which a boundaryless random walk diffuses light as far as this medium does.

    The walk absorbs the fraction s^2 at each scattering event, where s is the similarity parameter of van de Hulst's half space
    with the reflected colour (renderer/kernel/medium/subsurface.py). The effective transport coefficient is
    sqrt(3 sigma_a (sigma_a + sigma_s')).
    """
    color = diffuse_reflectance(albedo, ior)
    linear = 1 + _A + _B * color
    lost = ((linear - np.sqrt(linear**2 - 4 * _A * (1 - color))) / (2 * _A)) ** 2
    wider = np.where(albedo < _MOST_ALBEDO, np.sqrt(lost / np.maximum(1 - albedo, 1 - _MOST_ALBEDO)), 1.0)
    return unit_color(_vec(path * wider), MOST_DENSE)


def _vec(values: F64) -> Vec3:
    r, g, b = (float(v) for v in values)
    return r, g, b
