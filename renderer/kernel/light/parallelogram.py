"""Lamps that are parallelograms: points in proportion to the light that they would send.

What a point of a lamp brings to another, the cosine there over the fourth power of the distance (the cosine at the lamp is the
lamp's plane's distance over the point's), is interpolated between the four corners, and points are drawn in proportion to that: a
warp of the unit square, as in Hart et al., "Practical Product Sampling by Fitting and Composing Warps", 2020. Unlike uniform
points of a solid angle these leave no noise of the receiver's cosine, and take no trigonometric functions.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.light_rows import PARALLELOGRAM
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.sampling.warp import square_to_bilinear, square_to_bilinear_pdf
from renderer.wide.values import as_wide, where

__all__ = ["on_parallelogram", "on_parallelogram_pdf"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_LEAST = np.float32(1e-30)


@device
def _edges(shape):
    return (shape[3], shape[4], shape[5]), (shape[6], shape[7], shape[8])


@device
def _brought(shape, p, n):
    """What the corners bring to p, up to a common factor: numbers of 0 ... 1 times the distance of the nearest."""
    u, v = _edges(shape)
    to_corner = vec.sub((shape[0], shape[1], shape[2]), p)
    along = vec.add(to_corner, u)
    a, b = vec.dot(to_corner, to_corner), vec.dot(along, along)
    across = vec.add(to_corner, v)
    opposite = vec.add(along, v)
    c, d = vec.dot(across, across), vec.dot(opposite, opposite)
    least = max(min(min(a, b), min(c, d)), _LEAST)
    all_sides = vec.dot(n, n) == _ZERO
    ra, rb, rc, rd = least / max(a, _LEAST), least / max(b, _LEAST), least / max(c, _LEAST), least / max(d, _LEAST)
    return (
        ra * ra * where(all_sides, _ONE, max(vec.dot(n, to_corner), _ZERO)),
        rb * rb * where(all_sides, _ONE, max(vec.dot(n, along), _ZERO)),
        rc * rc * where(all_sides, _ONE, max(vec.dot(n, across), _ZERO)),
        rd * rd * where(all_sides, _ONE, max(vec.dot(n, opposite), _ZERO)),
    )


@device
def on_parallelogram(scene, light, p, n, u):
    """A point of that light to light p from, where the normal is n: (point, error, cross product of the edges, density).

    density: of the point, in units of one over the area; 0 where all of the light is below p's horizon. n: zero where p is lit
    from all sides; None for points that are spread evenly.
    """
    shape = row(scene.light_parallelogram, light, PARALLELOGRAM)
    x, y, density = u[0], u[1], as_wide(_ONE, u[0])
    if n is not None:
        brought = _brought(shape, p, n)
        x, y = square_to_bilinear(u, brought)
        density = square_to_bilinear_pdf((x, y), brought)
    along, across = _edges(shape)
    point = vec.add((shape[0], shape[1], shape[2]), vec.add(vec.scale(along, x), vec.scale(across, y)))
    return point, shape[15], vec.cross(along, across), density


@device
def on_parallelogram_pdf(scene, light, p, n, point):
    """The density of `on_parallelogram`, for a light that is one or another; 1 for the others."""
    shape = row(scene.light_parallelogram, light, PARALLELOGRAM)
    from_corner = vec.sub(point, (shape[0], shape[1], shape[2]))
    x = vec.dot(from_corner, (shape[9], shape[10], shape[11]))
    y = vec.dot(from_corner, (shape[12], shape[13], shape[14]))
    density = square_to_bilinear_pdf((min(max(x, _ZERO), _ONE), min(max(y, _ZERO), _ONE)), _brought(shape, p, n))
    return where(shape[15] > _ZERO, density, _ONE)
