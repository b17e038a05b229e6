"""Paint under a rough coat, as Mitsuba's roughplastic has it: it loses some of the light between paint and coat.

With T(w) the share of light from w that the coat's facets let through, and R the share of diffuse light from within that they
throw back, both by single scattering with Smith's shadowing, the paint d reflects

    f(o, i) = d / (1 - R d') T(o) T(i) / (pi eta^2),   d' = d where `nonlinear`, else 1.

Source: W. Jakob, Mitsuba 3, src/bsdfs/roughplastic.cpp. Ours lets T(o) T(i) / mean T of its own facets through, energy conserved,
which falls less towards the horizon: the two agree for what is seen at the cosine SEEN_AT under even light.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.kernel.bsdf.albedo_tables import SIZE, table_path

__all__ = ["RoughCoat", "facets_pass", "rough_coat"]

F64 = npt.NDArray[np.float64]

_STEPS = 96  # of a facet's slope; half as many of its azimuth
_COSINES = 16
_LEAST_ALPHA = 1e-3
SEEN_AT = 0.9


class RoughCoat(NamedTuple):
    """left: what paint reflects under it, over what it would by our model. inner: R, what it throws back of light from within."""

    left: float
    inner: float


@functools.cache
def rough_coat(ior: float, alpha: float, distribution: str = "ggx") -> RoughCoat:
    """ior: at least 1. alpha: of the facets, 0 to 1. distribution: ggx or beckmann."""
    cosine, weight = np.polynomial.legendre.leggauss(_COSINES)
    cosine, weight = 0.5 * (cosine + 1), 0.5 * weight
    outside = [facets_pass(c, ior, alpha, distribution)[1] for c in cosine.tolist()]
    inside = [facets_pass(c, 1 / ior, alpha, distribution)[0] for c in cosine.tolist()]
    through, inner = (float(2 * (weight * cosine * np.array(each)).sum()) for each in (outside, inside))
    seen = facets_pass(SEEN_AT, ior, alpha, distribution)[1]
    left = seen * through / (ior * ior * (1 - inner) * _our_passing(ior, alpha))
    return RoughCoat(min(left, 1.0), inner)


def facets_pass(cosine: float, ior: float, alpha: float, distribution: str = "ggx") -> tuple[float, float]:
    """(reflected, let through) of the light that facets scatter once, by the cosine of where it comes from.

    ior: of what lies behind over what lies before. The rest is lost between facets.
    """
    alpha = max(alpha, _LEAST_ALPHA)
    side = (np.arange(_STEPS) + 0.5) / _STEPS
    around = (np.arange(_STEPS // 2) + 0.5) / (_STEPS // 2) * np.pi
    # Facets by their projected area; u = 1 - v^2, since the seen area of steep ones grows with their slope.
    v, phi = np.meshgrid(side, around, indexing="ij")
    slope = alpha * (np.sqrt(1 - v * v) / v if distribution == "ggx" else np.sqrt(-2 * np.log(v)))
    height = 1 / np.sqrt(1 + slope * slope)
    h = np.stack([slope * height * np.cos(phi), slope * height * np.sin(phi), height])
    o = np.array([np.sqrt(1 - cosine * cosine), 0.0, cosine])[:, None, None]
    seen = (o * h).sum(axis=0)
    weight = 2 * v / v.size * np.maximum(seen, 0) / (cosine * height) * _masking(np.array(cosine), alpha, distribution)
    square = 1 - (1 - seen * seen) / (ior * ior)
    beyond = np.sqrt(np.maximum(square, 0))
    with np.errstate(divide="ignore", invalid="ignore"):
        across, along = (seen - ior * beyond) / (seen + ior * beyond), (ior * seen - beyond) / (ior * seen + beyond)
    fresnel = np.where(square > 0, 0.5 * (across * across + along * along), 1.0)
    up = 2 * seen * height - cosine
    down = cosine / ior - (seen / ior - beyond) * height
    reflected = fresnel * np.where(up > 0, _masking(np.maximum(up, 1e-9), alpha, distribution), 0)
    passed = (1 - fresnel) * np.where(down > 0, _masking(np.maximum(down, 1e-9), alpha, distribution), 0)
    live = seen > 0
    return float((weight * np.where(live, reflected, 0)).sum()), float((weight * np.where(live, passed, 0)).sum())


def _masking(cosine: F64, alpha: float, distribution: str) -> F64:
    """Smith's G1. Beckmann's by Walter et al. (2007), equation 27, as Mitsuba has it."""
    tangent = alpha * np.sqrt(np.maximum(1 - cosine * cosine, 0)) / cosine
    if distribution == "ggx":
        return np.asarray(2 / (1 + np.sqrt(1 + tangent * tangent)))
    a = 1 / np.maximum(tangent, 1e-9)
    return np.where(a >= 1.6, 1.0, (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a))


def _our_passing(ior: float, alpha: float) -> float:
    """What our own facets let through at the cosine SEEN_AT (renderer/kernel/bsdf/metallic_roughness.py)."""
    table = np.load(table_path("ggx_albedo")).reshape(-1, 2)
    place = np.sqrt(alpha) * (SIZE - 1)
    row, column = min(int(place), SIZE - 2), int(np.sqrt(SEEN_AT) * (SIZE - 1))
    rest, aside = place - row, np.sqrt(SEEN_AT) * (SIZE - 1) - column
    corners = table[: SIZE * SIZE].reshape(SIZE, SIZE, 2)[row : row + 2, column : column + 2]
    a, b = np.array([1 - rest, rest]) @ np.tensordot(np.array([1 - aside, aside]), corners, (0, 1))
    mean_a, mean_b = np.array([1 - rest, rest]) @ table[SIZE * SIZE + row : SIZE * SIZE + row + 2]
    f0 = ((ior - 1) / (ior + 1)) ** 2
    fresnel = f0 + (1 - f0) / 21
    again = fresnel * fresnel * (mean_a + mean_b) / (1 - fresnel * (1 - mean_a - mean_b))
    return float(1 - f0 * a - b - again * (1 - a - b))
