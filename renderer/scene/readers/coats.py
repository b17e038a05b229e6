"""Reflectance of dielectric boundaries, and the albedo of diffuse paint under a clear coat."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from renderer.scene.material import Material
from renderer.scene.readers.number_ranges import unit_color

__all__ = ["dielectric_albedo", "effective_albedo_under_coat", "internal_albedo", "ior_of", "pane_ior", "tint_beneath"]


@functools.cache
def dielectric_albedo(ior: float) -> float:
    """Returns the hemispherical albedo, 0..1, of a smooth dielectric under uniform illumination.

    ior: index of refraction beyond the boundary, at least 1.
    """
    cosine = (np.arange(1024) + 0.5) / 1024
    behind = np.sqrt(1 - (1 - cosine**2) / ior**2)
    across = (cosine - ior * behind) / (cosine + ior * behind)
    along = (ior * cosine - behind) / (ior * cosine + behind)
    return float(((across**2 + along**2) / 2 * 2 * cosine).mean())


def ior_of(reflectance: float) -> float:
    """Returns the index of refraction of a dielectric with the given reflectance at normal incidence.

    reflectance: clamped to 0..0.99.
    """
    root = math.sqrt(min(max(reflectance, 0.0), 0.99))
    return (1 + root) / (1 - root)


def pane_ior(ior: float) -> float:
    """Returns the index of a single boundary with the same reflectance at normal incidence as a pane, interreflections included.

    ior: the pane's index of refraction.
    """
    once = ((ior - 1) / (ior + 1)) ** 2
    return ior_of(2 * once / (1 + once))


def internal_albedo(ior: float) -> float:
    """Returns the hemispherical albedo, 0..1, of a smooth coat's boundary under uniform illumination from inside the coat.

    ior: the coat's index of refraction.
    """
    return 1 - (1 - dielectric_albedo(ior)) / ior**2


def effective_albedo_under_coat(reflectance: Any, inner: float) -> Any:
    """Returns the effective reflectance of paint under a coat, relative to the light that enters the coat.

    reflectance: of the paint, a tuple or an array; inner: the coat's internal albedo. The interreflections between paint and coat
    form a geometric series. Source: Pharr, Jakob and Humphreys 2023, 14.3, in the limit of a thin smooth coat.
    """
    values = np.clip(np.asarray(reflectance, np.float32), 0, 1)
    found = (1 - inner) * values / (1 - inner * values)
    if isinstance(reflectance, tuple):
        r, g, b = (float(v) for v in found)
        return r, g, b
    return found


def tint_beneath(material: Material, color: tuple[float, float, float]) -> None:
    """Tints a material's base colour, specular colour and emission by the colour of its clear coat.

    Source: Autodesk's Standard Surface 1.0.1.
    """
    through = unit_color(1 + material.clearcoat * (c - 1) for c in color)
    if through == (1.0, 1.0, 1.0):
        return
    for name, most in (("base_color", 1.0), ("specular_color", 1000.0), ("emission", 1e9)):
        below = getattr(material, name)
        setattr(material, name, unit_color((c * t for c, t in zip(below, through, strict=True)), most))
