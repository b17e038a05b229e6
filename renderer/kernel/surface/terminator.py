"""Computes ray origins that avoid the shadow terminator artefact: shadow edges that follow the facets of smooth objects."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.wide.values import where, where3

__all__ = ["lifted"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NOTHING = (_ZERO, _ZERO, _ZERO)
_MOST_BEND = np.float32(math.cos(math.radians(45.0)))


@device
def _lift(point, corner, normal, up, side):
    """Returns the offset from a point of the facet up to a corner's tangent plane; zero if that plane is below the point.

    side: 1, or -1 if the corner's normal points to the other side than `up`, the facet's unit normal. Normals that deviate by
    more than 45 degrees are ignored: they indicate a box without sharp edges rather than a round surface.
    """
    height = side * vec.dot(vec.sub(point, corner), normal)
    beneath = (height < _ZERO) & (side * vec.dot(normal, up) > _MOST_BEND)
    return where3(beneath, vec.scale(normal, -side * height), _NOTHING)


@device
def lifted(corners, normals, point, u, v, shading, up):
    """Returns the offset from a point on a smooth triangle to the round surface implied by the vertex normals.

    A ray that starts there passes above the neighbouring facets, so the shadow boundary is smooth and does not follow the facets:
    Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, chapter 4 (2021). corners, normals: the triangle's. up: the
    facet's normal, of any length.
    """
    square = vec.dot(up, up)
    up = vec.scale(up, _ONE / math.sqrt(square))
    side = where(vec.dot(shading, up) > _ZERO, _ONE, -_ONE)
    a = _lift(point, corners[0], normals[0], up, side)
    b = _lift(point, corners[1], normals[1], up, side)
    c = _lift(point, corners[2], normals[2], up, side)
    lift = vec.add(vec.scale(a, _ONE - u - v), vec.add(vec.scale(b, u), vec.scale(c, v)))
    return where3(square > _ZERO, lift, _NOTHING)
