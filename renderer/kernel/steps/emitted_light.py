"""Emission of surfaces, the environment and suns that a path's ray hits, and its addition to the path's radiance."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.light.lights import environment_seen, primitive_light_pdf, sun_seen
from renderer.kernel.light.links import is_linked
from renderer.kernel.light.sphere_light import hits_emitting_side
from renderer.kernel.light.visibility import counts_when_hit, is_seen
from renderer.kernel.material.material import emission
from renderer.kernel.steps.state import with_radiance
from renderer.wide.values import any_of, as_wide, lookup, u32, where, where3, zero_like

__all__ = [
    "Emission",
    "add_light",
    "add_medium_light",
    "background_counts",
    "brought_light",
    "clamp_indirect",
    "emitted_by_environment",
    "emitted_by_sun",
    "emitted_light",
]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INDIRECT = np.float32(3)  # number of segments from which on light is indirect
_FIRST_LIGHT = np.uint32(0)


class Emission(NamedTuple):
    """The radiance emitted towards a ray by what it hits, and the pdf, per steradian, with which light sampling finds it.

    The pdf is 0 if MIS does not apply.
    """

    radiance: Any
    light_pdf: Any


@device
def emitted_light(scene, surface, lit, ray, last, time):
    """Returns the Emission of a surface that the ray hits.

    lit: whether its emission counts. last: the LastVertex. time: shutter time, 0 ... 1; None in a scene without motion.
    """
    light = where(lit, surface.light, _FIRST_LIGHT)
    counts = lit
    if scene.has.links is not None:
        counts = lit & is_linked(scene, light, last.object)
    if scene.has.visibility is not None:
        counts = counts & counts_when_hit(scene, light, ray.pdf)
    front = hits_emitting_side(scene, light, last.point, ray.d, surface.front, time)
    radiance = emission(scene, surface.material, surface.uv, surface.uv1, front, time)
    cosine = vec.dot(surface.geometric, vec.neg(ray.d))
    judged = counts & (ray.pdf > _ZERO)
    light_pdf = primitive_light_pdf(scene, light, last.point, last.normal, surface.point, cosine, judged, time)
    return Emission(_counted(scene, counts, radiance), light_pdf)


@device
def _counted(scene, counts, radiance):
    """Returns the radiance where it counts, else black; in scenes without light links all of it."""
    if scene.has.links is not None:
        none = zero_like(radiance[0])
        radiance = where3(counts, radiance, (none, none, none))
    return radiance


@device
def emitted_by_environment(scene, ray):
    """Returns the Emission of the environment for a ray that has hit nothing."""
    radiance, light_pdf = environment_seen(scene, ray.d, ray.pdf > _ZERO)
    return Emission(radiance, light_pdf)


@device
def emitted_by_sun(scene, which, ray, last, number, kind, time):
    """Returns the Emission of a sun for a ray that has hit nothing.

    which: index in scene.sun; number: count of earlier vertices. kind: of the ray, from its Crossings.
    """
    radiance, light_pdf = sun_seen(scene, which, last.point, last.normal, ray.d, ray.pdf > _ZERO, number == _ZERO, time)
    if scene.has.links is not None:
        light = as_wide(np.uint32(scene.sun[which]), ray.pdf)
        counts = is_linked(scene, light, last.object)
        if scene.has.visibility is not None:
            word = u32(lookup(scene.light_visibility, light))
            counts = counts & counts_when_hit(scene, light, ray.pdf) & is_seen(word, kind)
        radiance = _counted(scene, counts, radiance)
    return Emission(radiance, light_pdf)


@device
def background_counts(ray, path, options):
    """Returns True where light counts that comes from beyond the scene: of the environment and of suns.

    It does not where the ray has a negative pdf, nor for camera rays before a transparent background.
    """
    counts = ray.pdf >= _ZERO
    if options.transparent_background:
        counts = counts & (path.number > _ZERO)
    return counts


@device
def clamp_indirect(light, segments, limit):
    """Clamps indirect light: returns `light`, scaled so that its largest channel is at most `limit`.

    Direct light is unchanged. segments: number of segments of the path by which the light reaches the camera. limit: 0 for no
    clamping.
    """
    if limit > _ZERO:
        most = vec.maximum(light)
        bright = (segments >= _INDIRECT) & (most > limit)
        if any_of(bright):
            light = where3(bright, vec.scale(light, limit / most), light)
    return light


@device
def brought_light(path, light, options):
    """Returns what `light`, which a path's ray hits, adds to the path's radiance.

    light: radiance multiplied by its MIS weight.
    """
    return clamp_indirect(vec.mul(path.throughput, light), path.depth + _ONE, options.clamp)


@device
def add_light(path, light, mask, options):
    """Returns the path with `light`, which its ray hits, added where `mask` is True; see `brought_light`."""
    brought = brought_light(path, light, options)
    return with_radiance(path, where3(mask, vec.add(path.radiance, brought), path.radiance))


@device
def add_medium_light(path, emitted, options):
    """Returns (the path with the light that its medium emits on a flight added, that light).

    emitted: from a MediumEvent. No light sample finds it, so it has no MIS weight.
    """
    light = clamp_indirect(emitted, path.depth + _ONE, options.clamp)
    return with_radiance(path, vec.add(path.radiance, light)), light
