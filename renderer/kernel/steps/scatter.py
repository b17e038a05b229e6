"""Scattering at a vertex: the next ray, the path's new state, and the media and depth counts after the vertex."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.steps.continue_or_end import roulette_weight_after
from renderer.kernel.steps.depths import count_bounce
from renderer.kernel.steps.sample_direct_light import media_beyond
from renderer.kernel.steps.splitting import share_of_branch
from renderer.kernel.steps.state import Crossings, PathState, Ray
from renderer.kernel.surface.ray_origins import leaves, offset_ray_origin
from renderer.wide.values import not_, where, zero_like

__all__ = ["Bounce", "cross_surface", "is_counted", "scatter"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)


class Bounce(NamedTuple):
    """The kind of scattering at a path's vertex (reflected or transmitted, and with which pdf), for `cross_surface`."""

    has_left: Any  # whether the ray has left its facet, as `leaves` returns (surface/ray_origins.py)
    reflected: Any
    pdf: Any  # of the whole material, whether or not the direction was aimed; 0 for a discrete direction


@device
def is_counted(has_left, reflected, pdf, options):
    """Returns True if a segment, sampled with that pdf, counts towards the depth.

    Smooth transmission, the only one with pdf 0 that is not reflected, counts only if `transmission_depth` is 0. has_left: from
    `leaves` (surface/ray_origins.py). A ray that hits its own facet again, which bent normals can cause, has not left the vertex
    and is not counted; otherwise white objects would darken towards their silhouettes at low depths.
    """
    is_clear = (pdf == _ZERO) & not_(reflected)
    return where(options.transmission_depth > 0, has_left & not_(is_clear), has_left)


@device
def scatter(surface, frame, ray, path, sample, branches, options):
    """Returns (Ray, PathState, Bounce) after the vertex has scattered the path.

    sample: a BsdfSample. branches: the number of branches into which the vertex splits the path, a float.
    """
    s, t, n = frame
    weight, pdf = share_of_branch(sample.weight, sample.pdf, branches)
    d = vec.to_world(s, t, n, sample.wi)
    reflected = sample.wi[2] > _ZERO
    has_left = leaves(surface, reflected, d)
    depth = where(is_counted(has_left, reflected, pdf, options), path.depth + _ONE, path.depth)
    roulette_weight = roulette_weight_after(ray.roulette_weight, path.number, weight, sample.eta2, sample.unguided)
    return (
        Ray(offset_ray_origin(surface, reflected, d), d, pdf, roulette_weight),
        PathState(path.radiance, depth, vec.mul(path.throughput, weight), path.number + _ONE),
        Bounce(has_left, reflected, sample.pdf / sample.unguided),
    )


@device
def cross_surface(scene, surface, crossings, bounce, is_surface):
    """Returns a path's Crossings after it has left the vertex by this Bounce. is_surface: False for a vertex in a medium."""
    medium_stack = crossings.medium_stack
    if scene.has.media is not None:
        medium_stack = where(bounce.reflected, medium_stack, media_beyond(scene, surface, medium_stack, is_surface))
    counts = count_bounce(crossings.counts, bounce.has_left & is_surface, bounce.reflected, bounce.pdf)
    return Crossings(medium_stack, counts, zero_like(bounce.pdf), crossings.ray_kind)
