"""Directions towards the portals of a path guide: spheres through which much of the light arrives; for one path or for eight.

A cube of the guide has for each portal the radiance seen through it in addition to that of other directions
(renderer/arrays/guide.py). A vertex takes each portal for a light of that radiance, and chooses it in proportion to the
irradiance that it brings: radiance times solid angle times cosine. So a few large cubes suffice, and what a vertex samples
changes with its distance as the light does. The probability of sampling a portal at all is the portals' part of the irradiance,
in which the other light counts OTHER_WEIGHT times.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from renderer.arrays.guide import OTHER_RADIANCE, PORTAL_CENTER, PORTAL_RADIUS, RADIANCE_COLUMNS
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import columns
from renderer.kernel.sampling.sphere_cone import hits_sphere, sample_sphere_direction, sphere_cone
from renderer.wide.values import where, where3, zero_like

__all__ = [
    "MIN_DISTANCE2",
    "MOST_CHANCE",
    "NO_PORTAL",
    "OTHER_WEIGHT",
    "Portals",
    "portals_in_view",
    "portals_pdf",
    "sample_portal",
]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_BELOW_ONE = np.float32(1.0 - 2.0**-24)
_LEAST = np.float32(1e-30)
MIN_DISTANCE2 = np.float32(1.02)  # in squared radii: nearer vertices do not sample a portal
MOST_CHANCE = np.float32(0.75)  # upper bound of the probability of sampling a portal
# Factor of the other irradiance: what portals do not bring is found by chance at later vertices, so its estimates have a larger
# variance, and need the more samples.
OTHER_WEIGHT = np.float32(2.0)
_PER_TURN = np.float32(0.5 / math.pi)
NO_PORTAL = np.float32(-1.0)  # in place of a portal's number


class Portals(NamedTuple):
    """The portals in view of a vertex, one of which is chosen."""

    total: Any  # sum of their irradiances, over 2 pi
    chance: Any  # probability of sampling one of them; 0 if none is in view
    center: Any  # of the chosen portal
    radius: Any
    number: Any  # of the chosen portal, a float
    left: Any  # the random number that is left, in [0, 1)


@device
def _strength(guide, k, cube, point, normal):
    """Returns (the radiance times the cosine of portal k at a vertex, 0 if it is not in view; the vector to its centre)."""
    x, y, z = guide.portal[k, PORTAL_CENTER], guide.portal[k, PORTAL_CENTER + 1], guide.portal[k, PORTAL_CENTER + 2]
    radius = guide.portal[k, PORTAL_RADIUS]
    to_center = vec.sub((x, y, z), point)
    square = vec.dot(to_center, to_center)
    cosine = (vec.dot(normal, to_center) + _HALF * radius) / math.sqrt(max(square, _LEAST))
    (radiance,) = columns(guide.radiance, cube, RADIANCE_COLUMNS, k, 1)
    in_view = (square > MIN_DISTANCE2 * radius * radius) & (cosine > _ZERO)
    return where(in_view, radiance * min(cosine, _ONE), zero_like(square)), to_center


@device
def portals_in_view(guide, cube, point, normal, u):
    """Returns the Portals in view of a vertex. normal: on the viewer's side. u: the random number that chooses one of them."""
    none = zero_like(u)
    total, number, center, radius, left = none, none + NO_PORTAL, (none, none, none), none + _ONE, u
    for k in range(len(guide.portal)):
        strength, to_center = _strength(guide, k, cube, point, normal)
        its_radius = guide.portal[k, PORTAL_RADIUS]
        cone = sphere_cone(max(vec.dot(to_center, to_center), its_radius * its_radius), its_radius)
        weight = strength * cone
        total = total + weight
        part = weight / max(total, _LEAST)
        is_chosen = left < part
        left = where(is_chosen, left, left - part) / where(is_chosen, part, max(_ONE - part, _LEAST))
        left = min(left, none + _BELOW_ONE)
        number = where(is_chosen, none + np.float32(k), number)
        center = where3(is_chosen, vec.add(point, to_center), center)
        radius = where(is_chosen, none + its_radius, radius)
    (other,) = columns(guide.radiance, cube, RADIANCE_COLUMNS, OTHER_RADIANCE, 1)
    chance = min(total / max(total + OTHER_WEIGHT * other, _LEAST), none + MOST_CHANCE)
    return Portals(total, where(number >= _ZERO, chance, none), center, radius, number, left)


@device
def sample_portal(view, point, u):
    """Returns a unit direction from a vertex towards the portal that is chosen in its view. u: a random number."""
    direction, _ = sample_sphere_direction(view.center, view.radius, point, (view.left, u))
    return direction


@device
def portals_pdf(guide, cube, point, normal, total, d, sampled):
    """Returns the pdf, per steradian, with which a vertex that samples a portal samples the unit direction d.

    total: from the vertex's Portals. sampled: the number of the portal for which d was sampled, or NO_PORTAL: by rounding, a
    direction at a portal's rim may seem to miss it.
    """
    pdf = zero_like(total)
    for k in range(len(guide.portal)):
        strength, to_center = _strength(guide, k, cube, point, normal)
        hits = hits_sphere(to_center, guide.portal[k, PORTAL_RADIUS], d) | (sampled == np.float32(k))
        pdf = pdf + where(hits, strength, zero_like(pdf))
    return pdf * _PER_TURN / max(total, _LEAST)
