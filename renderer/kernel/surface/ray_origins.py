"""Ray origins: offset from the surface that a ray leaves, so that rounding does not make it hit that surface again."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.wide.values import any_of, not_, where, where3

__all__ = ["leave", "leaves", "offset_ray_origin"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_LEAST_BEND2 = np.float32(1e-12)
_LEAST_RADIUS2 = np.float32(1e-30)
_LEAST_SINE2 = np.float32(1 / 16)  # of the angle between ray and fibre: limits the length of rays within fibres to four diameters


@device
def leaves(surface, reflected, d):
    """Returns True if direction d leaves the facet on the side to which it is scattered: above if `reflected`, else below.

    With a bent normal, light may be scattered above the shading horizon but below the facet. The ray then hits the same facet
    again.
    """
    above = vec.dot(surface.geometric, d) > _ZERO
    return (above & reflected) | not_(above | reflected)


@device
def offset_ray_origin(surface, reflected, d):
    """Returns the origin of a ray of unit direction d that leaves the surface, on the viewer's side if `reflected`.

    On a smooth triangle the origin is raised above the facet, more for grazing rays; rays along the normal start at the point, so
    that contact shadows are preserved. A reflected ray that points below a flat facet hits the facet itself, so that no light
    leaks through a bent normal. A ray that a curve transmits starts where it leaves the cylinder around its axis; from the point
    where light enters, it would hit the next segment of the same fibre near a bend.
    """
    error = where(reflected, surface.error, -surface.error)
    start = vec.add(surface.point, vec.scale(surface.geometric, error))
    raised = surface.smooth & reflected
    if any_of(raised):
        cosine = max(vec.dot(surface.geometric, d), _ZERO)
        bend2 = max(_TWO - _TWO * vec.dot(surface.shading, surface.geometric), _LEAST_BEND2)
        higher = vec.add(start, vec.scale(surface.lift, max(_ONE - cosine * cosine / bend2, _ZERO)))
        start = where3(raised, higher, start)
    radius2 = vec.dot(surface.lift, surface.lift)
    within = not_(surface.smooth | reflected) & (radius2 > _ZERO)
    if any_of(within):
        along = vec.dot(surface.lift, d)
        across2 = max(radius2 - along * along, max(_LEAST_SINE2 * radius2, _LEAST_RADIUS2))
        chord = _TWO * math.sqrt(radius2) * max(-vec.dot(surface.geometric, d), _ZERO) * (radius2 / across2)
        start = where3(within, vec.add(start, vec.scale(d, chord)), start)
    return start


@device
def leave(point, error, normal, towards):
    """Returns an origin for rays: a point on a surface, offset to the side of the surface to which `towards` points."""
    distance = where(vec.dot(normal, towards) > _ZERO, error, -error)
    return vec.add(point, vec.scale(normal, distance))
