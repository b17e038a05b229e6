"""Effective reflectances of pbrt's coated diffuse and coated conductor materials.

pbrt simulates a random walk between coat and base. A coat attenuates light at each crossing, even without scattering:
exp(-thickness / cosine). Its rough boundary loses the light that its facets shadow, far more from inside than from outside.
Diffuse reflection is independent of the incident direction, so the interreflections with the coat form a geometric series
with as many terms as the walk has steps.

Source: Pharr, Jakob and Humphreys 2023, 14.3; facets: 9.6 and 9.7. Results are rounded, so that they are equal on all hosts.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["Coat", "coat_of", "coated_albedo", "coated_metal_reflectance"]

F64 = npt.NDArray[np.float64]
_COSINES, _OF_SMOOTH, _STEPS = 32, 1024, 32  # quadrature: directions, directions for smooth coats, facets per axis
_DIGITS = 6


class Coat(NamedTuple):
    """Fractions of uniform incident light that a coat transmits or reflects.

    entering, leaving: transmitted into and out of the coat; back: reflected back to the base; reflected: reflected from outside.
    bounces: number of reflections off the base during the walk.
    """

    entering: float
    leaving: float
    back: float
    reflected: float
    bounces: int


@functools.cache
def coat_of(ior: float, alpha: float, thickness: float, depth: int) -> Coat:
    """Returns a coat's fractions of transmitted and reflected light, integrated over all directions.

    ior: index of refraction, above 1; alpha: microfacet alpha, 0 for smooth; depth: steps of the random walk, at least 1.
    """
    count = _COSINES if alpha > 0 else _OF_SMOOTH
    cosines = np.sqrt((np.arange(count) + 0.5) / count)  # cosine-weighted
    outside = _boundary(cosines, ior, alpha, thickness)
    inside = _boundary(cosines, 1 / ior, alpha, thickness)
    crossed = np.exp(-thickness / cosines)
    shares = outside.through, crossed * inside.plain, crossed * inside.back, outside.reflected
    entering, leaving, back, reflected = (round(float(each.mean()), _DIGITS) for each in shares)
    return Coat(entering, leaving, back, reflected, (depth + 1) // 2)


class _Boundary(NamedTuple):
    """Fractions of light at one boundary of the coat, (C,) arrays by incident cosine.

    through: refracted, then transmitted by the coat; plain: refracted, without the coat's attenuation; reflected: reflected,
    without attenuation; back: reflected, then transmitted by the coat.
    """

    through: F64
    plain: F64
    reflected: F64
    back: F64


def _boundary(cosines: F64, ior: float, alpha: float, thickness: float) -> _Boundary:
    """Returns the fractions of light at a boundary, integrated over its microfacets.

    cosines: (C,) incident cosines; ior: index of refraction beyond the boundary, relative to the incident side.
    """
    view = np.stack([np.sqrt(1 - cosines**2), np.zeros_like(cosines), cosines], axis=-1)[:, None, :]
    facets = _visible_facets(view, alpha)
    cosine = np.maximum((facets * view).sum(axis=-1), 1e-9)
    square = (1 - cosine**2) / ior**2
    behind = np.sqrt(np.maximum(1 - square, 0))
    across = (ior * cosine - behind) / (ior * cosine + behind)
    along = (cosine - ior * behind) / (cosine + ior * behind)
    fresnel = np.where(square >= 1, 1.0, (across**2 + along**2) / 2)
    up = 2 * cosine * facets[..., 2] - view[..., 2]
    down = view[..., 2] / ior - (cosine / ior - behind) * facets[..., 2]
    seen_up, seen_down = (unshadowed_fraction(view[..., 2], each, alpha) for each in (up, down))
    reflected, plain = fresnel * seen_up, (1 - fresnel) * seen_down
    crossing = [np.exp(-thickness / np.maximum(each, 1e-6)) for each in (down, up)]
    parts = plain * crossing[0], plain, reflected, reflected * crossing[1]
    return _Boundary(*(each.mean(axis=1) for each in parts))


def _visible_facets(view: F64, alpha: float) -> F64:
    """Returns (C, N, 3) facet normals, distributed by their visibility from (C, 1, 3) view directions.

    Source: Dupuy and Benyoub 2023.
    """
    if alpha == 0:
        return np.broadcast_to(np.array([0.0, 0.0, 1.0]), (len(view), 1, 3))
    u, v = (each.reshape(-1) for each in np.meshgrid(*2 * [(np.arange(_STEPS) + 0.5) / _STEPS], indexing="ij"))
    stretched = view * (alpha, alpha, 1.0)
    stretched = stretched / np.sqrt((stretched**2).sum(axis=-1, keepdims=True))
    z = (1 - u) * (1 + stretched[..., 2]) - stretched[..., 2]
    radius = np.sqrt(np.maximum(1 - z * z, 0))
    half = np.stack([radius * np.cos(math.pi * v), radius * np.sin(math.pi * v), z], axis=-1) + stretched
    half = half * (alpha, alpha, 1.0)
    return np.asarray(half / np.sqrt((half**2).sum(axis=-1, keepdims=True)))


def unshadowed_fraction(seen_from: F64, cosine: F64, alpha: float) -> F64:
    """Returns the fraction of light scattered at `cosine` that facets do not shadow: G / G1 of Smith's functions.

    seen_from, cosine: cosines of the view and light directions; below 0 the fraction is 0.
    """
    first, second = (
        (np.sqrt(1 + alpha**2 * (1 / np.maximum(each, 1e-9) ** 2 - 1)) - 1) / 2 for each in (seen_from, np.maximum(cosine, 1e-9))
    )
    return np.where(cosine > 0, (1 + first) / (1 + first + second), 0.0)


def coated_albedo(reflectance: Any, coat: Coat) -> Any:
    """Returns the effective reflectance of a coated diffuse base, for the light that the coat's surface does not reflect.

    reflectance: of the base, a tuple or an array.
    """
    values = np.clip(np.asarray(reflectance, np.float64), 0, 1)
    bounced = values * coat.back
    series = (1 - _power(bounced, coat.bounces)) / np.maximum(1 - bounced, 1e-9)
    found = np.minimum(coat.entering * coat.leaving / (1 - coat.reflected) * values * series, 1.0)
    if isinstance(reflectance, tuple):
        r, g, b = (float(v) for v in found)
        return r, g, b
    return np.asarray(found, np.float32)


def _power(values: F64, exponent: int) -> F64:
    """Returns values raised to an integer power by multiplication only, so that results are equal on all hosts."""
    found, square = np.ones_like(values), values
    while exponent:
        found = found * square if exponent & 1 else found
        square, exponent = square * square, exponent >> 1
    return found


def coated_metal_reflectance(reflectance: F64, ior: float, thickness: float) -> F64:
    """Returns the effective reflectance of a coated metal at normal incidence, interreflections included.

    It applies to the light that the coat's surface does not reflect. reflectance: of the metal; thickness: of the coat.
    """
    coat = ((ior - 1) / (ior + 1)) ** 2
    crossed = math.exp(-2 * thickness)
    return np.asarray(np.round((1 - coat) * reflectance * crossed / (1 - coat * reflectance * crossed), _DIGITS))
