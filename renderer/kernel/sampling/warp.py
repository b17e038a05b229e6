"""Warps from the unit square to other domains: each square_to_x with square_to_x_pdf, the density of its result."""

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
    """Maps the square to the unit disk by the concentric map (Shirley & Chiu 1997).

    Returns (radius, sin, cos); the radius may be negative.
    """
    a = _TWO * u[0] - _ONE
    b = _TWO * u[1] - _ONE
    steep = abs(b) > abs(a)  # unpredictable, hence no branch
    radius = where(steep, b, a)
    turns = _EIGHTH * where(steep, a, b) / where(radius != _ZERO, radius, _ONE)
    sine, cosine = sincos_turns(where(steep, _QUARTER - turns, turns))
    return radius, sine, cosine


@device
def square_to_disk(u):
    """Samples the unit disk uniformly: (x, y)."""
    radius, sine, cosine = _concentric(u)
    return radius * cosine, radius * sine


@device
def square_to_disk_pdf(p):
    """Returns the pdf of `square_to_disk` per unit area at p = (x, y); 0 outside the disk."""
    return where(p[0] * p[0] + p[1] * p[1] <= _ONE, _INV_PI, _ZERO)


@device
def square_to_cosine_hemisphere(u):
    """Samples the hemisphere about +z in proportion to the cosine (Malley): a unit vector."""
    radius, sine, cosine = _concentric(u)
    return radius * cosine, radius * sine, math.sqrt(_ONE - radius * radius)


@device
def square_to_cosine_hemisphere_pdf(w):
    """Returns the pdf of `square_to_cosine_hemisphere`, per steradian, for the unit vector w."""
    return max(_ZERO, w[2]) * _INV_PI


@device
def square_to_hemisphere(u):
    """Samples the hemisphere about +z uniformly: a unit vector."""
    radius = math.sqrt(max(_ZERO, _ONE - u[0] * u[0]))
    sine, cosine = sincos_turns(u[1])
    return radius * cosine, radius * sine, u[0]


@device
def square_to_hemisphere_pdf(w):
    """Returns the pdf of `square_to_hemisphere`, per steradian; 0 below the horizon."""
    return where(w[2] > _ZERO, _INV_2PI, _ZERO)


@device
def square_to_sphere(u):
    """Samples the sphere of directions uniformly: a unit vector."""
    z = _ONE - _TWO * u[0]
    radius = math.sqrt(max(_ZERO, _ONE - z * z))
    sine, cosine = sincos_turns(u[1])
    return radius * cosine, radius * sine, z


@device
def square_to_sphere_pdf(w):
    """Returns the pdf of `square_to_sphere`, per steradian: 1 / (4 pi)."""
    return _INV_4PI


@device
def square_to_cone(u, one_minus_cos):
    """Samples the directions in a cone about +z uniformly: a unit vector.

    one_minus_cos: 1 - cos(half angle), which stays exact for small cones.
    """
    height = u[0] * one_minus_cos  # 1 - z
    radius = math.sqrt(max(_ZERO, height * (_TWO - height)))
    sine, cosine = sincos_turns(u[1])
    return radius * cosine, radius * sine, _ONE - height


@device
def square_to_cone_pdf(one_minus_cos):
    """Returns the pdf of `square_to_cone`, per steradian, inside the cone."""
    return _INV_2PI / one_minus_cos


@device
def square_to_triangle(u):
    """Samples a triangle uniformly by area: the barycentric coordinates of its corners b and c."""
    root = math.sqrt(u[0])
    return u[1] * root, _ONE - root


@device
def square_to_triangle_pdf(area):
    """Returns the pdf of `square_to_triangle`, per unit area."""
    return _ONE / area


@device
def _linear(u, a, b):
    """Samples a position in [0, 1] with a density that is linear from a at 0 to b at 1; a and b are not both 0."""
    root = math.sqrt(a * a + u * (b * b - a * a))
    return min(u * (a + b) / max(a + root, _LEAST), _ONE)


@device
def square_to_bilinear(u, w):
    """Samples the unit square with a density bilinear between the corner values w at (0, 0), (1, 0), (0, 1), (1, 1): (x, y).

    w: non-negative, not all 0. Source: PBRT 4ed, A.5.1.
    """
    y = _linear(u[1], w[0] + w[1], w[2] + w[3])
    return _linear(u[0], w[0] + y * (w[2] - w[0]), w[1] + y * (w[3] - w[1])), y


@device
def square_to_bilinear_pdf(p, w):
    """Returns the pdf of `square_to_bilinear`, per unit area, at p = (x, y); 0 where all of w are 0."""
    lower, upper = w[0] + p[0] * (w[1] - w[0]), w[2] + p[0] * (w[3] - w[2])
    mean = _QUARTER * (w[0] + w[1] + w[2] + w[3])
    return where(mean > _ZERO, (lower + p[1] * (upper - lower)) / max(mean, _LEAST), _ZERO)
