"""Directions towards a sphere, uniform over the solid angle that it subtends: for one point or for eight."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.sampling.warp import square_to_cone, square_to_cone_pdf
from renderer.wide.values import where, zero_like

__all__ = ["hits_sphere", "sample_sphere_direction", "sphere_cone", "sphere_direction_pdf"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)


@device
def sphere_cone(square, radius):
    """Returns 1 - cos of the half angle subtended by a sphere seen from outside, with its centre at squared distance `square`."""
    sine2 = radius * radius / square
    return sine2 / (_ONE + math.sqrt(max(_ZERO, _ONE - sine2)))


@device
def sample_sphere_direction(center, radius, p, u):
    """Samples a direction from p, outside a sphere, towards it: (unit direction, pdf per steradian)."""
    to_center = vec.sub(center, p)
    square = vec.dot(to_center, to_center)
    axis = vec.scale(to_center, _ONE / math.sqrt(square))
    s, t = vec.basis(axis)
    cone = sphere_cone(square, radius)
    return vec.to_world(s, t, axis, square_to_cone(u, cone)), square_to_cone_pdf(cone)


@device
def hits_sphere(to_center, radius, d):
    """Returns True if the ray of unit direction d hits a sphere with its centre at `to_center` from the ray's origin."""
    off = vec.cross(to_center, d)  # of length distance * sine, without the cancellation of 1 - cosine**2
    return (vec.dot(to_center, d) > _ZERO) & (vec.dot(off, off) <= radius * radius)


@device
def sphere_direction_pdf(center, radius, p, d, is_sampled):
    """Returns the pdf, per steradian, of `sample_sphere_direction` at the unit direction d; 0 if d misses the sphere.

    is_sampled: whether `sample_sphere_direction` has returned d for this sphere; by rounding, a direction at its rim may seem to
    miss it.
    """
    to_center = vec.sub(center, p)
    square = vec.dot(to_center, to_center)
    hits = hits_sphere(to_center, radius, d)
    return where(hits | is_sampled, square_to_cone_pdf(sphere_cone(square, radius)), zero_like(square))
