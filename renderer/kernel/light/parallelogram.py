"""Sampling of parallelogram lights in proportion to their approximate contribution to the shaded point.

The contribution of a point on the light is proportional to the receiver's cosine over the fourth power of the distance, since the
cosine at the light is the distance of its plane divided by that of the point. It is evaluated at the four corners and
interpolated bilinearly, and points are sampled from that density by a warp of the unit square, as in Hart et al., "Practical
Product Sampling by Fitting and Composing Warps", 2020. Unlike uniform sampling of the solid angle this leaves no noise from the
receiver's cosine, and needs no trigonometric functions.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.light_rows import PARALLELOGRAM
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.sampling.warp import square_to_bilinear, square_to_bilinear_pdf
from renderer.wide.values import as_wide, where

__all__ = ["parallelogram_pdf", "sample_parallelogram"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_LEAST = np.float32(1e-30)


@device
def _edges(shape):
    return (shape[3], shape[4], shape[5]), (shape[6], shape[7], shape[8])


@device
def _corner_contributions(shape, p, n):
    """Returns the relative contributions of the light's four corners to p.

    Each is the corner's height above the tangent plane at p over the fourth power of its distance, scaled to at most the distance
    of the nearest corner. For light from all sides (n = 0) the height is replaced by 1.
    """
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
def sample_parallelogram(scene, light, p, n, u):
    """Samples a point of parallelogram `light` as seen from p: (point, position error, cross product of the edges, density).

    density: relative to uniform sampling by area; 0 where the whole light is below the horizon of p. n: the normal at p; zero for
    light from all sides; None to sample uniformly.
    """
    shape = row(scene.light_parallelogram, light, PARALLELOGRAM)
    x, y, density = u[0], u[1], as_wide(_ONE, u[0])
    if n is not None:
        brought = _corner_contributions(shape, p, n)
        x, y = square_to_bilinear(u, brought)
        density = square_to_bilinear_pdf((x, y), brought)
    along, across = _edges(shape)
    point = vec.add((shape[0], shape[1], shape[2]), vec.add(vec.scale(along, x), vec.scale(across, y)))
    return point, shape[15], vec.cross(along, across), density


@device
def parallelogram_pdf(scene, light, p, n, point):
    """Returns the density with which `sample_parallelogram` samples `point`, relative to uniform sampling by area.

    It is 1 for lights that are not parallelograms.
    """
    shape = row(scene.light_parallelogram, light, PARALLELOGRAM)
    from_corner = vec.sub(point, (shape[0], shape[1], shape[2]))
    x = vec.dot(from_corner, (shape[9], shape[10], shape[11]))
    y = vec.dot(from_corner, (shape[12], shape[13], shape[14]))
    density = square_to_bilinear_pdf((min(max(x, _ZERO), _ONE), min(max(y, _ZERO), _ONE)), _corner_contributions(shape, p, n))
    return where(shape[15] > _ZERO, density, _ONE)
