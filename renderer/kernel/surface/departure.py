"""Where rays start: off the surface that they leave, so that they do not meet it again where rounding has put its point."""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.surface.surface import POINT_ERROR
from renderer.wide.values import any_of, not_, where, where3

__all__ = ["MAX_PASSED", "departure", "leave", "leaves", "onward"]

MAX_PASSED = 56 << 10  # surfaces that a ray passes by their alpha: 64 << 10 numbers are set aside (integrators/transport.py)

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_SHARE = np.float32(2.0 / 20.0)  # of the bound: 2 roundings of 2**-24
_LEAST_BEND2 = np.float32(1e-12)


@device
def leaves(surface, reflected, d):
    """Whether a ray of direction d goes where it was scattered to: above the facet if it was `reflected`, else below it.

    About a bent normal light may be scattered above the shading horizon and below the facet's. It then meets the facet again.
    """
    above = vec.dot(surface.geometric, d) > _ZERO
    return (above & reflected) | not_(above | reflected)


@device
def departure(surface, reflected, d):
    """Where the ray of unit direction d starts that leaves the surface, on the viewer's side where it is `reflected`.

    From a smooth triangle it starts above the facet, the more so the lower it goes: facing rays start where they should, so
    that what touches the surface still throws its shadow. A reflected ray that points below a flat facet meets the facet
    itself: a bent normal lets no light through.
    """
    error = where(reflected, surface.error, -surface.error)
    start = vec.add(surface.point, vec.scale(surface.geometric, error))
    raised = surface.smooth & reflected
    if any_of(raised):
        cosine = max(vec.dot(surface.geometric, d), _ZERO)
        bend2 = max(_TWO - _TWO * vec.dot(surface.shading, surface.geometric), _LEAST_BEND2)
        higher = vec.add(start, vec.scale(surface.lift, max(_ONE - cosine * cosine / bend2, _ZERO)))
        start = where3(raised, higher, start)
    return start


@device
def onward(surface):
    """Returns where a ray goes on that passes the surface as if it were not there.

    Nearer than `departure`, since a wall may lie close behind a decal: `surface.error` bounds the errors of all coordinates, and
    the distance to the plane takes those of the normal's direction alone. It also bounds the worst rounding, and a tenth of it is
    hardly ever reached; a surface that is met once more lets the ray pass once more.
    """
    p, n = surface.point, surface.geometric
    along = abs(n[0] * p[0]) + abs(n[1] * p[1]) + abs(n[2] * p[2])
    away = _SHARE * max(surface.error - POINT_ERROR * (vec.magnitude(p) - along), _ZERO)
    return vec.sub(p, vec.scale(n, away))


@device
def leave(point, error, normal, towards):
    """The point moved off its surface, to the side that `towards` is on: where a ray may start without meeting it again."""
    distance = where(vec.dot(normal, towards) > _ZERO, error, -error)
    return vec.add(point, vec.scale(normal, distance))
