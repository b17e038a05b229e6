"""Equiangular sampling of distances along a ray: in proportion to the inverse squared distance from a small lamp.

Kulla & Fajardo, "Importance Sampling Techniques for Path Tracing in Participating Media" (2012), section 4. The lamp's centre and
the ray's segment span a triangle; its angle at the lamp is sampled uniformly. For one path or for eight lanes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderer.arrays.light_rows import PIVOT_CDF, PIVOT_COLUMNS
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.polynomial import atan2, exp, sincos_turns
from renderer.wide.values import as_wide, u32, where

__all__ = [
    "EquiangularSpan",
    "choose_pivot",
    "equiangular_share",
    "equiangular_span",
    "pdf_equiangular",
    "sample_equiangular",
]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_INV_PI = np.float32(1 / math.pi)
_INV_2PI = np.float32(0.5 / math.pi)
_FARTHEST = np.float32(1e15)  # replaces an infinite reach
_BEFORE_END = np.float32(1 - 2.0**-20)  # keeps the last points off the surface at the segment's end
_NEAREST = np.float32(1e-4)  # least distance of the lamp from the ray, in units of its distance from the ray's origin
_LEAST = np.float32(1e-18)
_FIRST = np.uint32(0)


class EquiangularSpan(NamedTuple):
    """The triangle between a lamp and a ray's segment, which begins at distance 0 and ends at `reach`."""

    begin: float  # coordinate of the segment's begin along the ray, 0 where the ray is nearest to the lamp
    away: float  # distance of the lamp from the ray's line, positive
    angle: float  # the segment's angle as seen from the lamp, radians
    reach: float  # finite


@device
def choose_pivot(pivots, u):
    """Chooses a lamp by power; returns (centre, radius). pivots: `pivot` of CompiledScene, not empty. u: number in [0, 1)."""
    chosen = as_wide(_FIRST, u)
    for k in range(len(pivots) - 1):
        chosen = where(u < pivots[k, PIVOT_CDF], chosen, as_wide(np.uint32(k + 1), u))
    x, y, z, radius, _ = row(pivots, u32(chosen), PIVOT_COLUMNS)
    return (x, y, z), radius


@device
def equiangular_span(o, d, center, radius, reach):
    """Returns the EquiangularSpan of the segment from o in the unit direction d.

    center, radius: of the lamp. The lamp is moved away from the ray's line to at least its radius, which bounds the pdf where the
    ray meets it. reach: the segment's length; may be infinite.
    """
    to_lamp = vec.sub(center, o)
    nearest = vec.dot(to_lamp, d)
    off = vec.sub(to_lamp, vec.scale(d, nearest))
    away = max(vec.length(off), max(max(radius, _NEAREST * vec.length(to_lamp)), _LEAST))
    reach = min(reach, _FARTHEST)
    begin = -nearest
    return EquiangularSpan(begin, away, atan2(away * reach, away * away + begin * (begin + reach)), reach)


@device
def sample_equiangular(span, u):
    """Samples a distance from the segment's begin, 0 ... span.reach. u: number in [0, 1)."""
    sine, cosine = sincos_turns(u * span.angle * _INV_2PI)
    below = span.away * cosine - span.begin * sine
    distance = sine * (span.away * span.away + span.begin * span.begin) / max(below, _LEAST)
    return min(max(distance, _ZERO), span.reach * _BEFORE_END)


@device
def pdf_equiangular(span, distance):
    """Returns the pdf, per unit length, of a distance from the segment's begin; 0 beyond its end."""
    x = span.begin + distance
    pdf = span.away / (max(span.angle, _LEAST) * (span.away * span.away + x * x))
    return where((distance <= span.reach) & (span.angle > _ZERO), pdf, _ZERO)


@device
def equiangular_share(span, sigma_t):
    """Returns the fraction, 0 ... 1/2, of flights whose distance is sampled by the angle; the others are exponential.

    It is large where the lamp sees much of the ray, and falls with the transmittance on the way over the ray's point nearest to
    the lamp. sigma_t: extinction coefficient per unit length, rgb.
    """
    sigma = min(min(sigma_t[0], sigma_t[1]), sigma_t[2])
    way = min(max(-span.begin, _ZERO), span.reach) + span.away
    share = _HALF * _INV_PI * span.angle * exp(-sigma * min(way, _FARTHEST))
    return where(span.angle > _ZERO, min(share, _HALF), _ZERO)
