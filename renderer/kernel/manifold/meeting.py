"""Light that a caster focuses on a matt surface, and that this sends on to another one: two ways to sample it.

Either a path leaves the second surface and hits the first by chance, where a walk leads it to the lamp (estimate.py); or a photon
from the lamp arrives at the first surface, and is connected with the path (backends/scalar/photon_light.py). Where light is
focused, photons are dense, and paths rarely come; at the very edge of a caustic, where walks do not converge, photons do arrive.
Both are weighted by the power heuristic (Veach 1997, 9.2), with these densities per area at the first surface:

- of paths: that of a diffuse bounce at the last vertex, whatever its material;
- of photons: by the étendue of the chain, n^2 cos dA dw, from the walk's derivatives, times the probability of a photon. In exact
  arithmetic this is the density by the photon's own derivatives unless shading normals differ from those of the true surface.

So both depend on the two vertices, the lamp's point and the walk alone; both ways compute the same, and the weights add up to 1.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays.rows import DIFFUSE, LAMP, SCATTERS_WITHIN, TRANSMITS, TRANSPARENT
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.manifold.photons import emission_pdf, kind_chance
from renderer.kernel.manifold.walk import TRANSMITTED

__all__ = ["bounce_density", "is_met", "photon_chance", "photon_density", "share"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_1_PI = np.float32(1 / math.pi)
_DIFFUSE = np.uint32(DIFFUSE)
_EXCLUDED = np.uint32(TRANSPARENT | SCATTERS_WITHIN | TRANSMITS | LAMP)
_NONE = np.uint32(0)
_NO = np.bool_(False)
# A photon takes as many rays as two vertices do.
_SEEN, _UNSEEN = np.float32(0.25), np.float32(0.1)


@device
def is_met(scene, material, options):
    """Returns True if photons are sampled at surfaces of this material: if it is diffuse and opaque.

    They never are in scenes with catchers of shadows or holdouts, since paths end there.
    """
    if len(scene.caustics.brightness) == 0:  # no photon arrives anywhere
        return _NO
    flags = np.uint32(scene.material_flags[material])
    return np.uint32(scene.material_kind[material]) == _DIFFUSE and flags & _EXCLUDED == _NONE and not options.has_mattes


@device
def bounce_density(last, surface):
    """Returns the density per area at a Surface of diffuse bounces from a LastVertex."""
    way = vec.sub(surface.point, last.point)
    square = vec.dot(way, way)
    inverse = _ONE / square
    n = last.normal
    is_sided = vec.dot(n, n) > _ZERO
    leaving = abs(vec.dot(n, way)) * math.sqrt(inverse) if is_sided else _HALF
    return leaving * abs(vec.dot(surface.geometric, way)) * math.sqrt(inverse) * inverse * _1_PI


@device
def photon_density(scene, lamp, caster, walk, spread, surface):
    """Returns the density per area, at a walk's Surface, of photons from a LampPoint that take the walk's chain.

    spread: the area perpendicular to the walk's last ray at the lamp's point, or the solid angle of its direction if the lamp is
    distant, per solid angle at the surface.
    """
    cosine = -vec.dot(walk.ray.d, walk.at.normal)
    pdf = emission_pdf(scene, lamp, caster) * kind_chance(scene, caster, walk.kind, cosine, walk.eta)
    ratio = _ONE / walk.eta if walk.kind == TRANSMITTED else _ONE
    casters = np.float32(len(scene.caustics.caster))
    return pdf * ratio * ratio * abs(vec.dot(surface.geometric, walk.d)) / (spread * casters)


@device
def photon_chance(number):
    """Returns the greatest probability of a photon at a vertex, if its throughput is 1. number: count of earlier vertices."""
    return _SEEN if number == _ZERO else _UNSEEN


@device
def share(own, other):
    """Returns the weight of the power heuristic for the way of density `own`, 0 to 1."""
    ratio = other / own
    return _ONE / (_ONE + ratio * ratio) if own > _ZERO else _ZERO
