"""From the unit square to other domains: each square_to_x beside the density square_to_x_pdf of what it gives."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel.polynomial import sincos_turns
from renderer.wide.values import where

__all__ = [
    "square_to_bilinear",
    "square_to_bilinear_pdf",
    "square_to_cone",
    "square_to_cone_pdf",
    "square_to_cosine_hemisphere",
    "square_to_cosine_hemisphere_pdf",
    "square_to_disk",
    "square_to_disk_pdf",
    "square_to_hemisphere",
    "square_to_hemisphere_pdf",
    "square_to_sphere",
    "square_to_sphere_pdf",
    "square_to_triangle",
    "square_to_triangle_pdf",
]

_ZERO = np.float32(0.0)
_LEAST = np.float32(1e-30)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_EIGHTH = np.float32(0.125)
_QUARTER = np.float32(0.25)
_INV_PI = np.float32(1.0 / math.pi)
_INV_2PI = np.float32(0.5 / math.pi)
_INV_4PI = np.float32(0.25 / math.pi)


@device
def _concentric(u):
    """The square's point as one of the unit disk, keeping neighbours together (Shirley & Chiu 1997): (radius, sin, cos)."""
    a = _TWO * u[0] - _ONE
    b = _TWO * u[1] - _ONE
    steep = abs(b) > abs(a)  # cannot be predicted
    radius = where(steep, b, a)
    turns = _EIGHTH * where(steep, a, b) / where(radius != _ZERO, radius, _ONE)
    sine, cosine = sincos_turns(where(steep, _QUARTER - turns, turns))
    return radius, sine, cosine


@device
def square_to_disk(u):
    """The unit disk, uniformly: (x, y)."""
    radius, sine, cosine = _concentric(u)
    return radius * cosine, radius * sine


@device
def square_to_disk_pdf(p):
    """Per unit area at p = (x, y)."""
    return where(p[0] * p[0] + p[1] * p[1] <= _ONE, _INV_PI, _ZERO)


@device
def square_to_cosine_hemisphere(u):
    """Directions about +z, proportional to their cosine (Malley): a unit vector."""
    radius, sine, cosine = _concentric(u)
    return radius * cosine, radius * sine, math.sqrt(_ONE - radius * radius)


@device
def square_to_cosine_hemisphere_pdf(w):
    """Per steradian."""
    return max(_ZERO, w[2]) * _INV_PI


@device
def square_to_hemisphere(u):
    """Directions about +z, uniformly: a unit vector."""
    radius = math.sqrt(max(_ZERO, _ONE - u[0] * u[0]))
    sine, cosine = sincos_turns(u[1])
    return radius * cosine, radius * sine, u[0]


@device
def square_to_hemisphere_pdf(w):
    """Per steradian."""
    return where(w[2] > _ZERO, _INV_2PI, _ZERO)


@device
def square_to_sphere(u):
    """Directions all round, uniformly: a unit vector."""
    z = _ONE - _TWO * u[0]
    radius = math.sqrt(max(_ZERO, _ONE - z * z))
    sine, cosine = sincos_turns(u[1])
    return radius * cosine, radius * sine, z


@device
def square_to_sphere_pdf(w):
    """Per steradian."""
    return _INV_4PI


@device
def square_to_cone(u, one_minus_cos):
    """Directions about +z within a cone, uniformly. The cone is told by 1 - cos(half angle), which small cones keep exact."""
    height = u[0] * one_minus_cos  # 1 - z
    radius = math.sqrt(max(_ZERO, height * (_TWO - height)))
    sine, cosine = sincos_turns(u[1])
    return radius * cosine, radius * sine, _ONE - height


@device
def square_to_cone_pdf(one_minus_cos):
    """Per steradian, inside the cone."""
    return _INV_2PI / one_minus_cos


@device
def square_to_triangle(u):
    """Barycentric coordinates (of b, of c), uniform over a triangle's area."""
    root = math.sqrt(u[0])
    return u[1] * root, _ONE - root


@device
def square_to_triangle_pdf(area):
    """Per unit area."""
    return _ONE / area


@device
def _linear(u, a, b):
    """A place in [0, 1] with a density that goes from a to b, of which not both are 0."""
    root = math.sqrt(a * a + u * (b * b - a * a))
    return min(u * (a + b) / max(a + root, _LEAST), _ONE)


@device
def square_to_bilinear(u, w):
    """The unit square, with a density that is bilinear between w's at the corners (0, 0), (1, 0), (0, 1), (1, 1): (x, y).

    w: not negative, not all 0. Source: PBRT 4ed, A.5.1.
    """
    y = _linear(u[1], w[0] + w[1], w[2] + w[3])
    return _linear(u[0], w[0] + y * (w[2] - w[0]), w[1] + y * (w[3] - w[1])), y


@device
def square_to_bilinear_pdf(p, w):
    """Per unit area at p = (x, y); 0 where all of w are."""
    lower, upper = w[0] + p[0] * (w[1] - w[0]), w[2] + p[0] * (w[3] - w[2])
    mean = _QUARTER * (w[0] + w[1] + w[2] + w[3])
    return where(mean > _ZERO, (lower + p[1] * (upper - lower)) / max(mean, _LEAST), _ZERO)
